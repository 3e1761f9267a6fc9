"""Which UDIMs a mesh overlaps."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rhytid.domain import mesh as domain_mesh
from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import mesh_udims


def mesh_of(*triangles):
    """A mesh whose triangles have these corners (3, 2) in UV and a good shape in space."""
    uv = np.concatenate([np.asarray(t, np.float64) for t in triangles])
    space = np.tile(np.eye(3), (len(triangles), 1))
    faces = np.arange(len(uv)).reshape(-1, 3)
    return Mesh(space, faces, uv, faces)


def square(u0, v0, u1, v1):
    return [[u0, v0], [u1, v0], [u1, v1]], [[u0, v0], [u1, v1], [u0, v1]]


def test_a_triangle_overlaps_no_udim_beyond_its_long_side():
    assert mesh_udims(mesh_of([[0.1, 0.1], [1.89, 0.1], [0.1, 1.89]])) == (1001, 1002, 1011)
    assert mesh_udims(mesh_of([[0.1, 0.1], [1.91, 0.1], [0.1, 1.91]])) == (1001, 1002, 1011, 1012)


def test_triangles_without_area_in_uv_overlap_nothing():
    line = [[0.2, 0.2], [5.2, 5.2], [3.2, 3.2]]
    point = [[7.5, 0.5]] * 3
    assert mesh_udims(mesh_of(*square(0.1, 0.1, 0.9, 0.9), line, point)) == (1001,)


@pytest.mark.parametrize("beyond", [0.0, 1e-7, 9e-7])
def test_a_border_that_rounding_passes_is_no_overlap(beyond):
    end = 1.0 + beyond
    assert mesh_udims(mesh_of(*square(0.0 - beyond, 0.0 - beyond, end, end))) == (1001,)
    assert mesh_udims(mesh_of(*square(1.0 - beyond, 1.0, 2.0, end + 1))) == (1012,)


def test_a_border_that_is_passed_by_more_is_one():
    assert mesh_udims(mesh_of(*square(0.0, 0.0, 1.00001, 1.0))) == (1001, 1002)


def test_triangles_as_small_as_the_slack_are_somewhere():
    assert mesh_udims(mesh_of(*square(0.0, 0.0, 1e-8, 1e-8))) == (1001,)
    assert mesh_udims(mesh_of(*square(1.0 - 1e-8, 0.5, 1.0 + 1e-8, 0.5 + 1e-8))) == (1001, 1002)


def test_what_is_outside_the_range_is_clipped():
    assert mesh_udims(mesh_of(*square(-3.5, -2.5, 1.5, 0.5))) == (1001, 1002)
    assert mesh_udims(mesh_of(*square(9.5, 99.5, 60.0, 100.0))) == (2000,)
    assert mesh_udims(mesh_of(*square(-3.0, -3.0, -1.0, -1.0))) == ()


@given(st.lists(st.tuples(*[st.floats(-1.5, 4.5)] * 6), min_size=1, max_size=3))
def test_random_triangles_overlap_where_they_have_points(rows):
    triangles = [np.reshape(row, (3, 2)) for row in rows]
    spans = [(b - a, c - a) for a, b, c in triangles]
    if any(abs(e[0] * f[1] - e[1] * f[0]) < 0.02 for e, f in spans):
        return
    found = mesh_udims(mesh_of(*triangles))
    assert found == tuple(sorted(set(found)))
    shares = np.random.default_rng(1).dirichlet((0.4, 0.4, 0.4), 4000)
    points = np.concatenate([shares @ t for t in triangles])
    inside = points[(points >= 0).all(axis=1) & (np.abs(points - np.rint(points)) > 2e-6).all(1)]
    seen = set((1001 + inside // 1 @ [1, 10]).astype(int).tolist())
    assert seen <= set(found)
    assert all(_near(udim, points) for udim in found)


def _near(udim, points):
    """Whether a sample point is in the UDIM, or a corner of a triangle may just reach into it."""
    middle = np.array([(udim - 1001) % 10, (udim - 1001) // 10]) + 0.5
    return np.abs(points - middle).max(axis=1).min() < 0.8


def test_many_triangles_are_looked_at_in_parts(monkeypatch):
    rng = np.random.default_rng(3)
    corners = rng.uniform(0.0, 3.0, (50, 1, 2)) + rng.uniform(-0.3, 0.3, (50, 3, 2))
    corners[::7] = corners[::7, :1]  # without area
    space = np.tile(np.eye(3), (50, 1))
    space[3 * 11 : 3 * 12] = 0.0
    faces = np.arange(150).reshape(-1, 3)
    mesh = Mesh(space, faces, corners.reshape(-1, 2), faces)
    whole = mesh_udims(mesh), mesh.usable_triangles(), mesh.triangles_with_uv()
    assert len(whole[0]) > 4
    assert 50 > whole[2].sum() > whole[1].sum() > 0

    monkeypatch.setattr(domain_mesh, "_AT_ONCE", 7)

    assert mesh_udims(mesh) == whole[0]
    np.testing.assert_array_equal(mesh.usable_triangles(), whole[1])
    np.testing.assert_array_equal(mesh.triangles_with_uv(), whole[2])
