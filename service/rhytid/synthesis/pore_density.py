"""How dense pores are: on even skin, in numbers that nothing painted moves, and where their spacing
differs from place to place.

Strengths, weights and sizes are meant against even skin, not against the means of the skin that
grows: a mean over the surface would carry what is painted in one place to all others. Its numbers
were measured on a real face and on flat sheets."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.synthesis.fields import Fields
from rhytid.synthesis.progress import over_rows
from rhytid.synthesis.surface import FloatArray, Surface

# Centres per r² once all darts are thrown, r the radius of the discs. (Thrown for ever, discs jam
# at 0.547 · 4/π = 0.696; the last of them fit into rooms too small to see.)
PACKING = 0.605
# Mean distance of a pore to the nearest, in r.
SPACING = 1.0935
# Mean length of the candidate edges, in r.
LENGTH = 1.408
# Wrinkles drawn per pore; a triangulation would have three.
EDGES_PER_PORE = 2.1
# Where each pore looks for so many neighbours, or more: candidate edges per pore; and the strength
# at which the faintest is drawn where the number of wrinkles is not given, 2.1 per pore.
_NEIGHBOURS = {
    4: (2.21, 0.057),
    5: (2.6, 0.235),
    6: (2.8, 0.29),
    7: (2.85, 0.303),
    8: (2.86, 0.303),
}
# The strength at which the faintest edge of the coarse net becomes a primary line, 1.9 per coarse
# pore, and the mean of all that do, sharpened.
FAINTEST_PRIMARY, PRIMARY_STRENGTH = 0.675, 1.468
# Places looked at in all to tell the room of a surface, and along a side of one triangle: their
# coordinates then take 10 MB.
_LOOKS, _FINEST = 1 << 20, 512
# Places that a thread looks at together: what is computed on the way stays in the cache.
_TOGETHER = 1 << 16


@dataclass(frozen=True)
class Usual:
    """Means of even skin.

    strength: of the edges that are drawn.  meeting: sum of the weights of the wrinkles that meet at
    a pore.
    """

    strength: float
    meeting: float


WITH_PRIMARY, WITHOUT_PRIMARY = Usual(1.446, 1.114), Usual(0.872, 1.18)


def edges_per_pore(neighbours: int) -> float:
    """Candidate edges per pore, each pore looking for so many neighbours."""
    return _NEIGHBOURS[min(neighbours, 8)][0]


def faintest(neighbours: int) -> float:
    """The least strength at which an edge is drawn where the number of wrinkles is not given."""
    return _NEIGHBOURS[min(neighbours, 8)][1]


def spacings(fields: Fields, triangle: NDArray[Any], uv: NDArray[Any]) -> NDArray[np.float32]:
    """(N,) factors of the spacing of pores at points, kept within the limits of the fields.

    triangle (N,), uv (N, 2): of the points.
    """
    found = np.clip(fields.spacing(triangle, uv), fields.least_spacing, fields.most_spacing)
    return found.astype(np.float32)


def effective_area(surface: Surface, fields: Fields) -> float:
    """The area of even skin that would hold as many pores as the surface does: its area that is not
    bare, each place over its squared spacing factor. Patches are 1 in the mean and do not count."""
    fields = fields.unpatched
    carriers = np.flatnonzero(surface.carries)
    mean = relative_densities(
        surface, fields, carriers, _cuts(surface.uv[carriers], fields.detail)
    )[1]
    return float((surface.area[carriers] * mean).sum())


def densities(
    surface: Surface, fields: Fields, carriers: NDArray[np.intp], radius: float
) -> tuple[FloatArray, FloatArray]:
    """`relative_densities` (C,) of triangles that are sampled every `radius`, or as many times less
    often as the `looks` of the fields say.

    The result for a triangle depends on nothing but what is painted on it.
    """
    if np.isinf(fields.detail):
        return relative_densities(surface, fields, carriers, np.ones(len(carriers), np.int64))
    corners = surface.corners[carriers]
    longest = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=-1).max(axis=1)
    return relative_densities(surface, fields, carriers, _powers(longest * fields.looks / radius))


def relative_densities(
    surface: Surface, fields: Fields, carriers: NDArray[np.intp], cuts: NDArray[np.int64]
) -> tuple[FloatArray, FloatArray]:
    """(C,) pores by area relative to even skin, one over the squared spacing factor: at the densest
    place of each triangle `carriers` (C,), and its mean over the triangle.

    cuts (C,): into how many parts the sides of a triangle are cut for samples.
    """
    most, mean = np.empty(len(carriers)), np.empty(len(carriers))
    for cut in np.unique(cuts):
        chosen = np.flatnonzero(cuts == cut)
        most[chosen], mean[chosen] = _sampled(surface, fields, carriers[chosen], int(cut))
    return most, mean


def _sampled(
    surface: Surface, fields: Fields, triangle: NDArray[np.intp], cut: int
) -> tuple[FloatArray, FloatArray]:
    """`relative_densities` of triangles (T,) whose sides are cut into so many parts."""
    places, nodes = _places(cut)
    most, mean = np.empty(len(triangle)), np.empty(len(triangle))

    def find(rows: slice) -> None:
        share = _relative_densities_at(surface, fields, triangle[rows], places)
        most[rows], mean[rows] = share.max(axis=1), share[:, nodes:].mean(axis=1)

    over_rows(len(triangle), find, max(_TOGETHER // len(places), 1))
    return most, mean


def _relative_densities_at(
    surface: Surface, fields: Fields, triangle: NDArray[np.intp], places: FloatArray
) -> FloatArray:
    """(T, P) pores by area relative to even skin at P places of each triangle."""
    uv = (places @ surface.uv[triangle]).reshape(-1, 2)
    at = np.repeat(triangle, len(places))
    share: FloatArray = spacings(fields, at, uv).astype(np.float64) ** -2.0
    if fields.some_bare:
        share[fields.bare(at, uv)] = 0.0
    return share.reshape(len(triangle), -1)


def _cuts(uv: FloatArray, detail: float) -> NDArray[np.int64]:
    """(T,) into how many parts the sides of each triangle are cut: powers of two."""
    cuts = _powers(np.ptp(uv, axis=1).max(axis=1) / detail)
    while (1.5 * cuts**2).sum() > _LOOKS and (cuts > 1).any():
        cuts = np.maximum(cuts // 2, 1)
    return cuts


def _powers(parts: FloatArray) -> NDArray[np.int64]:
    """Powers of two, no less than these as far as `_FINEST`."""
    exponent = np.ceil(np.log2(np.clip(parts, 1.0, _FINEST)))
    powers: NDArray[np.int64] = np.exp2(exponent).astype(np.int64)
    return powers


@cache
def _places(cut: int) -> tuple[FloatArray, int]:
    """(P, 3) barycentric coordinates: the nodes of a triangle cut into cut² equal ones, and then
    the centres of these; and how many are nodes."""
    i, j = np.indices((cut + 1, cut + 1)).reshape(2, -1)
    within = i + j <= cut
    nodes = np.stack([i, j], axis=-1)[within] / cut
    up = np.stack([i, j], axis=-1)[i + j < cut] + 1 / 3
    down = np.stack([i, j], axis=-1)[i + j < cut - 1] + 2 / 3
    places = np.concatenate([nodes, up / cut, down / cut])
    return np.column_stack([places, 1.0 - places.sum(axis=1)]), len(nodes)
