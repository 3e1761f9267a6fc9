"""How much room a surface has for pores whose spacing differs from place to place."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.synthesis.arrays import ROWS
from rhytid.synthesis.fields.fields import Fields
from rhytid.synthesis.surface import FloatArray, Surface

# Places looked at in all to tell the room of a surface, and along a side of one triangle: their
# coordinates then take 10 MB.
_LOOKS, _FINEST = 1 << 20, 512


def spacings(fields: Fields, triangle: NDArray[Any], uv: NDArray[Any]) -> NDArray[np.float32]:
    """(N,) factors of the spacing at points, within what the fields promise."""
    found = np.clip(fields.spacing(triangle, uv), fields.least_spacing, fields.most_spacing)
    return found.astype(np.float32)


def total_room(surface: Surface, fields: Fields) -> float:
    """The area of the surface that is not bare in units of squared spacing factors; the area where
    spacing is even."""
    carriers = np.flatnonzero(surface.carries)
    mean = shares(surface, fields, carriers, _cuts(surface.uv[carriers], fields.detail))[1]
    return float((surface.area[carriers] * mean).sum())


def densities(
    surface: Surface, fields: Fields, carriers: NDArray[np.intp], radius: float
) -> tuple[FloatArray, FloatArray]:
    """(C,) `shares` of triangles that are looked at every `radius`: those of each hang on what is
    painted on it, and on nothing else."""
    if np.isinf(fields.detail):
        return shares(surface, fields, carriers, np.ones(len(carriers), np.int64))
    corners = surface.corners[carriers]
    longest = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=-1).max(axis=1)
    return shares(surface, fields, carriers, _powers(longest / radius))


def shares(
    surface: Surface, fields: Fields, carriers: NDArray[np.intp], cuts: NDArray[np.int64]
) -> tuple[FloatArray, FloatArray]:
    """(C,) one over squared factors: at the densest place of each triangle, and on the mean.

    cuts (C,): into how many parts the sides of a triangle are cut to look at it.
    """
    most, mean = np.empty(len(carriers)), np.empty(len(carriers))
    for cut in np.unique(cuts):
        places, nodes = _places(int(cut))
        chosen = np.flatnonzero(cuts == cut)
        step = max(ROWS // len(places), 1)
        for first in range(0, len(chosen), step):
            rows = chosen[first : first + step]
            share = _shares(surface, fields, carriers[rows], places)
            most[rows], mean[rows] = share.max(axis=1), share[:, nodes:].mean(axis=1)
    return most, mean


def _shares(
    surface: Surface, fields: Fields, triangle: NDArray[np.intp], places: FloatArray
) -> FloatArray:
    """(T, P) pores by area, 1 where spacing is even, at P places of each triangle."""
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
