"""Normal maps from slopes, texel by texel: the unit vector (x, y, z) by which x T + y B + z N is
the normal of the relief, with N and T interpolated between the corners of a triangle, neither of
unit length nor orthogonal, and B = sign N x T."""

from __future__ import annotations

import numpy as np

from reference.inputs import Array, Indices
from reference.slopes import Surface, unit


def normals(slopes: Array, inside: Array, triangles: Indices, mesh: Surface) -> Array:
    """(R, R, 3); (0, 0, 1) where no triangle is.  slopes, inside: of `reference.slopes`."""
    side = len(triangles)
    out = np.zeros((side, side, 3))
    out[..., 2] = 1.0
    for row, column in np.argwhere(inside):
        f = triangles[row, column]
        first, *ends = mesh.uv[f]
        at = np.array([(column + 0.5) / side, 1.0 - (row + 0.5) / side])
        two = np.linalg.solve(np.stack([end - first for end in ends], axis=1), at - first)
        share = np.clip([1.0 - two.sum(), *two], 0.0, None)
        share /= share.sum()
        mean, tangent = share @ mesh.normals[f], share @ mesh.tangents[f]
        normal = unit(mean)
        along = unit(tangent - (tangent @ normal) * normal)
        across = mesh.signs[f] * np.cross(normal, along)
        relief = normal - slopes[row, column, 0] * along - slopes[row, column, 1] * across
        frame = np.stack([tangent, mesh.signs[f] * np.cross(mean, tangent), mean], axis=1)
        out[row, column] = unit(np.linalg.solve(frame, relief))
    return out
