"""How strong, wide and round things are: weights, and sizes meant on the surface put into UV."""

from __future__ import annotations

import numpy as np

from rhytid.synthesis.directions import smooth_noise
from rhytid.synthesis.surface import FloatArray, IntArray, Surface

# Half width of a wrinkle in pore spacings: of the faintest, and of one of strength 1.
NARROW, WIDE = 0.20, 0.46
# The weight of an edge that nobody walked, and of one that is worn without end. Half worn is
# HALF times the mean strength; CONTRAST parts the strong from the weak.
FAINTEST, STRONGEST = 0.03, 0.985
HALF, CONTRAST = 1.3, 1.5
# Typical radius of a pore in pore spacings; deviation of its logarithm from one pore to the next
# and by regions of REGION spacings.
PORE_SIZE, PORE_VARIATION = 0.30, 0.22
REGION, REGION_VARIATION = 40.0, 0.12


def edge_weights(strength: FloatArray) -> FloatArray:
    """(E,) weights in (0, 1): few strong, many weak."""
    worn = strength / (strength + HALF * strength.mean())
    weights: FloatArray = FAINTEST + (STRONGEST - FAINTEST) * worn**CONTRAST
    return weights


def widths(weight: FloatArray, spacing: float) -> FloatArray:
    """(E,) half widths on the surface: the stronger the wider."""
    half: FloatArray = (NARROW + (WIDE - NARROW) * weight) * spacing
    return half


def half_widths_uv(
    surface: Surface, triangle: IntArray, step: FloatArray, width: FloatArray
) -> FloatArray:
    """(E,) half widths in UV of lines along `step` (E, 2) that are `width` (E,) on the surface.

    A strip of UV length 1 and UV width w covers the area w·sqrt(det JᵀJ) of the surface and is
    |Jθ| long there, θ = step/|step|: so w = width · |Jθ| / sqrt(det JᵀJ). At most 1.
    """
    stretched = np.linalg.norm(surface.along(triangle, step), axis=-1)
    along = stretched / np.linalg.norm(step, axis=-1)
    half: FloatArray = np.minimum(width * along / surface.density[triangle], 1.0)
    return half


def pore_sizes(position: FloatArray, spacing: float, rng: np.random.Generator) -> FloatArray:
    """(N,) radii on the surface: log-normal, with regions of larger and of smaller pores."""
    own = PORE_VARIATION * rng.normal(size=len(position))
    region = REGION_VARIATION * smooth_noise(position, REGION * spacing, rng)
    sizes: FloatArray = PORE_SIZE * spacing * np.exp(np.clip(own + region, -0.7, 0.7))
    return sizes


def pore_weights(
    nodes: IntArray, weight: FloatArray, sizes: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """(N,) strengths in (0, 1]: deep where strong wrinkles meet, and where the pore is large.

    nodes (E, 2), weight (E,): the wrinkles; nodes from N on are no pores.
    sizes (N,): the radii of the pores.
    """
    count = len(sizes)
    total = np.bincount(nodes.ravel(), weights=np.repeat(weight, 2), minlength=count)[:count]
    meeting = total / (total + 2.0 * total.mean())
    chance = np.exp(0.35 * rng.normal(size=len(sizes))) * np.sqrt(sizes / np.median(sizes))
    strengths: FloatArray = np.clip(1.1 * meeting * chance, FAINTEST, 1.0)
    return strengths


def pore_ellipses(
    surface: Surface, triangle: IntArray, radius: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """UV metrics (N, 3) and UV radii (N,) of pores that are round on the surface.

    The rim |J d| = r is dᵀ(JᵀJ/r²)d = 1; the circle of the same area has the UV radius
    r / det(JᵀJ)^¼. No pore reaches as far as 1 in UV.
    """
    radius = np.minimum(radius, 0.9 * surface.narrowest[triangle])
    u, v = surface.jacobian[triangle].transpose(2, 0, 1)
    metric = np.stack([(u * u).sum(-1), (u * v).sum(-1), (v * v).sum(-1)], axis=-1)
    return metric / radius[:, None] ** 2, radius / np.sqrt(surface.density[triangle])
