"""What reaches over a UV seam, stored once more on each other side of it (see WrinkleGraph)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.asset_settings import CUSHION_THRESHOLD, ResponseSettings, ShapeSettings
from rhytid.domain.graph import LEAST_SIZE, ORIGINAL, STEEPEST
from rhytid.domain.mesh import UV_LIMIT
from rhytid.synthesis.progress import Progress, over_rows, part, silent
from rhytid.synthesis.seams.borders import Borders
from rhytid.synthesis.seams.footprints import Footprints, Placements
from rhytid.synthesis.seams.seams import FURTHER, PLACES, WIDEST, Seams
from rhytid.synthesis.surface import BoolArray, FloatArray, IntArray, Surface, cross

# The arrays of a graph while it is put together, by their names in WrinkleGraph.
Arrays = dict[str, NDArray[Any]]
# Wrinkles that swell the skin are followed as far as their broad layer goes at the most stretch
# that the usual response knows. As far as any response goes would be twice as many copies.
_BROADEST = FURTHER + ShapeSettings().cushion_width * math.exp(
    ResponseSettings().alpha_w * ResponseSettings().log_stretch_limit
)
# A footprint that is longer against its width is not copied: float32 cannot hold its metric.
_LONGEST = 500.0


def with_copies(
    arrays: Arrays,
    surface: Surface,
    borders: Borders,
    spacing: float,
    progress: Progress = silent,
) -> Arrays:
    """The arrays of a graph with the copies of its pores and wrinkles after these; themselves
    where nothing reaches over a seam.

    arrays: with metrics and triangles, and with `*_copy_of`; replaced in their dictionary one by
    one, so that no more than one is there twice.  spacing: on the surface, the least
    of neighbouring pores.
    """
    if len(borders.seams):
        seams = Seams(borders, PLACES * spacing)
        of_pores, of_wrinkles = part(progress, 0.0, 0.5), part(progress, 0.5, 1.0)
        pores = copied_pores(arrays, borders, seams, of_pores)
        found = pores, copied_wrinkles(arrays, surface, borders, seams, of_wrinkles)
        first = len(arrays["node_uv"]) + len(found[0]["node_uv"])
        found[1]["edge_nodes"] += first
        for name in arrays:
            more = [part[name] for part in found if name in part]
            arrays[name] = np.concatenate([arrays[name], *more])
    return _without_empty(arrays)


def _without_empty(arrays: Arrays) -> Arrays:
    """Without the arrays that only copies and metrics need, where there are none."""
    nodes, edges = ((arrays[f"{kind}_copy_of"] != ORIGINAL).any() for kind in ("node", "edge"))
    metrics = arrays["edge_metric"].any()
    needed = {"node_copy_of": nodes, "edge_copy_of": edges, "edge_metric": metrics}
    return {name: array for name, array in arrays.items() if needed.get(name, True)}


def copied_pores(
    arrays: Arrays, borders: Borders, seams: Seams, progress: Progress = silent
) -> Arrays:
    """The nodes of the copies of pores, by their names in a graph."""
    own = np.flatnonzero((arrays["node_copy_of"] == ORIGINAL) & (arrays["node_weight"] > 0))

    def footprints_of(rows: slice) -> list[Footprints]:
        return [_ellipses(arrays, borders, own[rows])[0]]

    rows = own[_near_borders(seams, len(own), footprints_of)]
    footprints, metric = _ellipses(arrays, borders, rows)
    centre, placements = footprints.start, seams.placements(footprints, progress)
    there = turned(metric[placements.of], placements.turn)
    radius = arrays["node_radius"][rows[placements.of]] * placements.growth()
    place = placements.at(centre[placements.of])
    kept = np.flatnonzero(holds(there, place) & (radius <= 1.0))
    of = rows[placements.of[kept]]
    return {
        "node_uv": place[kept].astype(np.float32),
        "node_weight": arrays["node_weight"][of],
        "node_radius": radius[kept].astype(np.float32),
        "node_metric": flat(there[kept]),
        "node_triangle": placements.landing(borders)[kept],
        "node_copy_of": of.astype(np.int32),
        **({"node_kind": arrays["node_kind"][of]} if "node_kind" in arrays else {}),
    }


def copied_wrinkles(
    arrays: Arrays,
    surface: Surface,
    borders: Borders,
    seams: Seams,
    progress: Progress = silent,
) -> Arrays:
    """The copied wrinkles, and the nodes without strength that they end at.

    `edge_nodes` count from the first of these nodes on. Wrinkles of `arrays` that reach a seam get
    metrics, and slopes in these, in place. Both halves of a wrinkle that is cut at a seam are
    copied.
    """

    def footprints_of(rows: slice) -> list[Footprints]:
        own, _ = _round_on_surface(arrays, surface, borders, rows)
        return [own, _round_in_uv(arrays, own, rows)]

    rows = _near_borders(seams, len(arrays["edge_weight"]), footprints_of)
    footprints, metric = _round_on_surface(arrays, surface, borders, rows)
    placements = seams.placements(footprints, progress)
    half_width = arrays["edge_half_width"][rows].astype(np.float64)
    placements, width = _held(half_width, footprints, metric, placements)
    _give_metrics(arrays, rows, seams, footprints, metric, placements)
    of, count = rows[placements.of], len(placements)
    mirrored = np.sign(np.linalg.det(placements.turn)).astype(np.float32)
    wider = (width / half_width[placements.of])[:, None]
    end_widths = np.clip(arrays["edge_end_half_widths"][of] * wider, LEAST_SIZE, 1.0)
    pores, whole = arrays["edge_nodes"][of].ravel(), arrays["edge_copy_of"][of]
    first = arrays["node_copy_of"][pores]
    ends = np.stack(_ends(footprints, placements), axis=1)
    landing = placements.landing(borders)
    return {
        "node_uv": ends.reshape(-1, 2).astype(np.float32),
        "node_weight": np.zeros(2 * count, np.float32),
        "node_radius": arrays["node_radius"][pores],
        "node_metric": arrays["node_metric"][pores],
        "node_triangle": np.repeat(landing, 2),
        "node_copy_of": np.where(first == ORIGINAL, pores, first).astype(np.int32),
        "node_kind": np.zeros(2 * count, np.int32),
        "edge_nodes": np.arange(2 * count, dtype=np.int32).reshape(-1, 2),
        "edge_weight": arrays["edge_weight"][of],
        "edge_half_width": width.astype(np.float32),
        "edge_triangle": landing,
        "edge_copy_of": np.where(whole == ORIGINAL, of, whole).astype(np.int32),
        "edge_metric": flat(turned(metric[placements.of], placements.turn)),
        "edge_slopes": arrays["edge_slopes"][of] * mirrored[:, None],
        "edge_end_weights": arrays["edge_end_weights"][of],
        "edge_end_half_widths": end_widths.astype(np.float32),
        "edge_partners": arrays["edge_partners"][of],
        **({"edge_share": arrays["edge_share"][of]} if "edge_share" in arrays else {}),
    }


def _near_borders(
    seams: Seams, count: int, footprints_of: Callable[[slice], list[Footprints]]
) -> IntArray:
    """Of so many elements those that may reach a border of a chart, ascending.

    footprints_of: makes what some of them cover, in every way that they are looked at.
    """
    near = np.zeros(count, np.bool_)

    def look(rows: slice) -> None:
        for footprints in footprints_of(rows):
            near[rows.start + seams.nearby(footprints)] = True

    over_rows(count, look)
    return np.flatnonzero(near)


def _ellipses(arrays: Arrays, borders: Borders, rows: IntArray) -> tuple[Footprints, FloatArray]:
    """Pores of rows (K,), and their metrics."""
    centre = arrays["node_uv"][rows].astype(np.float64)
    chart = borders.chart[arrays["node_triangle"][rows]]
    metric = full(arrays["node_metric"][rows])
    none, widest = np.zeros_like(centre), np.full(len(rows), WIDEST)
    return Footprints(centre, none, roots(metric), chart, widest, none), metric


def _held(
    half_width: FloatArray, footprints: Footprints, metric: FloatArray, placements: Placements
) -> tuple[Placements, FloatArray]:
    """The placements that a graph can hold, and the half width (T,) of each.

    half_width (K,): of the elements in their own charts.
    """
    start, stop = _ends(footprints, placements)
    length = np.linalg.norm(stop - start, axis=-1)
    # A strip covers det times the area in the other chart, and is as much longer as it is.
    before = np.linalg.norm(footprints.step[placements.of], axis=-1)
    width = (
        half_width[placements.of]
        * placements.growth() ** 2
        * before
        / np.maximum(length, LEAST_SIZE)
    )
    there = turned(metric[placements.of], placements.turn)
    kept = np.flatnonzero(
        holds(there, start) & holds(there, stop) & holds(metric[placements.of], start)
        & (length > 2 * LEAST_SIZE) & (width <= 1.0) & (width >= 2 * LEAST_SIZE)
    )  # fmt: skip
    return placements.take(kept), width[kept]


def _ends(footprints: Footprints, placements: Placements) -> tuple[FloatArray, FloatArray]:
    """(T, 2) and (T, 2): both ends of the wrinkle of each placement, where it is drawn."""
    ends = footprints.start, footprints.start + footprints.step
    start, stop = (placements.at(end[placements.of]) for end in ends)
    return start, stop


def _give_metrics(
    arrays: Arrays,
    rows: IntArray,
    seams: Seams,
    footprints: Footprints,
    metric: FloatArray,
    placements: Placements,
) -> None:
    """Give a metric to each wrinkle that is copied, and to each that would reach a seam if it were
    drawn as wide in UV in every direction: a wrinkle that does not reach the seam on the surface
    must not be seen there.

    rows (K,): of the wrinkles that the footprints are of.
    """
    over = seams.reaching(_round_in_uv(arrays, footprints, rows))
    over = over[holds(metric[over], footprints.start[over])]
    given = np.union1d(over, placements.of)
    arrays["edge_metric"][rows[given]] = flat(metric[given])
    arrays["edge_slopes"][rows[given]] = footprints.slopes[given]


def _round_in_uv(arrays: Arrays, footprints: Footprints, rows: IntArray | slice) -> Footprints:
    """The same wrinkles as wide in UV in every direction."""
    half_width = arrays["edge_half_width"][rows].astype(np.float64)
    slopes = arrays["edge_slopes"][rows].astype(np.float64)
    return replace(footprints, root=np.eye(2) / half_width[:, None, None], slopes=slopes)


def _in_metric(
    slopes: NDArray[np.float32], root: FloatArray, step: FloatArray
) -> NDArray[np.float32]:
    """(K, 2) slopes of arcs, given in UV, as they are in the metric that makes footprints round.
    There the arcs of both sides of a seam are the same, but for mirrored UV."""
    left = np.stack([-step[:, 1], step[:, 0]], axis=1)
    along = np.einsum("nij,nj->ni", root, step)
    found = np.zeros_like(slopes)
    for end in (0, 1):
        tangent = step + slopes[:, end, None] * left
        there = np.einsum("nij,nj->ni", root, tangent)
        ahead = (along * there).sum(-1)
        steep = cross(along, there) / np.where(ahead > 0, ahead, np.inf)
        found[:, end] = np.clip(steep, -STEEPEST, STEEPEST)
    return found


def _round_on_surface(
    arrays: Arrays, surface: Surface, borders: Borders, rows: IntArray | slice
) -> tuple[Footprints, FloatArray]:
    """Wrinkles of rows (K,) with ends that are round on the surface, as wide as they are, and their
    metrics.

    Round in UV an end would reach many times as far on the surface where the UV are stretched.
    """
    ends = arrays["node_uv"][arrays["edge_nodes"][rows]].astype(np.float64)
    step, triangle = ends[:, 1] - ends[:, 0], arrays["edge_triangle"][rows]
    longer = np.linalg.norm(surface.along(triangle, step), axis=-1) / np.linalg.norm(step, axis=-1)
    width = arrays["edge_half_width"][rows] * surface.density[triangle] / longer
    jacobian = surface.jacobian[triangle]
    metric = jacobian.transpose(0, 2, 1) @ jacobian / np.square(width)[:, None, None]
    widest = np.where(_swells(arrays, rows), _BROADEST, WIDEST)
    chart = borders.chart[triangle]
    root = roots(metric)
    slopes = _in_metric(arrays["edge_slopes"][rows], root, step).astype(np.float64)
    return Footprints(ends[:, 0], step, root, chart, widest, slopes), metric


def _swells(arrays: Arrays, rows: IntArray | slice) -> BoolArray:
    """(K,) whether a wrinkle is in the broad layer, anywhere along it."""
    at_ends = arrays["edge_end_weights"][rows].max(axis=1)
    strongest = np.maximum(arrays["edge_weight"][rows], at_ends)
    swells: BoolArray = strongest > CUSHION_THRESHOLD
    return swells


def roots(metric: FloatArray) -> FloatArray:
    """(N, 2, 2) with rootᵀ·root = metric."""
    root: FloatArray = np.linalg.cholesky(metric).transpose(0, 2, 1)
    return root


def turned(metric: FloatArray, turn: FloatArray) -> FloatArray:
    """(T, 2, 2) metrics in the UV that `turn` (T, 2, 2) leads to."""
    back = np.linalg.inv(turn)
    there: FloatArray = back.transpose(0, 2, 1) @ metric @ back
    return there


def holds(metric: FloatArray, uv: FloatArray) -> BoolArray:
    """(T,) whether a graph can hold a footprint at a place."""
    sizes = np.linalg.eigvalsh(metric)
    slim = sizes[:, 1] <= _LONGEST**2 * sizes[:, 0]
    sized = (sizes[:, 0] > 1.001) & (sizes[:, 1] * LEAST_SIZE**2 < 0.5)
    held: BoolArray = slim & sized & (np.abs(uv) < UV_LIMIT).all(axis=1)
    return held


def full(metric: NDArray[np.float32]) -> FloatArray:
    """(N, 2, 2) metrics (N, 3) of a graph."""
    whole: FloatArray = metric.astype(np.float64)[:, [0, 1, 1, 2]].reshape(-1, 2, 2)
    return whole


def flat(metric: FloatArray) -> NDArray[np.float32]:
    """(N, 3) metrics as a graph has them, from metrics (N, 2, 2)."""
    three: NDArray[np.float32] = metric.reshape(-1, 4)[:, [0, 1, 3]].astype(np.float32)
    return three
