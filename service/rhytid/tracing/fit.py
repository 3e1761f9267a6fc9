"""Fits weights and sizes of traced lines and pores to a scan: the device draws the neutral of
them, and each changes by what the scan is above that. Kernel: fit.cl.

A step is one of Gauss and Newton with the diagonal of the normal equations, as long as leaves least
along its way.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import CUSHION_THRESHOLD, AssetSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.pipeline.element_arrays import pore_arrays, wrinkle_arrays
from rhytid.pipeline.elements import UdimElements
from rhytid.pipeline.levels import Draw, render_to_host
from rhytid.pipeline.redraw import ScaleBuffers, redrawing
from rhytid.support import cancellation
from rhytid.synthesis.progress import Progress, silent
from rhytid.synthesis.workspace import Workspace
from rhytid.tracing.elements import (
    BROADEST,
    TracedLines,
    TracedPores,
    changed,
    changed_pores,
    graph_arrays,
)
from rhytid.tracing.measure import (
    BROAD,
    NARROW,
    above_mean,
    above_mean_of_tile,
    cut_out,
    rms_of_some,
    spread,
)
from rhytid.tracing.ridges import Floats

STEPS = 10
# Of the step that the diagonal gives: neighbours that overlap share what is left. Of that, the most
# that is taken, where what a step draws says that more would leave less; below 2, what is drawn in
# between comes closer to what drawing anew would give with each step.
_TAKEN, _FURTHEST = 0.4, 1.6
# There are no more steps after one that leaves more than this share of what there was.
_HARDLY_LESS = 0.97
# What the diagonal gets more, of weights and of the logarithms of sizes: what hardly shows stays.
_HELD_WEIGHT, _HELD_SIZE = 0.25, 0.06
# The most that a step changes: of weights in shares of them and beside, of logarithms of sizes.
_MOST_SHARE, _MOST_WEIGHT, _MOST_SIZE = 0.5, 0.03, 0.15
# Texels of the mean that is taken off what is drawn to have its narrow valleys.
_CUSHIONS = 9
# Texels around a wrinkle of a tile that its layers reach at most.
_TILE, _AROUND = 1024, 64
# What weights are times where too much is drawn, how often, and how many texels beside them that
# may be: nodes are a few texels apart.
_SHALLOWER, _SHALLOWER_TIMES, _BESIDE = 0.8, 10, 2.0
# Weights below are no lines or pores.
_LEAST = 0.01


@dataclass(frozen=True, eq=False)
class Fitted:
    """Lines and pores of a UDIM, and the root mean square of what is left of the scan at first and
    after each step, relief units, by the maps that steps reckon with."""

    lines: TracedLines
    pores: TracedPores
    left: list[float]


def fitted(
    work: Workspace,
    device: Device,
    lines: TracedLines,
    pores: TracedPores,
    scan: NDArray[np.float32],
    inside: NDArray[np.bool_],
    settings: AssetSettings,
    steps: int = STEPS,
    progress: Progress = silent,
) -> Fitted:
    """Lines and pores after `steps` steps, or fewer where one leaves hardly less; those given where
    in the end more is left; shallower ones where they leave more than there was, about its mean.

    What is left counts as a whole, though the steps go by its narrow part alone: fits that went on
    while that part shrank made broad pits of faint lines, and moved skin of known lines worse.

    scan (R, R): relief, mesh units.  inside (R, R): where there is skin.  settings: resolved,
    without grain and undulation.
    """
    drawn, texels = _drawn(device, lines, pores, settings), int(np.count_nonzero(inside))
    if settings.shape.cushion > 0.0:
        gain = _gain(work, drawn, scan, inside)
        lines, pores = _times(gain, lines, pores)
        drawn *= np.float32(gain)
    first, here = (lines, pores), _Place(lines, pores, drawn, _apart(scan, drawn, inside))
    left = [rms_of_some(here.apart, texels)]
    for step in range(steps):
        progress(step / (steps + 1), "fit")
        here = _further(work, device, here, scan, inside, settings)
        left.append(rms_of_some(here.apart, texels))
        if left[-1] > _HARDLY_LESS * left[-2]:
            break
    best = here.lines, here.pores
    rest = _apart(scan, _drawn(device, *best, settings), inside)
    if rms_of_some(rest, texels) > left[0]:  # maps do not go with sizes all the way
        best, rest = first, _apart(scan, _drawn(device, *first, settings), inside)
    if spread(rest, inside) > spread(scan, inside):
        best, rest = _shrunk(device, *best, scan, rest, inside, settings)
    lines, pores = _within_range(device, *best, scan, rest, inside, settings)
    return Fitted(lines.without_faint(_LEAST), pores.without_faint(_LEAST), left)


@dataclass(frozen=True, eq=False)
class _Place:
    """Where a fit is: lines and pores, what they draw (R, R), between steps as far as it goes with
    their weights and sizes, and how far the scan is above that, 0 outside of charts."""

    lines: TracedLines
    pores: TracedPores
    drawn: NDArray[np.float32]
    apart: NDArray[np.float32]


def _further(
    work: Workspace,
    device: Device,
    here: _Place,
    scan: NDArray[np.float32],
    inside: NDArray[np.bool_],
    settings: AssetSettings,
) -> _Place:
    """Where one step leads that is as long as leaves least, if maps go with weights and sizes."""
    lines, pores = _stepped(work, here.lines, here.pores, (here.apart, here.drawn), settings)
    change = _drawn(device, lines, pores, settings)
    change -= here.drawn
    share = min(max(_along(here.apart, change * inside, 0.0), 0.0), _FURTHEST)
    weight, width = _between(
        (here.lines.weight, here.lines.half_width), (lines.weight, lines.half_width), share
    )
    lines = changed(lines, weight, width)
    weight, size = _between((here.pores.weight, here.pores.size), (pores.weight, pores.size), share)
    pores = changed_pores(pores, weight, size)
    change *= np.float32(share)
    drawn = np.add(here.drawn, change, out=change)
    return _Place(lines, pores, drawn, _apart(scan, drawn, inside))


def _between(
    before: tuple[Floats, Floats], after: tuple[Floats, Floats], share: float
) -> tuple[Floats, Floats]:
    """What a share of the way leads to, of weights and of the logarithms of sizes."""
    (weight, size), (to_weight, to_size) = before, after
    return weight + share * (to_weight - weight), size * (to_size / size) ** share


def _shrunk(
    device: Device,
    lines: TracedLines,
    pores: TracedPores,
    scan: NDArray[np.float32],
    rest: NDArray[np.float32],
    inside: NDArray[np.bool_],
    settings: AssetSettings,
) -> tuple[tuple[TracedLines, TracedPores], NDArray[np.float32]]:
    """Lines and pores with weights times the one number that is nearest to the scan, and what they
    leave: together they draw more than there is.  rest: what they leave now, 0 outside."""
    wanted = scan[inside].astype(np.float64)
    drawn = wanted - rest[inside]
    apart = drawn - drawn.mean()
    gain = min(max(float(wanted @ apart) / max(float(apart @ apart), 1e-30), 0.0), 1.0)
    lines, pores = _times(gain, lines, pores)
    return (lines, pores), _apart(scan, _drawn(device, lines, pores, settings), inside)


def _within_range(
    device: Device,
    lines: TracedLines,
    pores: TracedPores,
    scan: NDArray[np.float32],
    rest: NDArray[np.float32],
    inside: NDArray[np.bool_],
    settings: AssetSettings,
) -> tuple[TracedLines, TracedPores]:
    """Lines and pores that are shallower where many overlap and draw so deep that the range of the
    rest would be larger than that of the scan: codes of the residual would have larger steps.

    rest: what they leave, 0 outside.
    """
    allowed = np.ptp(scan[inside]) if inside.any() else np.float32(0.0)
    for _ in range(_SHALLOWER_TIMES):
        lowest = rest.min(where=inside, initial=np.float32(np.inf))
        deep = np.argwhere(inside & (rest > lowest + allowed))
        if not len(deep):
            break
        near = scipy.spatial.cKDTree(deep[:, ::-1])
        weight = _shallower(near, lines.x, lines.y, lines.half_width, lines.weight)
        lines = changed(lines, weight, lines.half_width)
        weight = _shallower(near, pores.x, pores.y, pores.size, pores.weight)
        pores = changed_pores(pores, weight, pores.size)
        rest = _apart(scan, _drawn(device, lines, pores, settings), inside)
    return lines, pores


def _drawn(
    device: Device, lines: TracedLines, pores: TracedPores, settings: AssetSettings
) -> NDArray[np.float32]:
    """(R, R) what lines and pores draw at rest, mesh units."""
    return drawn_neutral(device, neutral_graph(lines, pores, settings), settings, 1001)


def _apart(
    scan: NDArray[np.float32], drawn: NDArray[np.float32], inside: NDArray[np.bool_]
) -> NDArray[np.float32]:
    """How far the scan is above what is drawn; 0 outside of charts."""
    apart = scan - drawn
    apart *= inside
    return apart


def _shallower(near: Any, x: Floats, y: Floats, size: Floats, weight: Floats) -> Floats:
    """Weights, less where a texel of the tree `near` is not much further away than a size."""
    away, _ = near.query(np.stack([x, y], axis=1), distance_upper_bound=BROADEST + _BESIDE)
    found: Floats = np.where(away < size + _BESIDE, _SHALLOWER, 1.0) * weight
    return found


def neutral_graph(lines: TracedLines, pores: TracedPores, settings: AssetSettings) -> WrinkleGraph:
    """The graph of lines and pores of a UDIM as if it were the first, without seams."""
    arrays: dict[str, Any] = graph_arrays(lines, pores, 1001, settings.resolution)
    return WrinkleGraph(**arrays)


def drawn_neutral(
    device: Device, graph: WrinkleGraph, settings: AssetSettings, udim: int
) -> NDArray[np.float32]:
    """(R, R) the neutral map of a graph, mesh units, without grain, undulation and events."""
    # Nothing is wider than at rest, so that fewer are looked at for each texel.
    settings = replace(settings, response=replace(settings.response, alpha_w=0.0, beta_w=0.0))
    of_wrinkles, of_pores = (np.zeros(count, np.int32) for count in (graph.wrinkles, graph.pores))
    wrinkles = wrinkle_arrays(graph, of_wrinkles, settings, udim)
    arrays = wrinkles, pore_arrays(graph, of_pores, settings, udim)
    with device.task_or_steps():
        elements = UdimElements(device, *arrays, settings.bins.count)
        scales = _even_scales(device, elements)
        draw = redrawing(device, elements, settings, scales)
        found = _in_pieces(device, draw, settings.resolution)
        scales.release()
        elements.release()
    cancellation.check()
    return found


def _in_pieces(device: Device, draw: Draw, resolution: int) -> NDArray[np.float32]:
    """A whole map, drawn piece by piece, so that others may use the device in between."""
    found, side = np.empty((resolution,) * 2, np.float32), min(resolution, _TILE)
    for row in range(0, resolution, side):
        for column in range(0, resolution, side):
            cancellation.check()
            piece = render_to_host(device, draw, 0, row, column, side)
            found[row : row + side, column : column + side] = piece
    return found


def _even_scales(device: Device, elements: UdimElements) -> ScaleBuffers:
    """Scales of the neutral: 1."""
    counts = ((4 if elements.bent else 2) * elements.wrinkles, 2 * elements.pores)
    return ScaleBuffers(*(device.full(max(count, 1), np.float32(1.0)) for count in counts))


def _gain(
    work: Workspace,
    drawn: NDArray[np.float32],
    scan: NDArray[np.float32],
    inside: NDArray[np.bool_],
) -> float:
    """The number times which what is drawn is nearest to the scan in its narrow part: lines that
    were found there answer less than their broad layers would."""
    wanted, found = (
        np.where(inside, above_mean(work, map, NARROW), np.float32(0.0)) for map in (scan, drawn)
    )
    return _along(wanted, found, 1.0)


def _along(wanted: NDArray[np.float32], way: NDArray[np.float32], otherwise: float) -> float:
    """The number times which `way` (R, R) is nearest to what is wanted; `otherwise` for no way."""
    products = (
        float(np.einsum("ij,ij->i", map, way).sum(dtype=np.float64)) for map in (wanted, way)
    )
    product, square = products
    return product / square if square > 0.0 else otherwise


def _times(gain: float, lines: TracedLines, pores: TracedPores) -> tuple[TracedLines, TracedPores]:
    """Lines and pores with all weights times one number."""
    return (
        changed(lines, gain * lines.weight, lines.half_width),
        changed_pores(pores, gain * pores.weight, pores.size),
    )


def _stepped(
    work: Workspace,
    lines: TracedLines,
    pores: TracedPores,
    maps: tuple[NDArray[np.float32], NDArray[np.float32]],
    settings: AssetSettings,
) -> tuple[TracedLines, TracedPores]:
    """Lines and pores after one step."""
    of_edges, of_pores = sums_of(work, lines, pores, maps, settings)
    of_nodes = np.zeros((len(lines.x), 4))
    for end, columns in ((0, (0, 1, 4, 5)), (1, (2, 3, 6, 7))):
        for to, column in enumerate(columns):
            values = of_edges[:, column]
            of_nodes[:, to] += np.bincount(lines.edges[:, end], values, len(lines.x))
    weight, width = _moved(lines.weight, lines.half_width, of_nodes)
    return changed(lines, weight, width), changed_pores(
        pores, *_moved(pores.weight, pores.size, of_pores)
    )


def _moved(weight: Floats, size: Floats, sums: Floats) -> tuple[Floats, Floats]:
    """Weights and sizes after one step, from the sums (N, 4) of fit.cl."""
    more = _TAKEN * sums[:, 0] / (sums[:, 1] + _HELD_WEIGHT)
    most = _MOST_SHARE * weight + _MOST_WEIGHT
    larger = _TAKEN * sums[:, 2] / (sums[:, 3] + _HELD_SIZE)
    return (
        weight + np.clip(more, -most, most),
        size * np.exp(np.clip(larger, -_MOST_SIZE, _MOST_SIZE)),
    )


def sums_of(
    work: Workspace,
    lines: TracedLines,
    pores: TracedPores,
    maps: tuple[NDArray[np.float32], NDArray[np.float32]],
    settings: AssetSettings,
) -> tuple[Floats, Floats]:
    """(M, 8) of wrinkles and (K, 4) of pores: the sums of fit.cl, tile by tile.

    maps (R, R): what is left of the scan, 0 outside of charts, and what is drawn, mesh units.
    """
    of_edges, of_pores = np.zeros((len(lines), 8)), np.zeros((len(pores), 4))
    count = -(-settings.resolution // _TILE)
    x, y = (v[lines.edges].mean(axis=1) for v in (lines.x, lines.y))
    tiles = zip(_by_tile(x, y, count), _by_tile(pores.x, pores.y, count), strict=True)
    for tile, (edges, some) in enumerate(tiles):
        if len(edges) or len(some):
            corner = (tile // count * _TILE - _AROUND, tile % count * _TILE - _AROUND)
            with work.nested() as nested:
                window = _Window(nested, maps, corner, settings)
                of_edges[edges] = window.of_wrinkles(lines, edges, settings)
                of_pores[some] = window.of_pores(pores, some)
    return of_edges, of_pores


def _by_tile(x: Floats, y: Floats, count: int) -> list[NDArray[np.int64]]:
    """The numbers of the places in each of count² tiles, row by row."""
    column, row = (np.clip(v // _TILE, 0, count - 1).astype(np.int64) for v in (x, y))
    tile = row * count + column
    order = np.argsort(tile, kind="stable")
    return np.split(order, np.searchsorted(tile[order], np.arange(1, count * count)))


class _Window:
    """A tile with what is around it, on the device: what is left without its broad part, and how
    deep narrow valleys are drawn, in depths."""

    def __init__(
        self,
        work: Workspace,
        maps: tuple[NDArray[np.float32], NDArray[np.float32]],
        corner: tuple[int, int],
        settings: AssetSettings,
    ) -> None:
        assert settings.depth is not None
        self._work, self._corner = work, np.array(corner[::-1], np.float64)  # x, y
        self._side = _TILE + 2 * _AROUND
        cushions = _CUSHIONS if settings.shape.cushion > 0.0 else None
        sides = (BROAD, 1.0 / settings.depth), (cushions, -1.0 / settings.depth)
        self._maps = [self._above_mean(m, *s) for m, s in zip(maps, sides, strict=True)]

    def _above_mean(self, values: NDArray[np.float32], side: int | None, factor: float) -> Buffer:
        """What a map is above its mean over `side` texels, or above 0, times a factor. There is a
        row more, for vectors that begin in the last one."""
        radius, rows, columns = (side or 1) - 1, self._side + 1, self._side
        top, left = (int(c) - radius for c in self._corner[::-1])
        padded = cut_out(values, (top, left), (rows + 2 * radius, columns + 2 * radius))
        return above_mean_of_tile(self._work, padded, (rows, columns), side, factor)

    def of_wrinkles(
        self, lines: TracedLines, edges: NDArray[np.int64], settings: AssetSettings
    ) -> Floats:
        """(len(edges), 8) sums of some wrinkles."""
        if not len(edges):
            return np.zeros((0, 8))
        one, two = lines.edges[edges].T
        start = np.stack([lines.x[one], lines.y[one]], axis=1) - self._corner
        extent = np.stack([lines.x[two] - lines.x[one], lines.y[two] - lines.y[one]], axis=1)
        widths, weights = (v[lines.edges[edges]] for v in (lines.half_width, lines.weight))
        s = settings.shape
        form = (s.wrinkle_bulge, s.least_half_width, s.cushion, s.cushion_width)
        given = [np.concatenate(pair, axis=1) for pair in ((start, extent), (widths, weights))]
        given.append(lines.slopes[edges])
        buffers = [self._work.upload(array.astype(np.float32)) for array in given]
        shape = np.array(form, np.float32), CUSHION_THRESHOLD
        return self._run("fit_wrinkles", 8, len(edges), *buffers, *shape)

    def of_pores(self, pores: TracedPores, some: NDArray[np.int64]) -> Floats:
        """(len(some), 4) sums of some pores."""
        if not len(some):
            return np.zeros((0, 4))
        centre = np.stack([pores.x[some], pores.y[some]], axis=1) - self._corner
        root = pores.root[some] / pores.size[some, None]
        given = centre, np.concatenate([root, pores.weight[some, None]], axis=1)
        buffers = [self._work.upload(array.astype(np.float32)) for array in given]
        return self._run("fit_pores", 4, len(some), *buffers)

    def _run(self, kernel: str, width: int, count: int, *given: object) -> Floats:
        found = self._work.empty(width * count, np.float32)
        self._work.run("fit", kernel, count, *given, *self._maps, self._side, found)
        return self._work.read(found, (count, width), np.float32).astype(np.float64)
