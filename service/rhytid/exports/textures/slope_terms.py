"""What slopes on the surface are made with, for `pipeline/slopes.py`: the tangent frame and the
metric of each triangle of a frame, and which neighbours of a texel its slope may use. All in
double.

It is the tangent frame of normal maps (`writers.py`), but with unit vectors: T is the interpolated
tangent in the plane of the interpolated normal n, B is sign n x T.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh
from rhytid.exports.textures.frame_map import islands_of, local_edges, texels_inside
from rhytid.exports.textures.tangents import FloatArray, Posed
from rhytid.pipeline.slopes import ABOVE, BELOW, INSIDE, LEFT, RIGHT, TERMS

# Rows that are worked on at once.
_ROWS = 512


def neighbour_codes(mesh: Mesh, udim: int, triangles: NDArray[np.int32]) -> NDArray[np.uint8]:
    """(R, R) codes of the texels of a UDIM, row 0 at the top: whether the centre lies in a
    triangle, and which neighbours count. Those of another island do not; of the same one, those
    outside of its triangles count where there is no other, as for normal maps.

    triangles: (R, R) the triangle of each texel, padding included; the number of triangles for
    none.
    """
    shown = triangles < len(mesh.faces)
    inside = texels_inside(np.where(shown, triangles, 0), local_edges(mesh, udim)) & shown
    if not inside.any():
        inside = shown
    island = np.append(islands_of(mesh), -1).astype(np.int32)
    side = len(triangles)
    out = np.zeros((side, side), np.uint8)
    for start in range(0, side, _ROWS):
        rows = np.arange(start - 1, min(start + _ROWS, side) + 1)
        near, held = rows.clip(0, side - 1), (rows >= 0) & (rows < side)
        here = np.where(held[:, None], island[triangles[near]], -1)
        out[start : start + _ROWS] = _codes(here, inside[near])
    return out


def _codes(island: NDArray[np.int32], inside: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """(h, w) codes of the rows between the first and the last of (h + 2, w)."""
    island = np.pad(island, ((0, 0), (1, 1)), constant_values=-1)
    inside = np.pad(inside, ((0, 0), (1, 1)))
    middle = island[1:-1, 1:-1]
    code: NDArray[np.uint8] = inside[1:-1, 1:-1] * np.uint8(INSIDE)
    pairs = (
        (RIGHT, np.s_[1:-1, 2:], LEFT, np.s_[1:-1, :-2]),
        (ABOVE, np.s_[:-2, 1:-1], BELOW, np.s_[2:, 1:-1]),
    )
    for one, at_one, other, at_other in pairs:
        same = [(island[at] == middle) & (middle >= 0) for at in (at_one, at_other)]
        good = [part & inside[at] for part, at in zip(same, (at_one, at_other), strict=True)]
        any_good = good[0] | good[1]
        for bit, mine, best in zip((one, other), same, good, strict=True):
            code |= np.where(any_good, best, mine) * np.uint8(bit)
    return code


def slope_terms(mesh: Mesh, posed: Posed, side: int) -> NDArray[np.float32]:
    """(F + 1, 32) float32 of the triangles of a frame, as slopes.cl has them; zeros last, for none.

    side: texels per side of level 0. Places are in texels of a plane of all UDIMs, v up.
    """
    uv = mesh.triangle_uv() * side
    first, step_x, step_y = _steps(uv)
    middle = np.floor(uv.mean(axis=1))
    offset = middle - uv[:, 0]
    normal, tangent = (
        _linear(vectors, first, step_x, step_y, offset)
        for vectors in (posed.normals, posed.tangents)
    )
    along = posed.along[:, None]
    terms = np.zeros((len(uv) + 1, TERMS))
    out = terms[:-1]
    out[:, 0:3] = np.sum(along * tangent, axis=-1)
    out[:, 3:6] = np.sum(along * normal, axis=-1)
    out[:, 6:12] = _product(tangent, normal)
    out[:, 12:18] = _product(normal, normal)
    out[:, 18:24] = _product(np.cross(along, tangent), normal) * posed.signs[:, None]
    out[:, 24:27] = _metric(posed, side)
    out[:, 27:29] = middle
    return terms.astype(np.float32)


def _steps(uv: FloatArray) -> tuple[NDArray[np.bool_], FloatArray, FloatArray]:
    """(F, 2) how the second and third barycentric weight change per texel along x and y, and (F,)
    which triangles have an area in UV."""
    b, c = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    area = b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0]
    usable = area != 0.0
    share = np.where(usable, 1.0 / np.where(usable, area, 1.0), 0.0)[:, None]
    along = np.stack([c[:, 1], -b[:, 1]], axis=1) * share
    up = np.stack([-c[:, 0], b[:, 0]], axis=1) * share
    return usable, along, up


def _linear(
    vectors: FloatArray,
    usable: NDArray[np.bool_],
    step_x: FloatArray,
    step_y: FloatArray,
    offset: FloatArray,
) -> FloatArray:
    """(F, 3, 3): a vector at the place `offset` (F, 2) from the first corner, and its changes per
    texel along x and y.  vectors: (F, 3, 3) at the corners."""
    edges = vectors[:, 1:] - vectors[:, :1]
    x, y = (np.einsum("fk,fki->fi", step, edges) for step in (step_x, step_y))
    at = vectors[:, 0] + offset[:, :1] * x + offset[:, 1:] * y
    found: FloatArray = np.stack([at, x, y], axis=1) * usable[:, None, None]
    return found


def _product(one: FloatArray, other: FloatArray) -> FloatArray:
    """(F, 6) the scalar product of two linear vectors (F, 3, 3): 1, x, y, xx, xy, yy."""
    by = np.einsum("fai,fbi->fab", one, other)
    parts = (
        by[:, 0, 0], by[:, 0, 1] + by[:, 1, 0], by[:, 0, 2] + by[:, 2, 0],
        by[:, 1, 1], by[:, 1, 2] + by[:, 2, 1], by[:, 2, 2],
    )  # fmt: skip
    return np.stack(parts, axis=1)


def _metric(posed: Posed, side: int) -> FloatArray:
    """(F, 3): texels per mesh unit along dP/du and across, and the lean of dP/dv; zeros where a
    triangle has no area in space: it is taken as flat."""
    du, lean, dv = posed.scale.T
    flat = (du <= 0.0) | (dv <= 0.0)
    du, dv = (np.where(flat, 1.0, part) for part in (du, dv))
    return np.where(flat[:, None], 0.0, np.stack([side / du, side / dv, lean / dv], axis=1))
