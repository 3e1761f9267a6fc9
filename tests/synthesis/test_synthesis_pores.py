"""Pores: as even on the surface as discs can lie, whatever the UV layout."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from reference.synthesis import points_on
from rhytid.device.runtime import Device
from rhytid.domain.mesh import Mesh
from rhytid.errors import MeshError
from rhytid.synthesis.fields import Fields
from rhytid.synthesis.pores import scatter_pores
from rhytid.synthesis.progress import silent
from rhytid.synthesis.statistics import mean_spacing, nearest_distances
from rhytid.synthesis.surface import Points, Surface
from rhytid.synthesis.workspace import Workspace
from synthesis import sheets

RADIUS = 0.03


def scattered(device: Device, mesh: Mesh) -> tuple[Surface, Points]:
    return Surface.of(mesh), sheets.scattered(device, mesh, RADIUS)


@pytest.mark.parametrize("layout", [sheets.even, sheets.uneven])
def test_no_two_pores_are_nearer_than_the_radius(device: Device, layout: sheets.Layout) -> None:
    _, pores = scattered(device, sheets.sheet(layout))
    assert len(pores) > 500
    assert len(cKDTree(pores.position).query_pairs(RADIUS)) == 0


def test_hardly_a_place_has_room_for_another_pore(device: Device) -> None:
    surface, pores = scattered(device, sheets.sheet(sheets.uneven))
    probes = points_on(surface.corners, surface.area, 20_000, seed=4)
    distance, _ = cKDTree(pores.position).query(probes)
    assert np.mean(distance > RADIUS) < 0.01
    assert distance.max() < 1.3 * RADIUS


def test_pores_are_even_in_space_where_uv_is_not(device: Device) -> None:
    mesh = sheets.sheet(sheets.uneven)
    strips = np.zeros(5)
    for seed in range(3, 19):
        pores = sheets.scattered(device, mesh, RADIUS, seed)
        strips += np.histogram(pores.position[:, 0], 5)[0]
        with Workspace(device) as work:
            mean, deviation = mean_spacing(work, pores)
        assert RADIUS < mean < 1.2 * RADIUS
        assert deviation < 0.1 * mean
    # A fifth of the surface in each strip, though the last takes half of the map.
    assert strips.max() < 1.08 * strips.min()


def test_sheets_that_touch_do_not_see_each_other(device: Device) -> None:
    surface, pores = scattered(device, sheets.face_to_face())
    up = pores.normal[:, 2] > 0
    for one in (up, ~up):
        position = pores.position[one]
        assert len(cKDTree(position).query_pairs(RADIUS)) == 0
        # As many as one half of the area takes at this radius.
        assert len(position) == pytest.approx(taken(surface) / 2, rel=0.1)


def test_two_sides_of_a_sheet_may_share_their_vertices(device: Device) -> None:
    one = sheets.sheet(lambda xy: 0.05 + 0.4 * xy)
    both = Mesh(
        one.positions,
        np.concatenate([one.faces, one.faces[:, ::-1]]),
        np.concatenate([one.uv, one.uv + 0.5]),
        np.concatenate([one.face_uv, one.face_uv[:, ::-1] + len(one.uv)]),
    )
    surface, pores = scattered(device, both)
    up = pores.triangle < len(one.faces)
    assert (np.sign(pores.normal[:, 2]) == np.where(up, 1, -1)).all()
    for side in (up, ~up):
        assert len(cKDTree(pores.position[side]).query_pairs(RADIUS)) == 0
        assert np.count_nonzero(side) == pytest.approx(taken(surface) / 2, rel=0.1)


def taken(surface: Surface) -> float:
    """How many pores the area takes, RADIUS apart."""
    return 0.61 * float(surface.area.sum()) / RADIUS**2


def test_pores_lie_in_their_triangles(device: Device) -> None:
    surface, pores = scattered(device, sheets.tube())
    off = surface.place(pores.triangle, pores.uv) - pores.position
    assert np.abs(off).max() < 1e-5


def test_nothing_lies_outside_the_udims(device: Device) -> None:
    shifted = sheets.sheet(lambda xy: 2 * xy - [0.5, 0.7])
    _, pores = scattered(device, shifted)
    assert len(pores)
    assert pores.uv.min() >= 0
    beyond = sheets.sheet(lambda xy: 4 * xy + [8, 3])
    assert scattered(device, beyond)[1].uv[:, 0].max() < 10


def test_a_mesh_outside_the_udims_is_refused() -> None:
    with pytest.raises(MeshError, match="u 0 to 10"):
        Surface.of(sheets.sheet(lambda xy: xy - 3))


def test_only_the_lowest_of_stacked_charts_carries_pores() -> None:
    one = sheets.sheet()
    aside = one.positions + np.float32([2, 0, 0])
    faces = np.concatenate([one.faces, one.faces[:, ::-1] + len(aside)])
    face_uv = np.concatenate([one.face_uv, one.face_uv[:, ::-1]])
    both = Mesh(np.concatenate([one.positions, aside]), faces, one.uv, face_uv)
    carries = Surface.of(both).carries
    assert carries[: len(one.faces)].all()
    assert not carries[len(one.faces) :].any()


def with_sliver(stretch: float) -> Mesh:
    """A sheet and one small triangle whose UV is `stretch` times as large as the sheet's."""
    one = sheets.sheet()
    corner = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]) * 1e-4
    small = np.concatenate([corner, np.ones((3, 1))], axis=1)
    uv = np.concatenate([one.uv, 0.8 * stretch * corner + [1, 0]])
    extra: NDArray[np.int64] = np.array([[0, 1, 2]])
    faces = np.concatenate([one.faces, extra + len(one.positions)])
    positions = np.concatenate([one.positions, small.astype(np.float32)])
    return Mesh(positions, faces, uv, faces)


def test_triangles_stretched_beyond_reason_carry_nothing() -> None:
    assert Surface.of(with_sliver(50.0)).stretched == 0
    surface = Surface.of(with_sliver(200.0))
    assert surface.stretched == 1
    assert not surface.carries[-1]


@pytest.mark.parametrize("layout", [sheets.even, sheets.uneven])
def test_the_nearest_pore_is_found_at_any_distance(device: Device, layout: sheets.Layout) -> None:
    _, pores = scattered(device, sheets.sheet(layout))
    few = pores.take(np.unique(np.geomspace(1, len(pores) - 1, 40).astype(int)))
    for some in (pores, few):
        with Workspace(device) as work:
            found = nearest_distances(work, some)
        wanted = cKDTree(some.position).query(some.position, k=2)[0][:, 1]
        assert found == pytest.approx(wanted, rel=1e-6)


class Coarser(Fields):
    """Pores twice as far apart in the right half, by their place in the map."""

    least_spacing, most_spacing = 1.0, 2.0

    def spacing(self, triangle: NDArray[np.int32], uv: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.where(uv[:, 0] < 0.5, 1.0, 2.0).astype(np.float32)


def test_spacing_may_differ_from_place_to_place(device: Device) -> None:
    mesh, radius = sheets.sheet(), 0.02
    with Workspace(device) as work:
        pores = scatter_pores(work, Surface.of(mesh), radius, 3, silent, Coarser())
        distance = nearest_distances(work, pores)
    left, right = pores.position[:, 0] < 0.46, pores.position[:, 0] > 0.54
    assert distance[left].min() > radius
    assert distance[right].min() > 2 * radius
    for half, size in ((left, radius), (right, 2 * radius)):
        assert distance[half].mean() == pytest.approx(1.09 * size, rel=0.02)
        assert np.count_nonzero(half) == pytest.approx(0.46 * 0.605 / size**2, rel=0.08)
