"""Look-up with triangles that float32 cannot tell from a line, and with very many in one cell."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.scenes import settings_of, sheet
from pipeline.test_stage_locate import located
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.errors import LimitError
from rhytid.pipeline import cells
from rhytid.pipeline.cells import cells_that_fit, list_by_cell
from rhytid.pipeline.elements import wrinkle_arrays


def first_of(mesh, corners):
    """The mesh with one more triangle, as index 0, with these corners (3, 2) in UV."""
    count = len(mesh.uv)
    return Mesh(
        mesh.positions,
        np.concatenate([mesh.faces[:1], mesh.faces]),
        np.concatenate([mesh.uv, corners]),
        np.concatenate([[[count, count + 1, count + 2]], mesh.face_uv]),
    )


@pytest.mark.parametrize(
    "size", [(1e-9, 1e-9), (1e-3, 1e-9), (1e-9, 0.1)], ids=["point", "short line", "long line"]
)
@pytest.mark.parametrize("place", [(0.5, 0.5), (0.3, 0.7)])
def test_a_triangle_that_rounds_to_no_area_holds_nothing(device, place, size):
    mesh = sheet()
    corners = np.array([(0, 0), (1, 0), (0, 1)]) * size + place
    plain = located(device, mesh, 256, 0)
    found = located(device, first_of(mesh, corners), 256, 0)
    np.testing.assert_array_equal(found, plain + 1)


def test_a_triangle_of_a_few_float32_steps_holds_only_itself(device):
    mesh = sheet()
    corners = np.array([(0, 0), (1, 0), (0, 1)]) * 4e-7 + 0.3
    found = located(device, first_of(mesh, corners), 256, 0)
    np.testing.assert_array_equal(found, located(device, mesh, 256, 0) + 1)


def test_cells_are_halved_until_the_lists_fit(monkeypatch):
    low, high = np.zeros((10, 2)), np.full((10, 2), 0.999)
    monkeypatch.setattr(cells, "MOST_ENTRIES", 10 * 8 * 8)
    assert cells_that_fit(low, high, 64) == 8
    assert cells_that_fit(low[:1], high[:1], 16) == 16
    assert len(list_by_cell(low, high, 8, top_down=False).members) == 640
    monkeypatch.setattr(cells, "MOST_ENTRIES", 1)
    assert cells_that_fit(low, high, 64) == 1


def test_fewer_cells_find_the_same_triangles(device, monkeypatch):
    mesh = sheet()
    plain = located(device, mesh, 256, 16, resolution=1024)
    monkeypatch.setattr(cells, "MOST_ENTRIES", len(mesh.faces) + 150)
    np.testing.assert_array_equal(located(device, mesh, 256, 16, resolution=1024), plain)


def test_more_entries_than_an_asset_may_have_are_refused_with_both_numbers():
    count, blocks = 2000, 256 * 256  # each wrinkle over all blocks
    graph = WrinkleGraph(
        node_uv=np.array([[-0.5, -0.5], [1.5, 1.5]]),
        node_weight=np.zeros(2),
        node_radius=np.full(2, 0.01),
        edge_nodes=np.tile([[0, 1]], (count, 1)),
        edge_weight=np.ones(count),
        edge_half_width=np.full(count, 0.5),
    )
    settings = settings_of(resolution=16384)
    with pytest.raises(LimitError, match=rf"{count * blocks} entries .* {2**26}"):
        wrinkle_arrays(graph, np.zeros(count, np.int32), settings, 1001)
