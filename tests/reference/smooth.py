"""Stretch interpolated between UV vertices, by numpy's solvers.

A UV vertex is a vertex of the mesh with one pair of coordinates; its fields are means over its
triangles, weighted by their area in space.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from reference import stretch
from reference.inputs import Array, Indices
from reference.locate import nearest_on_triangle


def corners(faces: ArrayLike, uv: ArrayLike, face_uv: ArrayLike) -> tuple[Indices, Indices]:
    """The vertex of the mesh (W,) of each UV vertex, and the UV vertices (F, 3) of triangles."""
    known: dict[tuple[float, ...], int] = {}
    faces, points = np.asarray(faces), np.asarray(uv, np.float64)[np.asarray(face_uv)]
    keys = [(int(v), *p) for v, p in zip(faces.flat, points.reshape(-1, 2).tolist(), strict=True)]
    index = np.array([known.setdefault(key, len(known)) for key in keys], np.int64)
    return np.array([int(key[0]) for key in known], np.int64), index.reshape(faces.shape)


def tensor_fields(
    positions: ArrayLike,
    faces: ArrayLike,
    uv: ArrayLike,
    face_uv: ArrayLike,
    deformed: ArrayLike,
    limit: float,
) -> tuple[Array, Array]:
    """G and H (W, 2, 2) of the UV vertices: G = JᵀJ, H = Jᵀ(Σ log ρᵢ q̂ᵢq̂ᵢᵀ)J, log ρ clamped."""
    ratios, axes = stretch.stretch(positions, faces, uv, face_uv, deformed)
    logs = stretch.log_stretch(ratios, limit)
    jacobian = stretch.jacobians(positions, faces, uv, face_uv)
    turned = np.swapaxes(jacobian, 1, 2)
    q = stretch.unit(np.einsum("fij,faj->fai", jacobian, axes))
    plane = np.einsum("fa,fai,faj->fij", logs, q, q)
    bad = stretch.degenerate(positions, faces) | stretch.degenerate(uv, face_uv)
    area = np.where(bad, 0.0, np.abs(np.linalg.det(jacobian)) * _area(uv, face_uv))
    owner = corners(faces, uv, face_uv)[1]
    metric, without = mean(turned @ jacobian, area, owner)
    metric[without] = np.eye(2)
    return metric, mean(turned @ plane @ jacobian, area, owner)[0]


def diagonal_fields(logs: Array) -> tuple[Array, Array]:
    """G and H of log stretches (W, 2) along u and v, for models without axes of their own."""
    return np.broadcast_to(np.eye(2), (len(logs), 2, 2)), logs[:, :, None] * np.eye(2)


def uv_logs(
    positions: ArrayLike,
    faces: ArrayLike,
    uv: ArrayLike,
    face_uv: ArrayLike,
    deformed: ArrayLike,
    limit: float,
) -> tuple[Array, Array]:
    """(F, 2) clamped log of |J'e_u| / |J e_u| and the same along v, and areas (F,), 0 where the
    triangle is degenerate."""
    bad = stretch.degenerate(positions, faces) | stretch.degenerate(uv, face_uv)
    flat = np.where(bad[:, None, None], np.eye(2), stretch.edges(uv, face_uv))
    neutral, moved = (stretch.edges(p, faces) @ np.linalg.inv(flat) for p in (positions, deformed))
    lengths = [np.linalg.norm(j, axis=1) for j in (neutral, moved)]
    ratios = np.where(bad[:, None], 1.0, lengths[1] / np.where(bad[:, None], 1.0, lengths[0]))
    area = np.linalg.norm(np.cross(neutral[:, :, 0], neutral[:, :, 1]), axis=-1)
    area *= np.abs(np.linalg.det(flat))
    return stretch.log_stretch(ratios, limit), np.where(bad, 0.0, area)


def mean(values: Array, area: Array, owner: Indices) -> tuple[Array, np.ndarray]:
    """(W, ...) means of values (F, ...) by area (F,), and which UV vertices have none: 0 there."""
    count = int(owner.max()) + 1
    total, weight = np.zeros((count, *values.shape[1:])), np.zeros(count)
    for corner in owner.T:
        np.add.at(total, corner, values * area.reshape(-1, *[1] * (values.ndim - 1)))
        np.add.at(weight, corner, area)
    without = weight == 0
    weight[without] = 1.0
    return total / weight.reshape(-1, *[1] * (values.ndim - 1)), without


def tension(positions: ArrayLike, faces: ArrayLike, deformed: ArrayLike) -> Array:
    """(V,) mean ratio of the lengths of each vertex's edges; an edge counts once."""
    faces = np.asarray(faces)
    pairs = {tuple(sorted(p)) for f in faces.tolist() for p in (f[:2], f[1:], (f[2], f[0]))}
    found: list[list[float]] = [[] for _ in range(len(np.asarray(positions)))]
    neutral, moved = np.asarray(positions, np.float64), np.asarray(deformed, np.float64)
    for a, b in pairs:
        ratio = np.linalg.norm(moved[a] - moved[b]) / np.linalg.norm(neutral[a] - neutral[b])
        found[a].append(float(ratio))
        found[b].append(float(ratio))
    return np.array([np.mean(ratios) if ratios else 1.0 for ratios in found])


def sample(
    points: ArrayLike, triangle: Indices, triangle_uv: Array, owner: Indices, fields: tuple
) -> tuple[Array, Array]:
    """log ρ (P, 2), the larger first, and unit axes (P, 2, 2) at points (P, 2) in UV.

    triangle (P,): -1 is none, which is unstretched. A point outside takes the closest point.
    """
    logs, axes = np.zeros((len(triangle), 2)), np.tile(np.eye(2), (len(triangle), 1, 1))
    forms, held = interpolated(points, triangle, triangle_uv, owner, fields), triangle >= 0
    logs[held], axes[held] = principal(*(form[held] for form in forms))
    return logs, axes


def interpolated(
    points: ArrayLike, triangle: Indices, triangle_uv: Array, owner: Indices, fields: tuple
) -> list[Array]:
    """Fields (W, ...) of UV vertices at points (P, 2) in UV, as for `sample`: (P, ...) each.

    In no triangle the first is 1 and the others 0.
    """
    found = [np.zeros((len(triangle), 2, 2)) for _ in fields]
    found[0][:] = np.eye(2)
    held = triangle >= 0
    corner = owner[triangle[held]]
    weights = barycentric(np.asarray(points, np.float64)[held], triangle_uv[triangle[held]])
    for form, field in zip(found, fields, strict=True):
        form[held] = np.einsum("pk,pkij->pij", weights, field[corner])
    return found


def barycentric(points: Array, triangles: Array) -> Array:
    """(P, 3) weights of points (P, 2) in a triangle each, (P, 3, 2), or outside of it those of its
    closest point."""
    columns = np.concatenate([np.swapaxes(triangles, 1, 2), np.ones((len(points), 1, 3))], axis=1)
    weights = _solved(columns, points)
    out = (weights < 0).any(axis=1)
    weights[out] = _solved(columns[out], nearest_on_triangle(points[out], triangles[out])[0])
    return weights


def _solved(columns: Array, points: Array) -> Array:
    values = np.concatenate([points, np.ones((len(points), 1))], axis=1)
    found: Array = np.linalg.solve(columns, values[..., None])[..., 0]
    return found


def principal(metric: Array, log_stretch: Array) -> tuple[Array, Array]:
    """λ (P, 2), the larger first, and unit vectors s (P, 2, 2) with H s = λ G s."""
    inverse = np.linalg.inv(np.linalg.cholesky(metric))
    turned = np.swapaxes(inverse, 1, 2)
    values, vectors = np.linalg.eigh(inverse @ log_stretch @ turned)
    return values[:, ::-1], stretch.unit(np.swapaxes(turned @ vectors, 1, 2)[:, ::-1])


def _area(uv: ArrayLike, face_uv: ArrayLike) -> Array:
    area: Array = np.abs(np.linalg.det(stretch.edges(uv, face_uv)))
    return area
