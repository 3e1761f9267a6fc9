"""The places of UV seams where both sides differ most, and the wrinkles and pores that do it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from reference import drawing, redraw
from rhytid.domain.graph import WrinkleGraph

# Places that lie so near one another on the surface, in steps from place to place, are told once.
STEPS = 12
TOLD = 3


def worst_places(graph: WrinkleGraph, seam: Any, heights: Any, most: int) -> Iterator[str]:
    """Lines of text: where, what share of the squares, what differs and of which triangles."""
    places, kept = seam
    error = np.where(kept[-1], (heights[0] - heights[1]) ** 2 * places.weight, 0.0)
    left, total = error.copy(), error.sum()
    for _ in range(most):
        k = int(left.argmax())
        around = np.arange(max(k - STEPS, 0), min(k + STEPS + 1, len(left)))
        gaps = np.linalg.norm(places.position[around] - places.position[k], axis=1)
        around = around[gaps <= STEPS * places.weight[k]]
        share = left[around].sum() / total
        left[around] = 0.0
        yield (
            f"{share:6.1%} of the squares: heights {heights[0][k]:.3f} and {heights[1][k]:.3f} "
            f"at {places.position[k].round(3)}, uv {places.here[k].round(5)} and "
            f"{places.there[k].round(5)}, triangles {places.triangles[k]}\n"
        )
        yield from _what(graph, places.here[k], places.there[k])


def _what(graph: WrinkleGraph, here: np.ndarray, there: np.ndarray) -> list[str]:
    """What differs most: its distance in sizes and its height, for each of its copies there."""
    found = []
    sides = [_elements(graph, uv) for uv in (here, there)]
    for key in sides[0].keys() | sides[1].keys():
        one, two = (side.get(key, []) for side in sides)
        apart = abs(sum(height for _, height in one) - sum(height for _, height in two))
        found.append((apart, f"        {key[0]} {key[1]}: {_told(one)} and {_told(two)}\n"))
    return [line for _, line in sorted(found, reverse=True)[:TOLD]]


def _told(images: list[tuple[float, float]]) -> str:
    return ", ".join(f"{t:.2f} sizes away {h:.3f}" for t, h in images) or "nothing"


def _elements(graph: WrinkleGraph, uv: np.ndarray) -> dict:
    """By kind and row of the original, (distance, height) of each image that a place (2,) is in."""
    found: dict = {}
    lines, discs = redraw.wrinkles(graph), redraw.pores(graph)
    near = np.abs(lines.segments - uv).min(axis=(1, 2)) < 0.02
    for i in np.flatnonzero(near):
        t = drawing._nearest(uv[None], lines, i)[1][0] / lines.half_width[i]
        height = -lines.strength[i] * drawing.profile(t, 2.5)
        _put(found, "wrinkle", graph.edge_copy_of[i], i, t, height)
    near = (np.abs(discs.centres - uv) < 0.02).all(axis=1) & (discs.strength > 0)
    for i in np.flatnonzero(near):
        t = drawing.metric_distance(uv[None], discs.centres[i], discs.metric[i])[0]
        _put(found, "pore", graph.node_copy_of[i], i, t, -discs.strength[i] * drawing.profile(t, 0))
    return found


def _put(found: dict, kind: str, first: int, row: int, t: float, height: float) -> None:
    if t < 1:
        found.setdefault((kind, int(row if first < 0 else first)), []).append((t, height))
