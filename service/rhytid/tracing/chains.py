"""Follows valley points to chains, and joins chains that go on across a gap."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise, product

import numpy as np
import scipy
from numpy.typing import NDArray

from rhytid.support import cancellation
from rhytid.tracing.ridges import Floats, ValleyPoints

Links = NDArray[np.int64]
NONE = -1
# Least cosines of the way to a neighbour and of its direction with the direction of a point.
_AHEAD, _ALIKE = 0.75, 0.75
# What a turn, and another scale, cost of the way to a neighbour, texels.
_TURN, _OTHER_SCALE = 2.0, 0.3
# Rows of texels in which neighbours are looked up at a time, and how far away these are.
_ROWS, _REACH = 2048, 2
# Points of a chain that is joined with others.
_JOINED = 4
# Least cosine of the way over a gap with the directions at its sides.
_OVER_GAP = 0.85


def linked(points: ValleyPoints, shape: tuple[int, int]) -> Links:
    """(K, 2) for each point the next one ahead, in the sense of `along`, and behind, or NONE. Two
    are linked where each is the best choice of the other.

    points: by row and column of a map of `shape`.
    """
    picked = np.full((len(points), 2), NONE, np.int64)
    for top in range(0, shape[0], _ROWS):
        cancellation.check()
        low, first, last, high = np.searchsorted(
            points.row, [top - _REACH, top, top + _ROWS, top + _ROWS + _REACH]
        )
        if last > first:
            some = points.take(np.arange(low, high))
            found = _best(some, (top - _REACH, min(_ROWS, shape[0] - top) + 2 * _REACH, shape[1]))
            own = found[first - low : last - low]
            picked[first:last] = np.where(own >= 0, own + low, NONE)
    return mutual(picked)


def _best(points: ValleyPoints, window: tuple[int, int, int]) -> Links:
    """(K, 2) the best neighbours ahead and behind, of points in a window (top row, rows, columns)
    of the map."""
    top, rows, columns = window
    wide = columns + 2 * _REACH
    index = np.full((rows + 2 * _REACH) * wide, NONE, np.int32)
    place = (points.row - top + _REACH) * wide + points.column + _REACH
    index[place] = np.arange(len(points))
    found = np.full((len(points), 2), NONE, np.int64)
    least = np.full((len(points), 2), np.inf)
    steps = range(-_REACH, _REACH + 1)
    # Of each pair of texels once: it is looked at from both.
    for dy, dx in [step for step in product(steps, steps) if step > (0, 0)]:
        other = index.take(place + (dy * wide + dx))
        one = np.flatnonzero(other >= 0)
        two = other[one].astype(np.int64)
        for here, there, cost, ahead in _costs(points, one, two):
            side = (ahead < 0).astype(np.int64)
            better = cost < least[here, side]
            here, there, side = here[better], there[better], side[better]
            least[here, side] = cost[better]
            found[here, side] = there
    return found


def _costs(
    points: ValleyPoints, one: NDArray[np.int64], two: NDArray[np.int64]
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64], Floats, Floats]]:
    """Of pairs of points, and of the same the other way round: from where, to where, what that
    costs, and whether it is ahead, above 0, or behind. Pairs where lines do not go that way are
    left out."""
    # By components: sums over the two of a row take long.
    x, y = points.x[two] - points.x[one], points.y[two] - points.y[one]
    ways = points.along[one].T, points.along[two].T
    length = np.maximum(np.sqrt(x * x + y * y), 1e-9)
    alike = np.abs(ways[0][0] * ways[1][0] + ways[0][1] * ways[1][1])
    other = np.abs(np.log(points.scale[two] / points.scale[one]))
    cost = length + _TURN * (2.0 - alike) + _OTHER_SCALE * other
    linked = (alike > _ALIKE) & (length >= 0.3)
    for here, there, way, sense in ((one, two, ways[0], 1.0), (two, one, ways[1], -1.0)):
        along = sense * (x * way[0] + y * way[1]) / length
        kept = linked & (np.abs(along) > _AHEAD)
        along = along[kept]
        yield here[kept], there[kept], cost[kept] - _TURN * np.abs(along), along


def mutual(picked: Links) -> Links:
    """Links, of which those stay that go both ways."""
    me, kept = np.arange(len(picked)), picked >= 0
    for side in (0, 1):
        other = np.maximum(picked[:, side], 0)
        kept[:, side] &= (picked[other, 0] == me) | (picked[other, 1] == me)
    kept[:, 1] &= picked[:, 0] != picked[:, 1]
    found: Links = np.where(kept, picked, NONE)
    return found


def joined(points: ValleyPoints, links: Links, gap: float) -> Links:
    """Links over gaps of up to `gap` texels, too, where two ends of chains point at each other:
    a line goes on behind a pore that it crosses, or where it is too faint. Chains of fewer than
    _JOINED points say too little of where they go.
    """
    end, side = np.nonzero((links < 0) & (_sizes(links) >= _JOINED)[:, None])
    if len(end) < 2:
        return links
    place = np.stack([points.x[end], points.y[end]], axis=1)
    out = points.along[end] * np.where(side == 0, 1.0, -1.0)[:, None]
    pairs = scipy.spatial.cKDTree(place).query_pairs(gap, output_type="ndarray")
    pairs = np.concatenate([pairs, pairs[:, ::-1]])
    one, two = pairs.T
    step = place[two] - place[one]
    length = np.maximum(np.linalg.norm(step, axis=1), 1e-9)
    ahead = (step * out[one]).sum(axis=1) / length
    facing = -(step * out[two]).sum(axis=1) / length
    cost = length * (1.0 + _TURN * (2.0 - ahead - facing))
    good = (np.minimum(ahead, facing) > _OVER_GAP) & (end[one] != end[two])
    one, two, cost = one[good], two[good], cost[good]
    best = np.full(len(end), NONE, np.int64)
    order = np.lexsort((two, cost))
    which, first = np.unique(one[order], return_index=True)
    best[which] = two[order][first]
    both = np.flatnonzero((best >= 0) & (best[np.maximum(best, 0)] == np.arange(len(end))))
    result: Links = links.copy()
    result[end[both], side[both]] = end[best[both]]
    return result


def _sizes(links: Links) -> NDArray[np.int64]:
    """(K,) how many points the chain of each point has."""
    one, side = np.nonzero(links >= 0)
    graph = scipy.sparse.coo_matrix(
        (np.ones(len(one), np.int8), (one, links[one, side])), (len(links), len(links))
    )
    _, chain = scipy.sparse.csgraph.connected_components(graph, directed=False)
    sizes: NDArray[np.int64] = np.bincount(chain)[chain]
    return sizes


def chains_of(links: Links) -> list[NDArray[np.int64]]:
    """The chains of two points or more, each in order, from its end with the lower number; of rings
    from the lowest number on."""
    count = (links >= 0).sum(axis=1)
    open_ = _from_ends(links, np.flatnonzero(count == 1))
    seen = np.zeros(len(links), np.bool_)
    seen[np.concatenate([np.zeros(0, np.int64), *open_])] = True
    return open_ + _rings(links, np.flatnonzero(~seen & (count == 2)))


def _from_ends(links: Links, ends: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """The chains from ends. All are walked together, from both ends; the walk from the lower one is
    kept."""
    walk, here, before = np.arange(len(ends)), ends, np.full(len(ends), NONE)
    walks, places, last = [walk], [here], ends.copy()
    while len(here):
        cancellation.check()
        one, two = links[here].T
        after = np.where((one != before) & (one != NONE), one, two)
        on = (after != before) & (after != NONE)
        walk, here, before = walk[on], after[on], here[on]
        last[walk] = here
        walks.append(walk)
        places.append(here)
    of, place = np.concatenate(walks), np.concatenate(places)
    kept = (ends < last)[of]
    of, place = of[kept], place[kept]
    order = np.argsort(of, kind="stable")
    of, place = of[order], place[order]
    first = np.flatnonzero(np.diff(of, prepend=NONE)).tolist()
    # `np.split` takes many times as long.
    return [place[a:b] for a, b in pairwise([*first, len(of)])]


def _rings(links: Links, points: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """The rings that some points, all of no other chain, are in."""
    number = np.searchsorted(points, links[points]).tolist()
    seen, found = np.zeros(len(points), np.bool_), []
    for start in range(len(points)):
        if not seen[start]:
            ring = _ring(number, start)
            seen[ring] = True
            found.append(points[ring])
    return found


def _ring(links: list[list[int]], start: int) -> list[int]:
    """The points once around a ring."""
    ring, before, here = [start], NONE, start
    while True:
        one, two = links[here]
        after = one if one != before else two
        if after == start:
            return ring
        ring.append(after)
        before, here = here, after
