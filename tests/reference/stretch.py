"""The stretch tensor of every triangle (section 2.2) by numpy's SVD."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from reference.inputs import Array

DEGENERATE = 1e-7


def stretch(
    positions: ArrayLike,
    faces: ArrayLike,
    uv: ArrayLike,
    face_uv: ArrayLike,
    deformed: ArrayLike,
) -> tuple[Array, Array]:
    """Ratios (F, 2), ρ₁ >= ρ₂ >= 0, and unit axes in UV (F, 2, 2), axes[f, i] = ŝᵢ.

    positions, deformed: (V, 3).  faces: (F, 3).  uv: (T, 2).  face_uv: (F, 3).

    F = E'A⁻¹ takes the neutral triangle, in a frame of its own plane, to the deformed one. The
    deformed edges stay in space: a frame of their plane would be one more isometry, which changes
    neither singular values nor right vectors, and this way a triangle that collapses under the
    deformation needs no rule: it has ρ₂ = 0, or ρ = (0, 0), along good axes.

    What counts as degenerate is the neutral triangle, in space or in UV: ρ = (1, 1) and axes
    (1, 0), (0, 1), whatever the deformation does to it.
    """
    bad = degenerate(positions, faces) | degenerate(uv, face_uv)
    plane = np.where(bad[:, None, None], np.eye(2), _plane_edges(positions, faces))
    to_plane = np.linalg.inv(plane)
    _, ratios, right = np.linalg.svd(edges(deformed, faces) @ to_plane, full_matrices=False)
    axes = unit(right @ np.swapaxes(edges(uv, face_uv) @ to_plane, 1, 2), skip=bad)
    ratios[bad] = 1.0
    axes[bad] = np.eye(2)
    return ratios, axes


def jacobians(positions: ArrayLike, faces: ArrayLike, uv: ArrayLike, face_uv: ArrayLike) -> Array:
    """(F, 2, 2) J: from UV to a frame of the neutral plane; the identity where degenerate.

    What `angles: "surface"` turns UV directions with.
    """
    bad = (degenerate(positions, faces) | degenerate(uv, face_uv))[:, None, None]
    flat_uv = np.where(bad, np.eye(2), edges(uv, face_uv))
    jacobian: Array = np.where(bad, np.eye(2), _plane_edges(positions, faces)) @ np.linalg.inv(
        flat_uv
    )
    return jacobian


def log_stretch(ratios: ArrayLike, limit: float) -> Array:
    """r = log ρ, clamped to ±limit; ρ = 0 gives -limit."""
    clamped: Array = np.clip(_log(ratios), -limit, limit)
    return clamped


def percentile90(ratios: ArrayLike) -> float:
    """90th percentile (linear) of |log ρ| over all triangles and both axes, unclamped.

    Infinite where more than a tenth of the ratios are 0; `np.percentile` would give NaN there.
    """
    ordered = np.sort(np.abs(_log(ratios)), axis=None)
    whole, part = divmod(0.9 * (ordered.size - 1), 1.0)
    low = ordered[int(whole)]
    return float(low if part == 0 else (1 - part) * low + part * ordered[int(whole) + 1])


def calibrated_r_max(ratios: ArrayLike, limit: float) -> float:
    """The percentile above, kept within [0.01, limit]: an infinite one becomes `limit`."""
    return min(max(percentile90(ratios), 0.01), limit)


def degenerate(points: ArrayLike, faces: ArrayLike) -> np.ndarray:
    """(F,) true where the area is below 1e-7 of the longest edge squared, or nothing is there."""
    corners = np.asarray(points, np.float64)[np.asarray(faces)]
    longest = np.square(corners - np.roll(corners, 1, axis=1)).sum(-1).max(-1)
    # In E = QR the diagonal of R is one edge and the height above it: twice the area, in 2D and 3D.
    diagonal = np.linalg.qr(edges(points, faces), mode="r").diagonal(axis1=1, axis2=2)
    area = 0.5 * np.abs(diagonal.prod(-1))
    return np.asarray((area < DEGENERATE * longest) | (longest == 0))


def edges(points: ArrayLike, faces: ArrayLike) -> Array:
    """(F, k, 2): the two edges from the first corner, as columns."""
    corners = np.asarray(points, np.float64)[np.asarray(faces)]
    return np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=-1)


def unit(vectors: Array, skip: np.ndarray | None = None) -> Array:
    """Rows of length one; rows of the triangles in `skip` are left as they are."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    if skip is not None:
        length[skip] = 1.0
    return vectors / length


def _plane_edges(positions: ArrayLike, faces: ArrayLike) -> Array:
    """(F, 2, 2) A: the same two edges in an orthonormal frame of the triangle (the Q of QR)."""
    return np.linalg.qr(edges(positions, faces), mode="r")


def _log(ratios: ArrayLike) -> Array:
    with np.errstate(divide="ignore"):
        logs: Array = np.log(np.asarray(ratios, np.float64))
    return logs
