"""Which triangle holds a texel or a point, against the reference: exact but for a band at edges.

Triangles that float32 cannot tell from a line, and very many in one cell, are at the end.
"""

from __future__ import annotations

import numpy as np
import pytest

from meshes import bumpy_grid
from pipeline.scenes import EDGE_BAND, settings_of, sheet
from reference import drawing, locate
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import udim_origin
from rhytid.errors import LimitError
from rhytid.pipeline import cells
from rhytid.pipeline.cells import cells_that_fit, list_by_cell
from rhytid.pipeline.element_arrays import wrinkle_arrays
from rhytid.pipeline.locate import UdimTriangles, locate_points
from rhytid.pipeline.vectors import VECTOR


def located(device, mesh, side, padding, udim=1001, resolution=256, at=(0, 0), count=None):
    triangles = UdimTriangles(device, mesh, udim, resolution, padding)
    count = count or side
    found = triangles.texels(side, *at, count)
    result = device.read(found, (count, count), np.int32)
    found.release()
    triangles.release()
    return result


def expected(mesh, side, padding, udim=1001, resolution=256, at=(0, 0), count=None):
    """Index (n, n), the number of triangles for none, and whether it is sure."""
    count = count or side
    points = drawing.crop(*at, count, count, side) + udim_origin(udim)
    index, margin = locate.locate(points, mesh.triangle_uv(), padding / resolution)
    index[index < 0] = len(mesh.faces)
    return index.reshape(count, count), margin.reshape(count, count) > EDGE_BAND


def check(found, wanted, least=0.98):
    index, sure = wanted
    np.testing.assert_array_equal(found[sure], index[sure])
    assert sure.mean() >= least
    return index


def turned_over(mesh):
    """The same triangles with every other one mirrored in UV, which here means wound about."""
    faces, face_uv = mesh.faces.copy(), mesh.face_uv.copy()
    faces[::2], face_uv[::2] = faces[::2, ::-1], face_uv[::2, ::-1]
    return Mesh(mesh.positions, faces, mesh.uv, face_uv)


@pytest.mark.parametrize("padding", [0, 5, 16, 32])
@pytest.mark.parametrize("seed", [1, 2])
def test_texels_and_their_padding(device, seed, padding):
    mesh = sheet(seed=seed)
    index = check(located(device, mesh, 256, padding), expected(mesh, 256, padding))
    assert (index == len(mesh.faces)).any()
    assert len(np.unique(index)) > len(mesh.faces) / 2


def test_winding_does_not_matter(device):
    mesh = turned_over(sheet())
    check(located(device, mesh, 256, 16), expected(mesh, 256, 16))


def test_of_overlapping_triangles_the_lowest_holds(device):
    positions, faces, uv, face_uv = bumpy_grid(6, seed=3)
    above = (uv * 0.9 + 0.05)[:, ::-1]  # laid over the first, mirrored and moved
    mesh = Mesh(
        positions,
        np.concatenate([faces, faces]),
        np.concatenate([uv, above]),
        np.concatenate([face_uv, face_uv + len(uv)]),
    )
    index = check(located(device, mesh, 256, 8), expected(mesh, 256, 8))
    assert (index < len(faces)).any()
    assert ((index >= len(faces)) & (index < len(mesh.faces))).any()


def test_a_crop_and_a_coarse_level(device):
    mesh = sheet()
    whole = located(device, mesh, 256, 16)
    crop = located(device, mesh, 256, 16, at=(64, 128), count=64)
    np.testing.assert_array_equal(crop, whole[64:128, 128:192])
    for side in (128, 16, 2, 1):
        # Padding is meant in texels of level 0 at every level.
        check(located(device, mesh, side, 16), expected(mesh, side, 16), least=0.0)


@pytest.mark.parametrize("count", [1, 2, 4, 8, 24, 64])
def test_every_texel_is_written(device, count):
    """Also where memory of others had other numbers before."""
    mesh, other = sheet(), np.int32(-7)
    triangles = UdimTriangles(device, mesh, 1001, 64, 0)
    size = max(count * count, VECTOR)
    device.full(size, other).release()
    assert device.pool.held >= 4 * size
    found = device.read(triangles.texels(64, 0, 0, count), (size,), np.int32)
    assert (found != other).all()
    assert (found[count * count :] == len(mesh.faces)).all()
    triangles.release()


@pytest.mark.parametrize("resolution", [256, 4096])
def test_every_udim_of_a_mesh(device, resolution):
    mesh = sheet(udims=2)
    at = (resolution // 4, resolution // 2)
    for udim in (1001, 1002, 1011, 1012):
        window = {"udim": udim, "resolution": resolution, "at": at, "count": 64}
        found = located(device, mesh, resolution, 16, **window)
        check(found, expected(mesh, resolution, 16, **window))


def test_far_udims_lose_no_digits(device):
    positions, faces, uv, face_uv = bumpy_grid(8, seed=4)
    near, far = (
        Mesh(positions, faces, uv, face_uv),
        Mesh(positions, faces, np.add(uv, (9.0, 30.0)), face_uv),
    )
    np.testing.assert_array_equal(
        located(device, far, 256, 16, udim=1310), located(device, near, 256, 16)
    )


def test_ties_go_to_the_lowest_index(device):
    # Texel centres lie on the diagonals and, in the middle, on the border of two squares.
    square = np.array([[0, 0], [0.5, 0], [0.5, 1], [0, 1], [1, 0], [1, 1]])
    faces = np.array([[1, 4, 5], [1, 5, 2], [0, 1, 2], [0, 2, 3]])
    for order in (faces, faces[::-1]):
        mesh = Mesh(np.pad(square, ((0, 0), (0, 1))), order, square, order)
        found = located(device, mesh, 256, 4)
        corners = square[order]
        points = drawing.crop(0, 0, 256, 256, 256)
        index = locate.locate(points, corners, 4 / 256)[0].reshape(256, 256)
        np.testing.assert_array_equal(found, index)  # all coordinates are exact


def test_padding_ends_where_it_should(device):
    square = np.array([[0.25, 0.25], [0.75, 0.25], [0.75, 0.75], [0.25, 0.75]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    mesh = Mesh(np.pad(square, ((0, 0), (0, 1))), faces, square, faces)
    row = located(device, mesh, 256, 10)[128]
    inside = np.flatnonzero(row < 2)
    assert (inside[0], inside[-1]) == (64 - 10, 191 + 10)
    np.testing.assert_array_equal(
        np.flatnonzero(located(device, mesh, 256, 0)[128] < 2)[[0, -1]], [64, 191]
    )


def test_a_triangle_without_area_in_uv_holds_nothing(device):
    positions, faces, uv, face_uv = bumpy_grid(4, seed=5)
    line = np.concatenate([uv, [[0.1, 0.1], [0.9, 0.9], [0.5, 0.5]]])
    mesh = Mesh(
        positions,
        np.concatenate([[[0, 1, 2]], faces]),
        line,
        np.concatenate([[[len(uv), len(uv) + 1, len(uv) + 2]], face_uv]),
    )
    found = located(device, mesh, 256, 16)
    assert (found != 0).all()
    check(found, expected(mesh, 256, 16))


def test_points_of_all_udims_and_of_none(device):
    mesh = sheet(udims=2)
    rng = np.random.default_rng(6)
    points = rng.uniform(0.02, 1.98, (3000, 2)).astype(np.float32)
    found = locate_points(device, mesh, points, 256, 16)
    index, margin = locate.locate(points, mesh.triangle_uv(), 16 / 256)
    index[index < 0] = len(mesh.faces)
    # A point sees the triangles of its own UDIM: those whose padding reaches over the border too.
    sure = margin > EDGE_BAND
    np.testing.assert_array_equal(found[sure], index[sure])
    outside = np.array([[-0.5, 0.5], [10.5, 0.5], [0.5, -0.5], [7.5, 7.5]], np.float32)
    none = locate_points(device, mesh, outside, 256, 16)
    np.testing.assert_array_equal(none, len(mesh.faces))


def test_points_without_number_are_no_work(device):
    assert locate_points(device, sheet(), np.zeros((0, 2), np.float32), 256, 16).shape == (0,)


@pytest.mark.parametrize("seed", [1, 2])
def test_no_texel_falls_between_triangles(device, seed):
    # A fan over the whole map whose spokes go through texel centres.
    rng = np.random.default_rng(seed)
    hub = rng.uniform(0.45, 0.55, 2)
    spokes = (rng.integers(0, 256, (2000, 2)) + 0.5) / 256 - hub
    angle = np.arctan2(spokes[:, 1], spokes[:, 0])
    _, order = np.unique(angle, return_index=True)
    rim = hub + 2 * spokes[order] / np.linalg.norm(spokes[order], axis=1, keepdims=True)
    uv = np.concatenate([[hub], rim]).astype(np.float32)
    spoke = np.arange(len(rim))
    faces = np.stack([0 * spoke, spoke + 1, (spoke + 1) % len(rim) + 1], axis=1)
    mesh = Mesh(np.pad(uv, ((0, 0), (0, 1))), faces, uv, faces)
    assert (located(device, mesh, 256, 0) < len(faces)).all()


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
