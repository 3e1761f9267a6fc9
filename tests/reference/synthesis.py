"""What the kernels of synthesis find in parallel, found one by one in double."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def thrown_one_by_one(
    place: ArrayLike, normal: ArrayLike, factor: ArrayLike, order: ArrayLike, radius: float
) -> list[int]:
    """The darts, taken in `order`, that are kept: none too close to an earlier one of its sheet."""
    place, normal, factor = (np.asarray(a, np.float64) for a in (place, normal, factor))
    kept: list[int] = []
    for dart in np.asarray(order):
        others = np.array(kept, int)
        distance = np.linalg.norm(place[others] - place[dart], axis=-1)
        near = distance < 0.5 * radius * (factor[others] + factor[dart])
        if not (near & (normal[others] @ normal[dart] > 0)).any():
            kept.append(int(dart))
    return sorted(kept)


def pairs_in_sight(
    position: Floats, normal: Floats, count: int, reach: float, angle: float
) -> set[tuple[int, int]]:
    """Pairs of which one is among the `count` nearest of the other within `reach`, without those
    that at one end lie at less than `angle` beside a nearer one."""
    sight = [
        visible(i, near_ones(i, position, normal, count, reach), position, angle)
        for i in range(len(position))
    ]
    return {(i, j) for i in range(len(position)) for j in sight[i] if j > i and i in sight[j]}


def near_ones(i: int, position: Floats, normal: Floats, count: int, reach: float) -> list[int]:
    """The neighbours of a point, nearest first."""
    mine = nearest_of(i, position, normal, count, reach)
    theirs = [j for j in range(len(position)) if i in nearest_of(j, position, normal, count, reach)]
    distance = np.linalg.norm(position - position[i], axis=-1)
    return sorted({*mine, *theirs}, key=lambda j: (distance[j], j))


def nearest_of(i: int, position: Floats, normal: Floats, count: int, reach: float) -> list[int]:
    """The `count` nearest of a point on its sheet."""
    distance = np.linalg.norm(position - position[i], axis=-1)
    distance[(normal @ normal[i] <= 0) | (distance > reach)] = np.inf
    distance[i] = np.inf
    nearest = np.argsort(distance, kind="stable")[:count]
    return [int(j) for j in nearest if np.isfinite(distance[j])]


def visible(i: int, near: list[int], position: Floats, angle: float) -> list[int]:
    """Those of `near`, nearest first, that stand beside no nearer one."""
    way = position[near] - position[i]
    way /= np.linalg.norm(way, axis=-1, keepdims=True)
    hidden = np.tril(way @ way.T > np.cos(angle), -1).any(axis=1)
    return [j for j, behind in zip(near, hidden, strict=True) if not behind]


def crossing_pairs(position: Floats, normal: Floats, nodes: ArrayLike) -> set[tuple[int, int]]:
    """Pairs of segments that cross, seen along the normal of the first, of all there are."""
    nodes = np.asarray(nodes)
    one, two = np.triu_indices(len(nodes), 1)
    a, b, c, d = *nodes[one].T, *nodes[two].T
    seen = normal[a] + normal[b]
    facing = np.einsum("nx,nx->n", seen, normal[c] + normal[d]) > 0
    apart = (a != c) & (a != d) & (b != c) & (b != d)
    p, q, r, s = (position[node] for node in (a, b, c, d))
    parted = side_of(q - p, r - p, seen) * side_of(q - p, s - p, seen) < 0
    parting = side_of(s - r, p - r, seen) * side_of(s - r, q - r, seen) < 0
    found = facing & apart & parted & parting
    return set(zip(one[found].tolist(), two[found].tolist(), strict=True))


def side_of(along: Floats, to: Floats, normal: Floats) -> Floats:
    """(N,) on which side of `along` the vector `to` points, seen along the normal."""
    side: Floats = np.einsum("nx,nx->n", np.cross(along, to), normal)
    return side


def points_on(corners: Floats, area: Floats, count: int, seed: int) -> Floats:
    """(count, 3) points of triangles, corners (F, 3, 3), uniform by area."""
    rng = np.random.default_rng(seed)
    triangle = rng.choice(len(area), count, p=area / area.sum())
    root, along = np.sqrt(rng.random((count, 1))), rng.random((count, 1))
    a, b, c = corners[triangle].transpose(1, 0, 2)
    points: Floats = (1 - root) * a + root * (1 - along) * b + root * along * c
    return points


def route(start: int, end: int, ways: list[list[tuple[int, int]]], position: Floats) -> list[int]:
    """The edges of a line that takes the way of least detour, nearer to `end` at every step; none
    where it does not arrive.  ways: for each point its (edge, other point)."""
    node, taken = start, list[int]()
    left = np.linalg.norm(position - position[end], axis=-1)
    while node != end:
        onward = [
            (np.linalg.norm(position[other] - position[node]) + left[other], edge, other)
            for edge, other in ways[node]
            if left[other] < left[node]
        ]
        if not onward:
            return []
        _, edge, node = min(onward)
        taken.append(edge)
    return taken
