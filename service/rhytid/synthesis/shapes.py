"""How strong, wide and round things are: weights, and sizes meant on the surface put into UV."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rhytid.synthesis.arrays import row_blocks
from rhytid.synthesis.fields.directions import SmoothNoise
from rhytid.synthesis.hashes import Words, normals
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


def edge_weights(strength: Floats, mean: float) -> Singles:
    """(E,) weights in (0, 1): few strong, many weak.  mean: of all strengths on even skin."""
    worn = strength / (strength + HALF * mean)
    weights: Singles = (FAINTEST + (STRONGEST - FAINTEST) * worn**CONTRAST).astype(np.float32)
    return weights


def widths(weight: Floats, spacing: float) -> Singles:
    """(E,) half widths on the surface: the stronger the wider."""
    half: Singles = ((NARROW + (WIDE - NARROW) * weight) * spacing).astype(np.float32)
    return half


def half_widths_uv(surface: Surface, triangle: Triangles, step: Floats, width: Floats) -> Singles:
    """(E,) half widths in UV of lines along `step` (E, 2) that are `width` (E,) on the surface.

    A strip of UV length 1 and UV width w covers the area w·sqrt(det JᵀJ) of the surface and is
    |Jθ| long there, θ = step/|step|: so w = width · |Jθ| / sqrt(det JᵀJ). At most 1.
    """
    half = np.empty(len(triangle), np.float32)
    for rows in row_blocks(len(triangle)):
        along = step[rows].astype(np.float64)
        stretched = np.linalg.norm(surface.along(triangle[rows], along), axis=-1)
        stretched /= np.linalg.norm(along, axis=-1) * surface.density[triangle[rows]]
        half[rows] = np.minimum(width[rows] * stretched, 1.0)
    return half


def pore_sizes(position: FloatArray, key: Words, seed: int) -> Singles:
    """(N,) radii in PORE_SIZE spacings: log-normal, with regions of larger and of smaller pores.

    position (N, 3): in spacings.  key (N,): a word of each pore.
    """
    noise = SmoothNoise(REGION, np.random.default_rng([seed, _SIZE]))
    deviation = np.float32(REGION_VARIATION) * noise.at(position)
    deviation += np.float32(PORE_VARIATION) * normals(key, _SIZE, seed)
    sizes: Singles = np.exp(np.clip(deviation, -0.7, 0.7))
    return sizes


def pore_weights(
    nodes: NDArray[np.integer],
    weight: Floats,
    usual: float,
    sizes: Floats,
    key: Words,
    seed: int,
) -> Singles:
    """(N,) strengths in (0, 1]: deep where strong wrinkles meet, and where the pore is large.

    nodes (E, 2), weight (E,): the wrinkles; nodes from N on are no pores.  usual: sum of the
    weights that meet at a pore of even skin.
    sizes (N,): the radii of the pores, over that which is usual.  key (N,): a word of each.
    """
    count = len(sizes)
    total = sum(np.bincount(end, weights=weight, minlength=count)[:count] for end in nodes.T)
    meeting = total / (total + 2.0 * usual)
    chance = np.exp(np.float32(0.35) * normals(key, _DEPTH, seed))
    chance *= np.sqrt(sizes)
    strengths: Singles = np.clip(0.6 * meeting * chance, FAINTEST, 1.0).astype(np.float32)
    return strengths
