"""A painted map between its texel centres, and at what takes its stretch from a triangle."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from reference.inputs import Array, Indices
from reference.locate import depth_inside, nearest_on_triangle


def bilinear(map: ArrayLike, local: ArrayLike) -> Array:
    """(P,) of a map (h, w), row 0 at v = 1, at points (P, 2) local to its UDIM; beyond the
    outermost centres the map goes on unchanged."""
    texels = np.asarray(map, np.float64)
    height, width = texels.shape
    found = []
    for u, v in np.asarray(local, np.float64):
        x = min(max(u * width - 0.5, 0.0), width - 1.0)
        y = min(max((1 - v) * height - 0.5, 0.0), height - 1.0)
        columns, rows = np.arange(width), np.arange(height)
        across = np.maximum(1 - np.abs(columns - x), 0.0)  # hats, one per texel
        down = np.maximum(1 - np.abs(rows - y), 0.0)
        found.append(down @ texels @ across)
    return np.array(found)


def at_elements(
    maps: dict[int, Array], points: ArrayLike, triangle: Indices, triangle_uv: Array
) -> Array:
    """(P,) at elements centred on points (P, 2), UDIM included, of triangles (P,), -1 for none: at
    the point of the triangle that is closest. A UDIM without a map is 1. On a border, or within
    1e-6 of it, a point is of the UDIM on whose side the middle of the triangle is."""
    found = np.ones(len(triangle))
    for i in np.flatnonzero(triangle >= 0):
        corners = triangle_uv[triangle[i]]
        point = np.asarray(points, np.float64)[i : i + 1]
        inside = depth_inside(point, corners)[0] >= 0
        at = (point if inside else nearest_on_triangle(point, corners)[0])[0]
        corner = np.array([cell(*pair) for pair in zip(at, corners.mean(axis=0), strict=True)])
        map = maps.get(int(1001 + corner[0] + 10 * corner[1]))
        if map is not None:
            found[i] = bilinear(map, [at - corner])[0]
    return found


def cell(at: float, middle: float) -> float:
    """The whole number below a coordinate; of one on a whole number, that below `middle`."""
    border = np.round(at)
    if abs(at - border) > 1e-6:
        return float(np.floor(at))
    return float(border if middle >= border else border - 1)
