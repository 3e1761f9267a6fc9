"""Wrinkles along chains, and pores in pits: what is fitted to a scan, and the graph of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from rhytid.domain.asset_settings import ShapeSettings
from rhytid.domain.graph import ORIGINAL
from rhytid.domain.tiles import udim_origin
from rhytid.tracing.ridges import LINE_POWER, PIT_POWER, Floats, Pits, ValleyPoints

Arrays = dict[str, NDArray[Any]]
# Arrays of graphs whose values are numbers of nodes or wrinkles; below 0 they are of none.
_REFERS = {
    "edge_nodes": "node",
    "node_copy_of": "node",
    "edge_copy_of": "edge",
    "edge_partners": "edge",
}
# Texels of a wrinkle along its line, and the least of a line. Where wrinkles have a broad layer
# they are longer: where many lie within its width, their heights would add up. On skin of known
# lines 4 and 9 left more to be found than 6, and 12 was no better than 8.
_LENGTH, _LONG, _SHORTEST = 6.0, 8.0, 2.0
# How much wider than it answers a line with a broad layer is begun: on the slopes of that layer it
# looks narrow. On grown skin fits from 2.0 on come out alike, and 2.6 is as good as any.
_WIDER = 2.6
# A chain of fewer points, of which more than this share lies in a pit, is a part of that.
_IN_PIT, _MOSTLY, _CORE = 6, 0.6, 0.7
# The narrowest and the broadest half width and radius, texels; slopes at most.
NARROWEST, BROADEST = 0.5, 8.0
_STEEPEST = 0.6
# The longest pore over its width, squared.
_LONGEST = 0.3


@dataclass(frozen=True, eq=False)
class TracedLines:
    """Lines of a UDIM as wrinkles between N nodes, in texels from the middle of the first, y down.

    x, y, half_width, weight (N,).  edges (M, 2) int64: nodes.  slopes (M, 2): as `edge_slopes`.
    partners (M, 2) int64: the wrinkles before and behind on the line, -1 for none.  line (M,)
    int64: of each wrinkle.
    """

    x: Floats
    y: Floats
    half_width: Floats
    weight: Floats
    edges: NDArray[np.int64]
    slopes: Floats
    partners: NDArray[np.int64]
    line: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.edges)

    def lengths(self) -> Floats:
        """(M,) of wrinkles, texels."""
        one, two = self.edges.T
        found: Floats = np.hypot(self.x[two] - self.x[one], self.y[two] - self.y[one])
        return found

    def without_faint(self, least: float) -> TracedLines:
        """Without wrinkles that are fainter at both ends than `least`."""
        kept = self.weight[self.edges].max(axis=1) >= least
        number = np.where(kept, np.cumsum(kept) - 1, -1)
        partners = self.partners[kept]
        partners = np.where(partners >= 0, number[np.maximum(partners, 0)], -1)
        used, edges = np.unique(self.edges[kept], return_inverse=True)
        x, y, half_width, weight = (
            values[used] for values in (self.x, self.y, self.half_width, self.weight)
        )
        edges, slopes = edges.reshape(-1, 2), self.slopes[kept]
        return TracedLines(x, y, half_width, weight, edges, slopes, partners, self.line[kept])


@dataclass(frozen=True, eq=False)
class TracedPores:
    """K pores of a UDIM: x, y, weight, size (K,): texels, radius of the circle of the same area.
    root (K, 3): (xx, xy, yy), y up, of determinant 1: the rim is where |root d| = size."""

    x: Floats
    y: Floats
    weight: Floats
    size: Floats
    root: Floats

    def __len__(self) -> int:
        return len(self.x)

    def without_faint(self, least: float) -> TracedPores:
        """Without pores fainter than `least`."""
        kept = self.weight >= least
        values = (self.x, self.y, self.weight, self.size, self.root)
        return TracedPores(*(value[kept] for value in values))


def lines_of(
    points: ValleyPoints, chains: list[NDArray[np.int64]], depth: float, shape: ShapeSettings
) -> TracedLines:
    """Wrinkles along chains, as deep and as wide as the curvature at the best scale says.

    depth: of a wrinkle of weight 1, relief units.  shape: that is drawn.
    """
    at = np.concatenate([np.zeros(0, np.int64), *chains])
    chain = np.repeat(np.arange(len(chains)), [len(c) for c in chains])
    cushion = shape.cushion
    width, height = line_calibration(shape.wrinkle_bulge, cushion, shape.cushion_width)
    x, y = (_smoothed(v[at], chain, 1) for v in (points.x, points.y))
    scale, curvature = points.scale[at], points.curvature[at]
    width *= _WIDER if cushion > 0.0 else 1.0
    half_width = np.clip(_smoothed(width * scale, chain, 3), NARROWEST, BROADEST)
    deep = _smoothed(height * scale**2 * curvature, chain, 2)
    weight = np.clip(deep / depth, 1e-3, 1.0)
    node, first = _cuts(x, y, chain, _LONG if cushion > 0.0 else _LENGTH)
    edges = np.stack([first, first + 1], axis=1)
    edges = edges[chain[node[edges[:, 0]]] == chain[node[edges[:, 1]]]]
    line = chain[node[edges[:, 0]]]
    slopes = _slopes(x, y, chain, node[edges])
    x, y, half_width, weight = (v[node] for v in (x, y, half_width, weight))
    return TracedLines(x, y, half_width, weight, edges, slopes, _partners(line), line)


def _smoothed(values: Floats, chain: NDArray[np.int64], times: int) -> Floats:
    """Values of points in the order of their chains, each the mean of itself and its neighbours;
    those at ends stay."""
    inner = np.zeros(len(values), np.bool_)
    inner[1:-1] = (chain[:-2] == chain[1:-1]) & (chain[2:] == chain[1:-1])
    inner_at = np.flatnonzero(inner)
    for _ in range(times):
        around = values[inner_at - 1] + values[inner_at] + values[inner_at + 1]
        values = values.copy()
        values[inner_at] = around / 3.0
    return values


def _cuts(
    x: Floats, y: Floats, chain: NDArray[np.int64], wanted: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The points that become nodes, in order, and all numbers of nodes but the last. A chain is cut
    to wrinkles of nearly one length; one that is too short has none."""
    if not len(x):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    step = np.hypot(np.diff(x, prepend=x[0]), np.diff(y, prepend=y[0]))
    new = np.diff(chain, prepend=-1) != 0
    gone = np.cumsum(np.where(new, 0.0, step))
    gone -= np.repeat(gone[new], np.diff(np.append(np.flatnonzero(new), len(x))))
    length = np.zeros(chain[-1] + 1)
    last = np.append(new[1:], True)
    length[chain[last]] = gone[last]
    count = np.maximum(np.rint(length / wanted), 1.0)
    part = np.floor(gone / np.maximum(length, 1e-9)[chain] * count[chain] + 0.5)
    off = np.abs(gone - part * (length / count)[chain])
    # Of the points of a part the nearest to its cut, and both ends.
    start = new | (np.diff(part, prepend=-1.0) != 0)
    run = np.cumsum(start) - 1
    nearest = off == np.minimum.reduceat(off, np.flatnonzero(start))[run]
    _, one = np.unique(run[nearest], return_index=True)
    best = new | last
    best[np.flatnonzero(nearest)[one]] = True
    node = np.flatnonzero(best & (length >= _SHORTEST)[chain])
    return node, np.arange(max(len(node) - 1, 0))


def _slopes(x: Floats, y: Floats, chain: NDArray[np.int64], ends: NDArray[np.int64]) -> Floats:
    """(M, 2) slopes of the chains over the straight lines between points (M, 2), to the left with y
    up."""
    if not len(ends):
        return np.zeros((0, 2))
    before, after = np.arange(len(x)) - 1, np.arange(len(x)) + 1
    before = np.where((before >= 0) & (chain[np.maximum(before, 0)] == chain), before, before + 1)
    top = np.minimum(after, len(x) - 1)
    after = np.where((after < len(x)) & (chain[top] == chain), after, after - 1)
    along = np.stack([x[after] - x[before], y[after] - y[before]], axis=1)
    step = np.stack([x[ends[:, 1]] - x[ends[:, 0]], y[ends[:, 1]] - y[ends[:, 0]]], axis=1)
    slopes = []
    for end in ends.T:
        ahead = (along[end] * step).sum(axis=1)
        left = along[end, 0] * step[:, 1] - along[end, 1] * step[:, 0]
        slopes.append(np.where(ahead > 0, left / np.maximum(ahead, 1e-9), 0.0))
    found: Floats = np.clip(np.stack(slopes, axis=1), -_STEEPEST, _STEEPEST)
    return found


def _partners(line: NDArray[np.int64]) -> NDArray[np.int64]:
    """(M, 2) the wrinkle before and behind on the same line; they follow one another."""
    number = np.arange(len(line))
    same = np.diff(line, prepend=-1) == 0
    before = np.where(same, number - 1, -1)
    return np.stack([before, np.where(np.append(same[1:], False), number + 1, -1)], axis=1)


def outside_pits(
    points: ValleyPoints, chains: list[NDArray[np.int64]], pores: TracedPores
) -> list[NDArray[np.int64]]:
    """The chains without short ones that are no lines but the walls of a pit."""
    short = [number for number, chain in enumerate(chains) if len(chain) < _IN_PIT]
    if not short or not len(pores):
        return chains
    at = np.concatenate([chains[number] for number in short])
    of = np.repeat(np.arange(len(short)), [len(chains[number]) for number in short])
    tree = scipy.spatial.cKDTree(np.stack([pores.x, pores.y], axis=1))
    distance, nearest = tree.query(np.stack([points.x[at], points.y[at]], axis=1))
    inside = np.bincount(of, distance < _CORE * pores.size[nearest]) / np.bincount(of)
    dropped = set(np.array(short)[inside > _MOSTLY].tolist())
    return [chain for number, chain in enumerate(chains) if number not in dropped]


def pores_of(pits: Pits, depth: float) -> TracedPores:
    """Pores in pits, as deep and as wide as curvature and scale say."""
    width, height = pore_calibration()
    smaller, larger = pits.curvature.T
    across = np.sqrt(np.clip(smaller / larger, _LONGEST, 1.0))  # the metric over its mean
    deep = height * pits.scale**2 * np.sqrt(smaller * larger)
    # y up; the root of the metric 1/across along the angle, across over it.
    c, s = np.cos(pits.angle), -np.sin(pits.angle)
    uu, vv = c * c / across + s * s * across, s * s / across + c * c * across
    uv = c * s * (1.0 / across - across)
    xx = np.sqrt(uu)
    root = np.stack([xx, uv / xx, np.sqrt(np.maximum(vv - (uv / xx) ** 2, 1e-12))], axis=1)
    size = np.clip(width * pits.scale, NARROWEST, BROADEST)
    return TracedPores(pits.x, pits.y, np.clip(deep / depth, 1e-3, 1.0), size, root)


@cache
def line_calibration(bulge: float, cushion: float, cushion_width: float) -> tuple[float, float]:
    """Half width over the scale at which a lone line answers strongest, and its depth over the
    square of that scale times its curvature there.  cushion, cushion_width: of its broad layer."""
    x = np.linspace(-20.0, 20.0, 8001)
    t2, b2 = np.minimum(x**2, 1.0), np.minimum((x / cushion_width) ** 2, 1.0)
    narrow = (1.0 - t2) ** 2 * (1.0 - bulge * t2)
    profile = -(1.0 - cushion) * narrow - cushion * (1.0 - b2) ** 2

    def curvature(scale: float) -> float:
        z = x / scale
        weights = (z**2 - 1.0) * np.exp(-0.5 * z**2)
        return float((profile * weights).sum() * (x[1] - x[0]) / (scale**3 * np.sqrt(2 * np.pi)))

    return _calibrated(curvature, LINE_POWER)


@cache
def pore_calibration() -> tuple[float, float]:
    """The same of a round pore: its radius."""
    r = np.linspace(0.0, 1.0, 2001)
    profile = -((1.0 - r**2) ** 2)

    def curvature(scale: float) -> float:
        z = r / scale
        weights = (0.5 * z**2 - 1.0) * np.exp(-0.5 * z**2) * r
        return float((profile * weights).sum() * (r[1] - r[0]) / scale**4)

    return _calibrated(curvature, PIT_POWER)


def _calibrated(curvature: Any, power: float) -> tuple[float, float]:
    scales = np.linspace(0.1, 3.0, 1161)
    answers = np.array([s**power * curvature(s) for s in scales])
    best = float(scales[answers.argmax()])
    return 1.0 / best, 1.0 / (best**2 * curvature(best))


def graph_arrays(lines: TracedLines, pores: TracedPores, udim: int, resolution: int) -> Arrays:
    """The arrays of a graph without triangles: nodes of lines, of no strength, then pores."""
    x, y = np.concatenate([lines.x, pores.x]), np.concatenate([lines.y, pores.y])
    uv = np.stack([(x + 0.5) / resolution, 1.0 - (y + 0.5) / resolution], axis=1)
    uv += np.array(udim_origin(udim), np.float64)
    plain = np.array([1.0, 0.0, 1.0])
    root = np.concatenate([np.tile(plain, (len(lines.x), 1)), pores.root])
    radius = np.concatenate([lines.half_width, pores.size]) / resolution
    xx, xy, yy = (root / radius[:, None]).T
    none = np.zeros(len(lines.x))
    ends, widths = lines.weight[lines.edges], lines.half_width[lines.edges] / resolution
    return {
        "node_uv": uv.astype(np.float32),
        "node_weight": np.concatenate([none, pores.weight]).astype(np.float32),
        "node_radius": radius.astype(np.float32),
        "node_metric": np.stack([xx * xx, xx * xy, xy * xy + yy * yy], axis=1).astype(np.float32),
        "node_copy_of": np.full(len(x), ORIGINAL, np.int32),
        "edge_nodes": lines.edges.astype(np.int32),
        "edge_weight": ends.mean(axis=1).astype(np.float32),
        "edge_half_width": widths.mean(axis=1).astype(np.float32),
        "edge_copy_of": np.full(len(lines), ORIGINAL, np.int32),
        "edge_metric": np.zeros((len(lines), 3), np.float32),
        "edge_slopes": lines.slopes.astype(np.float32),
        "edge_end_weights": ends.astype(np.float32),
        "edge_end_half_widths": widths.astype(np.float32),
        "edge_partners": lines.partners.astype(np.int32),
    }


def together(parts: Sequence[Arrays]) -> Arrays:
    """The arrays of several graphs as one. All have the same names."""
    found, counts = [], {"node": 0, "edge": 0}
    for arrays in parts:
        refers = {
            name: np.where(rows >= 0, rows + np.int32(counts[of]), rows)
            for name, of in _REFERS.items()
            if (rows := arrays.get(name)) is not None
        }
        found.append(arrays | refers)
        counts["node"] += len(arrays["node_uv"])
        counts["edge"] += len(arrays["edge_nodes"])
    return {name: np.concatenate([arrays[name] for arrays in found]) for name in found[0]}


def selected(arrays: Arrays, nodes: NDArray[np.bool_], edges: NDArray[np.bool_]) -> Arrays:
    """The arrays of some nodes (N,) and wrinkles (M,), of which none ends at another node. What
    refers to others refers to nothing, -1."""
    kept = {"node": nodes, "edge": edges}
    found = {name: array[kept[name[:4]]] for name, array in arrays.items()}
    for name, of in _REFERS.items():
        if (rows := found.get(name)) is not None:
            number = np.where(kept[of], np.cumsum(kept[of]) - 1, -1)
            found[name] = np.where(rows >= 0, number[np.maximum(rows, 0)], -1).astype(np.int32)
    return found


def changed(lines: TracedLines, weight: Floats, half_width: Floats) -> TracedLines:
    """Lines with other weights and half widths, within their ranges."""
    widths = np.clip(half_width, NARROWEST, BROADEST)
    return replace(lines, weight=np.clip(weight, 1e-3, 1.0), half_width=widths)


def changed_pores(pores: TracedPores, weight: Floats, size: Floats) -> TracedPores:
    """Pores with other weights and sizes, within their ranges."""
    sizes = np.clip(size, NARROWEST, BROADEST)
    return replace(pores, weight=np.clip(weight, 1e-3, 1.0), size=sizes)
