"""Pores: as even on the surface as discs can lie, whatever the UV layout."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from rhytid.domain.mesh import Mesh
from rhytid.errors import MeshError
from rhytid.synthesis.pores import mean_spacing, scatter_pores
from rhytid.synthesis.progress import silent
from rhytid.synthesis.surface import Points, Surface
from synthesis import sheets

RADIUS = 0.03


def scattered(mesh: Mesh, radius: float = RADIUS) -> tuple[Surface, Points]:
    surface = Surface.of(mesh)
    return surface, scatter_pores(surface, radius, np.random.default_rng(3), silent)


@pytest.mark.parametrize("layout", [sheets.even, sheets.uneven])
def test_no_two_pores_are_nearer_than_the_radius(layout: sheets.Layout) -> None:
    _, pores = scattered(sheets.sheet(layout))
    assert len(pores) > 500
    assert len(cKDTree(pores.position).query_pairs(RADIUS)) == 0


def test_hardly_a_place_has_room_for_another_pore() -> None:
    surface, pores = scattered(sheets.sheet(sheets.uneven))
    probes = surface.sample(20_000, np.random.default_rng(4))
    distance, _ = cKDTree(pores.position).query(probes.position)
    assert np.mean(distance > RADIUS) < 0.01
    assert distance.max() < 1.3 * RADIUS


def test_pores_are_even_in_space_where_uv_is_not() -> None:
    _, pores = scattered(sheets.sheet(sheets.uneven))
    # A fifth of the surface in each strip, though the last takes half of the map.
    strips, _ = np.histogram(pores.position[:, 0], 5)
    assert strips.max() < 1.1 * strips.min()
    mean, deviation = mean_spacing(pores, 1.0)
    assert RADIUS < mean < 1.2 * RADIUS
    assert deviation < 0.1 * mean


def test_sheets_that_touch_do_not_see_each_other() -> None:
    _, pores = scattered(sheets.face_to_face())
    up = pores.normal[:, 2] > 0
    for one in (up, ~up):
        position = pores.position[one]
        assert len(cKDTree(position).query_pairs(RADIUS)) == 0
        # As many as an area of one half takes at this radius.
        assert len(position) == pytest.approx(0.5 * 0.61 / RADIUS**2, rel=0.1)


def test_pores_lie_in_their_triangles() -> None:
    surface, pores = scattered(sheets.tube())
    off = surface.place(pores.triangle, pores.uv) - pores.position
    assert np.abs(off).max() < 1e-5


def test_points_are_uniform_by_area_in_space() -> None:
    surface = Surface.of(sheets.sheet(sheets.uneven))
    points = surface.sample(100_000, np.random.default_rng(5))
    counts, _, _ = np.histogram2d(points.position[:, 0], points.position[:, 1], 8)
    # Chi squared with 63 degrees of freedom: mean 63, deviation 11.2.
    expected = len(points) / counts.size
    assert np.sum((counts - expected) ** 2 / expected) < 63 + 5 * 11.2


def test_nothing_lies_outside_the_udims() -> None:
    shifted = sheets.sheet(lambda xy: 2 * xy - [0.5, 0.7])
    _, pores = scattered(shifted)
    assert len(pores)
    assert pores.uv.min() >= 0
    beyond = sheets.sheet(lambda xy: 4 * xy + [8, 3])
    assert scattered(beyond)[1].uv[:, 0].max() < 10


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
