"""Pores: Poisson-disk sampling that is even on the surface, whatever its UV layout."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from rhytid.synthesis.independent import independent_set
from rhytid.synthesis.progress import Progress
from rhytid.synthesis.surface import BoolArray, FloatArray, IntArray, Points, Surface

# Centres per r² once DARTS are thrown. (Thrown for ever, discs jam at 0.547 · 4/π = 0.696; the
# last of them fit into rooms too small to see.)
PACKING = 0.605
# Darts thrown per expected pore, in rounds. Where so many miss, another centre would have had a
# room of a few per cent of r².
DARTS = (2.0, 3.0, 4.0, 5.0, 6.0)
# No more than seven centres that are r apart lie within r of one point.
KISSING = 7


def scatter_pores(
    surface: Surface, radius: float, rng: np.random.Generator, progress: Progress
) -> Points:
    """Pores no two of which are nearer than `radius` on one sheet, with next to no room for more.

    Dart throwing, many at a time: the darts of a round that hit no older pore are thinned by a
    greedy independent set in their random order, which is what throwing them one by one gives.
    Distances are Euclidean; surfaces that touch face to face (lips, eyelids) are kept apart by
    their normals.
    """
    expected = PACKING / radius**2
    pores = surface.sample(0, rng)
    for done, share in enumerate(DARTS):
        progress(done / len(DARTS), "pores")
        darts = surface.sample(int(np.ceil(share * expected)), rng)
        if len(pores):
            darts = darts.take(_fits(pores, darts, radius))
        darts = darts.take(independent_set(len(darts), _conflicts(darts, radius)))
        pores = pores.followed_by(darts)
    return pores


def nearest(pores: Points, reach: float, count: int) -> IntArray:
    """(N, count) the nearest pores on the same sheet, nearest first; N where there are no more."""
    tree = cKDTree(pores.position)
    _, near = tree.query(pores.position, k=count + KISSING, distance_upper_bound=reach, workers=-1)
    near[near == np.arange(len(pores))[:, None]] = len(pores)
    near[~_same_sheet(pores.normal, pores.normal, near)] = len(pores)
    order = np.argsort(near == len(pores), axis=1, kind="stable")[:, :count]
    result: IntArray = np.take_along_axis(near, order, axis=1)
    return result


def mean_spacing(pores: Points, reach: float) -> tuple[float, float]:
    """Mean and deviation of the distance to the nearest pore; 0 where none has one."""
    near = nearest(pores, reach, 1)[:, 0]
    own = np.flatnonzero(near < len(pores))
    if not len(own):
        return 0.0, 0.0
    distance = np.linalg.norm(pores.position[own] - pores.position[near[own]], axis=-1)
    return float(distance.mean()), float(distance.std())


def _fits(pores: Points, darts: Points, radius: float) -> BoolArray:
    """(darts,) true where no pore of the same sheet is within `radius`."""
    tree = cKDTree(pores.position)
    _, near = tree.query(darts.position, k=KISSING + 1, distance_upper_bound=radius, workers=-1)
    hit: BoolArray = np.any(_same_sheet(pores.normal, darts.normal, near), axis=1)
    return ~hit


def _same_sheet(normals: FloatArray, own: FloatArray, near: IntArray) -> BoolArray:
    """(Q, k) true where point `near` exists (< N) and faces the same way as the query point."""
    same: BoolArray = np.asarray(near < len(normals), bool)
    query, slot = np.nonzero(same)
    same[query, slot] = np.einsum("px,px->p", normals[near[query, slot]], own[query]) > 0
    return same


def _conflicts(darts: Points, radius: float) -> IntArray:
    """(P, 2) pairs of darts on one sheet within `radius` of each other."""
    pairs = cKDTree(darts.position).query_pairs(radius, output_type="ndarray")
    facing = np.einsum("px,px->p", darts.normal[pairs[:, 0]], darts.normal[pairs[:, 1]])
    conflicts: IntArray = pairs[facing > 0]
    return conflicts
