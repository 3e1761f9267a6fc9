"""What pores look like on the surface: ellipses, longer along the lines that meet at them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rhytid.synthesis.arrays import row_blocks
from rhytid.synthesis.hashes import Words, normals
from rhytid.synthesis.surface import Surface

Floats = NDArray[np.floating]
Doubles = NDArray[np.float64]
Triangles = NDArray[np.integer]
Singles = NDArray[np.float32]

# How much longer than wide a pore is whose lines all run one way; where they run all ways it is as
# long as wide. Deviation of the logarithm of that from one pore to the next, and of the angle.
ALONG, LENGTH_VARIATION, TILT = 0.8, 0.12, np.radians(12.0)
# So that random numbers for one purpose are others than for another.
_LENGTH, _TILT = 3, 4


def pore_axes(
    surface: Surface,
    triangle: Triangles,
    nodes: Triangles,
    step: Floats,
    weight: Floats,
    key: Words,
    seed: int,
) -> tuple[Doubles, Doubles]:
    """Angles (N,) of the long axes of pores, and how many times as long as wide they are (N,).

    Angles are in the tangent plane, from ∂X/∂u towards ∂X/∂v. triangle, key (N,): the triangle of
    each pore, and a word.  nodes, step (E, 2), weight (E,): the wrinkles; those that end at a node
    from N on, beyond a border, do not count.
    """
    count = len(triangle)
    whole = (nodes < count).all(axis=1)
    nodes, step, weight = nodes[whole], step[whole], weight[whole].astype(np.float64)
    frames = _frames(surface)
    cosine, sine, total = (np.zeros(count) for _ in range(3))
    for end in nodes.T:
        x, y = _in_frame(frames[triangle[end]], step.astype(np.float64)).T
        share = weight / np.maximum(x * x + y * y, np.finfo(np.float64).tiny)
        cosine += np.bincount(end, share * (x * x - y * y), count)
        sine += np.bincount(end, share * 2.0 * x * y, count)
        total += np.bincount(end, weight, count)
    together = np.hypot(cosine, sine) / np.maximum(total, np.finfo(np.float64).tiny)
    chance = np.clip(LENGTH_VARIATION * normals(key, _LENGTH, seed), -0.3, 0.3)
    angle = 0.5 * np.arctan2(sine, cosine) + TILT * np.clip(normals(key, _TILT, seed), -3, 3)
    longer: Doubles = np.maximum((1.0 + ALONG * together) * np.exp(chance), 1.0)
    return angle, longer


def pore_ellipses(
    surface: Surface,
    triangle: Triangles,
    radius: Floats,
    angle: Floats,
    longer: Floats,
) -> tuple[Singles, Singles]:
    """UV metrics (N, 3) and UV radii (N,) of pores that are ellipses on the surface.

    angle, longer (N,): as of `pore_axes`; as large as circles of `radius` (N,). With the map B from
    steps in UV to the tangent plane and the ellipse E there, the rim |E B d| = 1 is
    dᵀ(BᵀEᵀE B)d = 1. The circle of the same area in UV is the radius. No pore reaches as far as 1
    in UV.
    """
    metric, circle = np.empty((len(radius), 3), np.float32), np.empty(len(radius), np.float32)
    frames = _frames(surface)
    for rows in row_blocks(len(radius)):
        at = triangle[rows]
        most, root = 0.9 * surface.narrowest[at], np.sqrt(longer[rows])
        long = np.minimum(radius[rows] * root, most)
        wide = np.minimum(radius[rows] / root, most)
        c, s = np.cos(angle[rows]), np.sin(angle[rows])
        (a, b), d = frames[at, :2].T, frames[at, 2]
        # Rows of E B: along the long axis over its length, and across over its width.
        along, across = (
            (np.stack([p * a, p * b + q * d]) / r) for p, q, r in ((c, s, long), (-s, c, wide))
        )
        metric[rows] = np.stack(
            [along[i] * along[j] + across[i] * across[j] for i, j in ((0, 0), (0, 1), (1, 1))], -1
        )
        circle[rows] = np.sqrt(long * wide / surface.density[at])
    return metric, circle


def _frames(surface: Surface) -> Doubles:
    """(F, 3) of each triangle (a, b, d): a step (u, v) in UV is (a u + b v, d v) on the surface, in
    axes along ∂X/∂u and square to it."""
    u, v = surface.jacobian.transpose(2, 0, 1)
    length = np.linalg.norm(u, axis=-1)
    per_length = np.divide(1.0, length, out=np.zeros_like(length), where=length > 0)
    return np.stack([length, (u * v).sum(-1) * per_length, surface.density * per_length], axis=-1)


def _in_frame(frame: Doubles, step: Doubles) -> Doubles:
    found: Doubles = np.stack(
        [frame[:, 0] * step[:, 0] + frame[:, 1] * step[:, 1], frame[:, 2] * step[:, 1]], axis=-1
    )
    return found
