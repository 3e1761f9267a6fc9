"""Slopes of a relief on a surface, texel by texel, in the tangent frame of normal maps, and their
moments over larger texels: the means of the slopes and of their products.

A slope is g in the plane of the interpolated normal n: the gradient of the heights on the triangle,
by the axes dP/du and what is across it, which are turned into that plane. Its parts are along T,
the interpolated tangent (MikkTSpace) in that plane, and B = sign n x T.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np

from reference.inputs import Array, Indices

_INSIDE = -1e-4


class Surface(NamedTuple):
    """Corners of triangles: places (F, 3, 3), uv (F, 3, 2) of the UDIM from 0 to 1, normals and
    tangents (F, 3, 3), islands (F,) by shared coordinates, signs (F,) of the area in UV."""

    places: Array
    uv: Array
    normals: Array
    tangents: Array
    islands: Indices
    signs: Array


def unit(vector: Array) -> Array:
    """Of length 1."""
    found: Array = vector / np.linalg.norm(vector)
    return found


def surface(positions: Array, faces: Indices, uv: Array, face_uv: Indices) -> Surface:
    """Normals are means of triangles by their angles at one place, tangents means of dP/du by the
    angles in the plane of the normal, where place, UV and side agree."""
    places, coords = np.asarray(positions, np.float64)[faces], np.asarray(uv, np.float64)[face_uv]
    normal_of: dict[tuple[float, ...], Array] = {}
    for corners in places:
        normal = unit(np.cross(corners[1] - corners[0], corners[2] - corners[0]))
        for k, one in enumerate(corners):
            ends = [unit(corners[(k + step) % 3] - one) for step in (1, 2)]
            angle = np.arccos(ends[0] @ ends[1])
            normal_of[tuple(one)] = normal_of.get(tuple(one), 0.0) + normal * angle
    normals = np.array([[unit(normal_of[tuple(one)]) for one in corners] for corners in places])
    tangent_of: dict[tuple[float, ...], Array] = {}
    keys, signs = [], []
    for corners, coord, own in zip(places, coords, normals, strict=True):
        du, _ = derivatives(corners, coord)
        sign = np.sign(np.linalg.det(coord[1:] - coord[0]))
        signs.append(sign)
        for k, (one, at, normal) in enumerate(zip(corners, coord, own, strict=True)):
            ends = [corners[(k + step) % 3] - one for step in (1, 2)]
            ends = [unit(end - (end @ normal) * normal) for end in ends]
            key = (*one, *at, sign)
            flat = unit(unit(du) - (unit(du) @ normal) * normal)
            tangent_of[key] = tangent_of.get(key, 0.0) + flat * np.arccos(ends[0] @ ends[1])
            keys.append(key)
    tangents = np.array([unit(tangent_of[key]) for key in keys]).reshape(-1, 3, 3)
    return Surface(places, coords, normals, tangents, _islands(coords), np.array(signs))


def derivatives(corners: Array, coord: Array) -> tuple[Array, Array]:
    """dP/du and dP/dv of a triangle."""
    du, dv = np.linalg.solve(coord[1:] - coord[0], corners[1:] - corners[0])
    return du, dv


def _islands(coords: Array) -> Indices:
    number = np.arange(len(coords))
    for _ in coords:
        owner: dict[tuple[float, ...], int] = {}
        for f, corner in itertools.product(range(len(coords)), range(3)):
            at = tuple(coords[f, corner])
            owner[at] = min(owner.get(at, number[f]), number[f])
        new = np.array([min(owner[tuple(at)] for at in coord) for coord in coords])
        if (new == number).all():
            return number
        number = new
    return number


def slopes(heights: Array, triangles: Indices, mesh: Surface) -> tuple[Array, Array]:
    """(R, R, 2) slopes of texels, 0 outside, and (R, R) which lie in their triangle.

    heights (R, R), row 0 at the top.  triangles (R, R), the number of triangles for none.
    Differences are over two texels; over one where a neighbour is of another island, beyond the
    border, or in none of the triangles while the other is.
    """
    side, none = len(heights), len(mesh.places)
    inside = np.zeros((side, side), bool)
    weights = np.zeros((side, side, 3))
    for f in range(none):
        row, column = np.nonzero(triangles == f)
        first, *ends = mesh.uv[f]
        at = np.stack([(column + 0.5) / side, 1.0 - (row + 0.5) / side], axis=1)
        two = np.linalg.solve(np.stack([end - first for end in ends], axis=1), (at - first).T).T
        weights[row, column] = np.column_stack([1.0 - two.sum(axis=1), two])
        inside[row, column] = weights[row, column].min(axis=1) >= _INSIDE
    island = np.where(triangles < none, np.append(mesh.islands, -1)[triangles], -1)
    rises = np.stack([_rise(heights, island, inside, *way) for way in ((0, 1), (-1, 0))], axis=-1)
    out = np.zeros((side, side, 2))
    for f in range(none):
        here = inside & (triangles == f)
        share = weights[here]
        du, dv = derivatives(mesh.places[f], mesh.uv[f])
        along = unit(du)
        across = unit(dv - (dv @ along) * along)
        axes = np.stack([along, across])
        parts = np.linalg.solve(np.stack([axes @ du, axes @ dv]), rises[here].T * side).T
        for k, at in enumerate(np.argwhere(here)):
            normal, tangent = unit(share[k] @ mesh.normals[f]), share[k] @ mesh.tangents[f]
            first = unit(along - (along @ normal) * normal)
            second = mesh.signs[f] * np.cross(normal, first)
            t = unit(tangent - (tangent @ normal) * normal)
            gradient = parts[k, 0] * first + parts[k, 1] * second
            out[tuple(at)] = gradient @ t, gradient @ (mesh.signs[f] * np.cross(normal, t))
    return out, inside


def _rise(heights: Array, island: Indices, inside: Array, dy: int, dx: int) -> Array:
    """(R, R) how much higher a step by (dy, dx) is, per texel."""
    side = len(heights)
    out = np.zeros((side, side))
    for row, column in np.argwhere(inside):
        found = []
        for way in (1, -1):
            y, x = row + way * dy, column + way * dx
            if 0 <= y < side and 0 <= x < side and island[y, x] == island[row, column]:
                found.append((inside[y, x], way * (heights[y, x] - heights[row, column])))
        best = [value for good, value in found if good] or [value for _, value in found]
        out[row, column] = sum(best) / len(best) if best else 0.0
    return out


def moments(slopes: Array, inside: Array, level: int) -> Array:
    """(R >> level, R >> level, 5): means of x, y, xx, xy, yy over those of the 2^level squared
    texels that are inside; 0 where none is."""
    step = 1 << level
    side = len(slopes) >> level
    out = np.zeros((side, side, 5))
    for row, column in np.ndindex(side, side):
        block = np.s_[row * step : (row + 1) * step, column * step : (column + 1) * step]
        x, y = slopes[block][inside[block]].T
        if len(x):
            out[row, column] = [part.mean() for part in (x, y, x * x, x * y, y * y)]
    return out
