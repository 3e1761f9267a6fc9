"""The tensor of log stretch, against one triangle after another in float64."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from exports.textures.patches import FloatArray, all_triangles, curved, grid_mesh
from meshes import bumpy_grid, deform
from reference.hencky import hencky, turning
from reference.stretch import stretch
from rhytid.domain.mesh import Mesh
from rhytid.exports.textures.frame_map import Chart, VertexField
from rhytid.exports.textures.stretch import (
    MOST,
    Corners,
    _components,
    stretch_map,
    vertex_stretch,
)
from rhytid.exports.textures.tangents import Posed

SIDE = 64


def field_of(mesh: Mesh, positions: NDArray[np.float32]) -> tuple[Posed, VertexField]:
    posed = Posed.of(mesh, positions)
    ratios, axes = stretch(mesh.positions, mesh.faces, mesh.uv, mesh.face_uv, positions)
    return posed, vertex_stretch(mesh, posed, ratios.astype(np.float32), axes.astype(np.float32))


def shown(mesh: Mesh, positions: NDArray[np.float32], side: int = SIDE) -> NDArray[np.float32]:
    chart = Chart.of(mesh, 1001, all_triangles(mesh, side))
    return stretch_map(chart, *field_of(mesh, positions))


def flat(u: FloatArray, v: FloatArray, angle: float = 0.3, shear: float = 0.0) -> FloatArray:
    """A plane under straight UV, turned in space."""
    x, y = u + shear * v, 0.7 * v
    return np.stack([x * np.cos(angle), x * np.sin(angle), y], axis=-1)


@pytest.mark.parametrize("mirrored", [False, True])
def test_an_even_stretch_in_the_tangent_frame(mirrored: bool) -> None:
    """1.5 times along 30 degrees from T to B at rest, 0.8 times across; then turned in space."""
    mesh = grid_mesh(flat, 4, mirrored=mirrored)
    degrees = -30.0 if mirrored else 30.0
    u, v = flat(np.array(1.0), np.array(0.0)), np.array([0.0, 0.0, 1.0])
    axis = np.cos(np.radians(degrees)) * u + np.sin(np.radians(degrees)) * v
    other = np.cos(np.radians(degrees)) * v - np.sin(np.radians(degrees)) * u
    pulled = mesh.positions @ (1.5 * np.outer(axis, axis) + 0.8 * np.outer(other, other))
    moved = (pulled @ turning([1, 0, 0], [0.6, 0.0, 0.8]).T).astype(np.float32)

    tt, bb, tb = np.moveaxis(shown(mesh, moved), -1, 0)

    mean, half = (tt + bb) / 2, np.hypot((tt - bb) / 2, tb)
    np.testing.assert_allclose(mean + half, np.log(1.5), atol=2e-6)
    np.testing.assert_allclose(mean - half, np.log(0.8), atol=2e-6)
    # T is drawn towards the axis with the skin. Mirrored, T turns over and B does not.
    wanted = np.degrees(np.arctan2(0.8 * np.sin(np.pi / 6), 1.5 * np.cos(np.pi / 6)))
    found = np.degrees(0.5 * np.arctan2(2 * tb, tt - bb))
    np.testing.assert_allclose(found, wanted, atol=2e-3)


def unit(vector: FloatArray) -> FloatArray:
    return vector / np.linalg.norm(vector)


def by_hand(mesh: Mesh, moved: NDArray[np.float32], normals: FloatArray) -> FloatArray:
    """(V, 3, 3) means of the triangles around each vertex, turned into its plane."""
    found, sizes = np.zeros((len(mesh.positions), 3, 3)), np.zeros(len(mesh.positions))
    for face in mesh.faces:
        rest, now = mesh.positions[face].astype(np.float64), moved[face].astype(np.float64)
        area = np.linalg.norm(np.cross(rest[1] - rest[0], rest[2] - rest[0]))
        normal = unit(np.cross(now[1] - now[0], now[2] - now[0]))
        for vertex in face:
            turn = turning(normal, normals[vertex])
            found[vertex] += area * turn @ hencky(rest, now, MOST) @ turn.T
            sizes[vertex] += area
    return np.asarray(found / sizes[:, None, None])


def test_vertices_of_a_bent_sheet_have_the_mean_of_their_triangles() -> None:
    small = bumpy_grid()
    mesh, moved = Mesh(*small), deform(small.positions, 4, 0.3)
    posed, field = field_of(mesh, moved)
    normals = np.zeros((len(mesh.positions), 3))
    normals[mesh.faces.reshape(-1)] = posed.normals.reshape(-1, 3)
    wanted = by_hand(mesh, moved, normals)

    nine = field.values[:, 1:][:, [0, 3, 4, 3, 1, 5, 4, 5, 2]].reshape(-1, 3, 3)
    plane = np.eye(3) - normals[:, :, None] * normals[:, None, :]
    of_vertex = np.zeros(len(mesh.positions), np.int64)
    of_vertex[mesh.faces.reshape(-1)] = field.places.reshape(-1)
    even = field.values[of_vertex, 0][:, None, None]
    np.testing.assert_allclose(nine[of_vertex] + even * plane, wanted, atol=3e-6)
    assert np.abs(wanted).max() > 0.3


def test_both_sides_of_a_seam_show_one_tensor() -> None:
    """At points on the seam, each side brought from its tangents into space."""
    small = bumpy_grid()
    mesh, moved = Mesh(*small), deform(small.positions, 4, 0.3)
    posed, field = field_of(mesh, moved)
    pairs = seam_edges(mesh)
    assert len(pairs) == 10
    share = np.array([0.35, 0.65])
    for (one, first), (two, second) in pairs:
        sides = [
            in_space(posed, field, one, weights_of(first, share)),
            in_space(posed, field, two, weights_of(second, share[::-1])),
        ]
        np.testing.assert_allclose(sides[0], sides[1], atol=1e-9)


def seam_edges(mesh: Mesh) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Pairs of (triangle, corner opposite of the edge) that share an edge in space, not in UV."""
    edges: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for face, corners in enumerate(mesh.faces):
        for corner in range(3):
            ends = sorted((int(corners[corner - 2]), int(corners[corner - 1])))
            edges.setdefault((ends[0], ends[1]), []).append((face, corner))
    joined = [pair for pair in edges.values() if len(pair) == 2]
    apart = [
        (a, b)
        for a, b in joined
        if {mesh.face_uv[a[0], a[1] - 2], mesh.face_uv[a[0], a[1] - 1]}.isdisjoint(
            {mesh.face_uv[b[0], b[1] - 2], mesh.face_uv[b[0], b[1] - 1]}
        )
    ]
    return apart


def weights_of(corner: int, share: FloatArray) -> FloatArray:
    weights = np.zeros((1, 3))
    weights[0, corner - 2], weights[0, corner - 1] = share
    return weights


def in_space(posed: Posed, field: VertexField, face: int, weights: FloatArray) -> FloatArray:
    found = np.array([face], np.int32)
    tt, bb, tb = _components(Corners.of(posed, field), found, weights)[0]
    normal = unit((weights[0, :, None] * posed.normals[face]).sum(axis=0))
    tangent = (weights[0, :, None] * posed.tangents[face]).sum(axis=0)
    t = unit(tangent - normal * (tangent @ normal))
    b = posed.signs[face] * np.cross(normal, t)
    tensor = tt * np.outer(t, t) + bb * np.outer(b, b) + tb * (np.outer(t, b) + np.outer(b, t))
    return np.asarray(tensor)


def test_texels_between_vertices_are_smooth_and_a_collapse_stays_within_the_limit(
    tmp_path: Path,
) -> None:
    mesh = grid_mesh(curved, 8)
    moved = mesh.positions.copy()
    moved[:, 0] += 0.2 * np.sin(3.0 * moved[:, 1])
    values = shown(mesh, moved)
    steps = np.abs(np.diff(values, axis=1)).max()
    assert np.ptp(values) > 0.3
    assert steps < 0.02  # a facet's border would show ten times as much

    moved[30:33] = moved[30]
    assert np.abs(shown(mesh, moved)).max() <= MOST * 1.001
