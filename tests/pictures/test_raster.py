from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from rhytid.pictures.images import BACKGROUND
from rhytid.pictures.raster import View, rasterize, rasterize_uv, shade_mesh, vertex_normals
from rhytid_lab.samples.face import procedural_face
from rhytid_lab.samples.sphere import RADIUS, sphere

QUAD = np.array([[[0, 0], [8, 0], [8, 8]], [[0, 0], [8, 8], [0, 8]]], np.float64)


def winner(corners: NDArray[np.float64], x: float, y: float) -> int:
    """The first triangle that holds a point, one at a time; -1 for none."""
    for index, (a, b, c) in enumerate(corners):
        sides = [
            (q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0])
            for p, q in ((a, b), (b, c), (c, a))
        ]
        if min(sides) >= 0 or max(sides) <= 0:
            return index
    return -1


def test_every_pixel_gets_the_first_triangle_that_holds_its_centre() -> None:
    corners = np.random.default_rng(2).uniform(-4, 28, (40, 3, 2))
    found = rasterize(corners, 20, 24).triangle
    expected = [[winner(corners, x + 0.5, y + 0.5) for x in range(24)] for y in range(20)]
    np.testing.assert_array_equal(found, expected)


def test_nearer_triangle_is_visible_and_the_lower_index_on_ties() -> None:
    both = np.concatenate([QUAD, QUAD])
    behind = rasterize(both, 8, 8, np.repeat([0.0, 0, 1, 1], 3).reshape(4, 3))
    assert set(np.unique(behind.triangle)) == {2, 3}
    tied = rasterize(both, 8, 8, np.zeros((4, 3)))
    assert set(np.unique(tied.triangle)) == {0, 1}


def test_corner_values_are_interpolated_and_the_background_is_kept() -> None:
    seen = rasterize(QUAD, 8, 10)
    picture = seen.smooth(QUAD, background=-1.0)
    np.testing.assert_allclose(picture[3, 5], (5.5, 3.5))
    np.testing.assert_array_equal(picture[:, 9], -1.0)
    assert seen.flat(np.array([5.0, 7.0]))[0, 4] == 5.0


def test_triangles_without_area_cover_nothing() -> None:
    flat = np.array([[[0, 0], [4, 4], [8, 8]], [[2, 2], [2, 2], [2, 2]]], np.float64)
    assert not rasterize(flat, 8, 8).covered.any()


def test_uv_map_has_v_up_and_subtracts_the_udim() -> None:
    corner = np.array([[[1.0, 0.75], [1.25, 1.0], [1.0, 1.0]]])
    covered = rasterize_uv(corner, 8, udim_origin=(1, 0)).covered
    assert covered[0, 0]
    assert covered.sum() == 3


def test_view_keeps_proportions() -> None:
    points = np.array([[0.0, 0, 0], [2, 1, 0]])
    view = View.around(points, margin=0.0)
    np.testing.assert_allclose(view.pixels(points, 100), [[0, 75], [100, 25]])


def test_normals_of_a_sphere_point_outwards() -> None:
    mesh = sphere(48)
    normals = vertex_normals(mesh.positions, mesh.faces)
    inner = mesh.positions[:, 2] > 0.1 * RADIUS
    np.testing.assert_allclose(normals[inner], mesh.positions[inner] / RADIUS, atol=2e-3)


def test_sphere_is_lit_from_the_upper_left() -> None:
    mesh = sphere(48)
    picture = shade_mesh(mesh.positions, mesh.faces, 64)
    assert picture.shape == (64, 64, 3)
    assert picture[20, 20].sum() > picture[44, 44].sum() + 60
    np.testing.assert_array_equal(picture[0, 0], 255 * np.array(BACKGROUND))


def test_colours_are_per_triangle() -> None:
    mesh = sphere(8)
    red = shade_mesh(mesh.positions, mesh.faces, 32, colours=np.tile([0.8, 0, 0], (128, 1)))
    assert red[16, 16, 0] > 60
    assert (red[16, 16, 1:] == 0).all()


@pytest.mark.parametrize(("weight", "dark"), [(0.0, False), (1.0, True)])
def test_open_mouth_is_dark(weight: float, dark: bool) -> None:
    face = procedural_face(48)
    positions = face.pose({"jaw_open": weight})
    view = View(0.0, -7.6, 8.0)
    picture = shade_mesh(positions, face.mesh.faces, 96, view)
    assert ((picture < 32).all(axis=-1).sum() > 100) == dark
