"""Sizes and weights of wrinkles and pores, meant on the surface and put into UV.

Pores are ellipses, longer along the lines that meet at them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rhytid.synthesis.fields import SmoothNoise
from rhytid.synthesis.hashes import Words, normals
from rhytid.synthesis.progress import over_rows, row_blocks
from rhytid.synthesis.surface import FloatArray, Surface

Floats = NDArray[np.floating]
Triangles = NDArray[np.integer]
Singles = NDArray[np.float32]
# Half width of a wrinkle in pore spacings: of the faintest, and of one of strength 1.
NARROW, WIDE = 0.20, 0.46
# The weight of an edge that no walker used, and the limit for one of unbounded strength. Half worn
# is HALF times the mean strength; CONTRAST parts the strong from the weak.
FAINTEST, STRONGEST = 0.03, 0.985
HALF, CONTRAST = 1.3, 1.5
# Typical radius of a pore in pore spacings; deviation of its logarithm from one pore to the next
# and by regions of REGION spacings.
PORE_SIZE, PORE_VARIATION = 0.38, 0.22
# Factor of the size of a pore where primary lines meet.
HUB = 1.5
REGION, REGION_VARIATION = 40.0, 0.12
# So that random numbers for one purpose are others than for another.
_SIZE, _DEPTH = 1, 2
Doubles = NDArray[np.float64]
# Wrinkles whose values are added up at pores at a time: what is computed on the way stays in the
# cache, and in memory that was used before. Fresh memory takes longer than the sums.
_AT_ENDS = 1 << 14
# How much longer than wide a pore is whose lines all run one way; where they run all ways it is as
# long as wide. Deviation of the logarithm of that from one pore to the next, and of the angle.
ALONG, LENGTH_VARIATION, TILT = 0.8, 0.12, np.radians(12.0)
# So that random numbers for one purpose are others than for another.
_LENGTH, _TILT = 3, 4


def edge_weights(strength: Floats, mean: float) -> Singles:
    """(E,) weights in (0, 1) from strengths (E,): few strong, many weak.

    mean: of the strengths of drawn edges on even skin.
    """
    worn = strength / (strength + HALF * mean)
    weights: Singles = (FAINTEST + (STRONGEST - FAINTEST) * worn**CONTRAST).astype(np.float32)
    return weights


def widths(weight: Floats, spacing: float) -> Singles:
    """(E,) half widths on the surface, in units of `spacing`'s: the larger the weight the wider."""
    half: Singles = ((NARROW + (WIDE - NARROW) * weight) * spacing).astype(np.float32)
    return half


def half_widths_uv(surface: Surface, triangle: Triangles, step: Floats, width: Floats) -> Singles:
    """(E,) half widths in UV of lines along `step` (E, 2) that are `width` (E,) on the surface.

    A strip of UV length 1 and UV width w covers the area w·sqrt(det JᵀJ) of the surface and is
    |Jθ| long there, θ = step/|step|: so w = width · |Jθ| / sqrt(det JᵀJ). At most 1.
    """
    half = np.empty(len(triangle), np.float32)

    def find(rows: slice) -> None:
        along = step[rows].astype(np.float64)
        stretched = np.linalg.norm(surface.along(triangle[rows], along), axis=-1)
        stretched /= np.linalg.norm(along, axis=-1) * surface.density[triangle[rows]]
        half[rows] = np.minimum(width[rows] * stretched, 1.0)

    over_rows(len(triangle), find)
    return half


def pore_sizes(position: FloatArray, spacing: float, key: Words, seed: int) -> Singles:
    """(N,) radii in PORE_SIZE spacings: log-normal, with regions of larger and of smaller pores.

    position (N, 3): of each, in the unit of the spacing.  key (N,): a random word of each pore.
    """
    noise = SmoothNoise(REGION, np.random.default_rng([seed, _SIZE]))
    sizes = np.empty(len(position), np.float32)

    def find(rows: slice) -> None:
        deviation = np.float32(REGION_VARIATION) * noise.at(position[rows] / spacing)
        deviation += np.float32(PORE_VARIATION) * normals(key[rows], _SIZE, seed)
        sizes[rows] = np.exp(np.clip(deviation, -0.7, 0.7))

    over_rows(len(position), find)
    return sizes


def pore_weights(
    nodes: NDArray[np.integer],
    weight: Floats,
    usual: float,
    sizes: Floats,
    key: Words,
    seed: int,
) -> Singles:
    """(N,) weights of pores in (0, 1]: high where strong wrinkles meet, and where the pore is
    large.

    nodes (E, 2), weight (E,): of the wrinkles; nodes from N on are no pores.  usual: sum of the
    weights that meet at a pore of even skin.  sizes (N,): radii of the pores over the usual radius.
    key (N,): a random word of each pore.
    """
    count = len(sizes)
    total = np.zeros((2, count))

    def add(side: slice) -> None:
        for rows in row_blocks(len(nodes), _AT_ENDS):
            at = nodes[rows, side.start]
            np.add.at(total[side.start], at[at < count], weight[rows][at < count])

    over_rows(2, add, each=1)
    meeting = total[0] + total[1]
    meeting /= meeting + 2.0 * usual
    strengths = np.empty(count, np.float32)

    def find(rows: slice) -> None:
        chance = np.exp(np.float32(0.35) * normals(key[rows], _DEPTH, seed))
        chance *= np.sqrt(sizes[rows])
        strengths[rows] = np.clip(0.6 * meeting[rows] * chance, FAINTEST, 1.0)

    over_rows(count, find)
    return strengths


def pore_axes(
    surface: Surface,
    triangle: Triangles,
    nodes: Triangles,
    step: Floats,
    weight: Floats,
    key: Words,
    seed: int,
) -> tuple[Doubles, Doubles]:
    """Angles (N,) of the long axes of pores, and their ratios (N,) of length to width.

    Angles are in the tangent plane, from ∂X/∂u towards ∂X/∂v.  triangle, key (N,): the triangle and
    a random word of each pore.  nodes, step (E, 2), weight (E,): of the wrinkles; a wrinkle that
    ends at a node from N on, beyond a border, does not count.
    """
    count, tiny = len(triangle), np.finfo(np.float64).tiny
    cosine, sine, total = _axes_at_ends(_frames(surface), triangle, nodes, step, weight)
    angle, longer = np.empty(count), np.empty(count)

    def find(rows: slice) -> None:
        together = np.hypot(cosine[rows], sine[rows]) / np.maximum(total[rows], tiny)
        chance = np.clip(LENGTH_VARIATION * normals(key[rows], _LENGTH, seed), -0.3, 0.3)
        tilt = TILT * np.clip(normals(key[rows], _TILT, seed), -3, 3)
        angle[rows] = 0.5 * np.arctan2(sine[rows], cosine[rows]) + tilt
        longer[rows] = np.maximum((1.0 + ALONG * together) * np.exp(chance), 1.0)

    over_rows(count, find)
    return angle, longer


def _axes_at_ends(
    frames: Doubles, triangle: Triangles, nodes: Triangles, step: Floats, weight: Floats
) -> Doubles:
    """(3, N) sums over the wrinkles at each pore: of weight times the cosine and the sine of twice
    their angle, and of weight."""
    sums = [np.zeros((3, len(triangle))) for _ in range(2)]

    def add(side: slice) -> None:
        for rows in row_blocks(len(nodes), _AT_ENDS):
            whole = np.flatnonzero((nodes[rows] < len(triangle)).all(axis=1))
            at, heavy = nodes[rows, side.start][whole], weight[rows][whole].astype(np.float64)
            x, y = _in_frame(frames[triangle[at]], step[rows][whole].astype(np.float64)).T
            share = heavy / np.maximum(x * x + y * y, np.finfo(np.float64).tiny)
            values = share * (x * x - y * y), share * 2.0 * x * y, heavy
            for total, value in zip(sums[side.start], values, strict=True):
                np.add.at(total, at, value)

    over_rows(2, add, each=1)
    both: Doubles = sums[0]
    both += sums.pop()
    return both


def pore_ellipses(
    surface: Surface,
    triangle: Triangles,
    radius: Floats,
    angle: Floats,
    longer: Floats,
) -> tuple[Singles, Singles]:
    """UV metrics (N, 3) and UV radii (N,) of pores that are ellipses on the surface.

    angle, longer (N,): the results of `pore_axes`.  radius (N,): of circles as large. With the map
    B from steps in UV to the tangent plane and the ellipse E there, the rim |E B d| = 1 is dᵀ(BᵀEᵀE
    B)d = 1. The circle of the same area in UV is the radius. No pore reaches as far as 1 in UV.
    """
    metric, circle = np.empty((len(radius), 3), np.float32), np.empty(len(radius), np.float32)
    frames = _frames(surface)

    def find(rows: slice) -> None:
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

    over_rows(len(radius), find)
    return metric, circle


def _frames(surface: Surface) -> Doubles:
    """(F, 3) numbers (a, b, d) of each triangle: a step (u, v) in UV is (a u + b v, d v) on the
    surface, in axes along ∂X/∂u and square to it."""
    u, v = surface.jacobian.transpose(2, 0, 1)
    length = np.linalg.norm(u, axis=-1)
    per_length = np.divide(1.0, length, out=np.zeros_like(length), where=length > 0)
    return np.stack([length, (u * v).sum(-1) * per_length, surface.density * per_length], axis=-1)


def _in_frame(frame: Doubles, step: Doubles) -> Doubles:
    found: Doubles = np.stack(
        [frame[:, 0] * step[:, 0] + frame[:, 1] * step[:, 1], frame[:, 2] * step[:, 1]], axis=-1
    )
    return found
