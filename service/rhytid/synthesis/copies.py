"""What reaches over a UV seam, stored once more on each other side of it (see WrinkleGraph)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.graph import LEAST_SIZE, ORIGINAL, STEEPEST
from rhytid.domain.mesh import UV_LIMIT
from rhytid.synthesis.borders import Borders
from rhytid.synthesis.charts import cross
from rhytid.synthesis.surface import BoolArray, FloatArray, IntArray, Surface
from rhytid.synthesis.twins import PLACES, Seams, Shapes, Twins

Arrays = dict[str, NDArray[Any]]
# A support that is longer against its width is not copied: float32 cannot hold its metric.
_LONGEST = 500.0


def with_copies(arrays: Arrays, surface: Surface, borders: Borders, spacing: float) -> Arrays:
    """The arrays of a graph with the copies of its pores and wrinkles after these; themselves
    where nothing reaches over a seam.

    arrays: with metrics and triangles, and with `*_copy_of`.  spacing: on the surface, the least
    of neighbouring pores.
    """
    if len(borders.seams):
        seams = Seams(borders, PLACES * spacing)
        found = _pores(arrays, borders, seams), _wrinkles(arrays, surface, borders, seams)
        first = len(arrays["node_uv"]) + len(found[0]["node_uv"])
        found[1]["edge_nodes"] += first
        arrays = {
            name: np.concatenate([array, *(part[name] for part in found if name in part)])
            for name, array in arrays.items()
        }
    return _without_empty(arrays)


def _without_empty(arrays: Arrays) -> Arrays:
    """Without the arrays that only copies need, where there are none."""
    nodes, edges = ((arrays[f"{kind}_copy_of"] != ORIGINAL).any() for kind in ("node", "edge"))
    needed = {"node_copy_of": nodes, "edge_copy_of": edges, "edge_metric": edges}
    return {name: array for name, array in arrays.items() if needed.get(name, True)}


def _pores(arrays: Arrays, borders: Borders, seams: Seams) -> Arrays:
    """The nodes of copied pores."""
    own = (arrays["node_copy_of"] == ORIGINAL) & (arrays["node_weight"] > 0)
    rows = np.flatnonzero(own)
    centre = arrays["node_uv"][rows].astype(np.float64)
    chart = borders.chart[arrays["node_triangle"][rows]]
    metric = _full(arrays["node_metric"][rows])
    twins = seams.twins(Shapes(centre, np.zeros_like(centre), _roots(metric), chart))
    turned = _turned(metric[twins.of], twins.turn)
    radius = arrays["node_radius"][rows[twins.of]] * _growth(twins)
    place = twins.at(centre[twins.of])
    kept = np.flatnonzero(_holds(turned, place) & (radius <= 1.0))
    of = rows[twins.of[kept]]
    return {
        "node_uv": place[kept].astype(np.float32),
        "node_weight": arrays["node_weight"][of],
        "node_radius": radius[kept].astype(np.float32),
        "node_metric": _flat(turned[kept]),
        "node_triangle": _landing(borders, twins)[kept],
        "node_copy_of": of.astype(np.int32),
    }


def _wrinkles(arrays: Arrays, surface: Surface, borders: Borders, seams: Seams) -> Arrays:
    """Copied wrinkles, and nodes of no strength of their own that these end at; edge_nodes count
    from the first of these nodes on. Gives metrics, and slopes in these, to what is copied, in
    place."""
    rows = np.flatnonzero(arrays["edge_copy_of"] == ORIGINAL)
    shapes, metric = _round_on_surface(arrays, surface, borders, rows)
    twins = seams.twins(shapes)
    turned = _turned(metric[twins.of], twins.turn)
    ends = shapes.start, shapes.start + shapes.step
    start, stop = (twins.at(end[twins.of]) for end in ends)
    length = np.linalg.norm(stop - start, axis=-1)
    # A strip covers det times the area in the other chart, and is as much longer as it is.
    before = np.linalg.norm(shapes.step[twins.of], axis=-1)
    half = arrays["edge_half_width"][rows[twins.of]].astype(np.float64)
    width = half * _growth(twins) ** 2 * before / np.maximum(length, LEAST_SIZE)
    kept = np.flatnonzero(
        _holds(turned, start) & _holds(turned, stop) & _holds(metric[twins.of], start)
        & (length > 2 * LEAST_SIZE) & (width <= 1.0) & (width >= 2 * LEAST_SIZE)
    )  # fmt: skip
    of, count = rows[twins.of[kept]], len(kept)
    arrays["edge_metric"][of] = _flat(metric[twins.of[kept]])
    bent = _in_metric(arrays["edge_slopes"][of], shapes.take(twins.of[kept]))
    arrays["edge_slopes"][of] = bent
    mirrored = np.sign(np.linalg.det(twins.turn[kept])).astype(np.float32)
    wider = (width[kept] / half[kept])[:, None]
    end_widths = np.clip(arrays["edge_end_half_widths"][of] * wider, LEAST_SIZE, 1.0)
    pores = arrays["edge_nodes"][of].ravel()
    first = arrays["node_copy_of"][pores]
    landing = _landing(borders, twins)[kept]
    return {
        "node_uv": np.stack([start, stop], axis=1)[kept].reshape(-1, 2).astype(np.float32),
        "node_weight": np.zeros(2 * count, np.float32),
        "node_radius": arrays["node_radius"][pores],
        "node_metric": arrays["node_metric"][pores],
        "node_triangle": np.repeat(landing, 2),
        "node_copy_of": np.where(first == ORIGINAL, pores, first).astype(np.int32),
        "edge_nodes": np.arange(2 * count, dtype=np.int32).reshape(-1, 2),
        "edge_weight": arrays["edge_weight"][of],
        "edge_half_width": width[kept].astype(np.float32),
        "edge_triangle": landing,
        "edge_copy_of": of.astype(np.int32),
        "edge_metric": _flat(turned[kept]),
        "edge_slopes": bent * mirrored[:, None],
        "edge_end_weights": arrays["edge_end_weights"][of],
        "edge_end_half_widths": end_widths.astype(np.float32),
        "edge_partners": arrays["edge_partners"][of],
    }


def _in_metric(slopes: NDArray[np.float32], lines: Shapes) -> NDArray[np.float32]:
    """(K, 2) slopes (K, 2) of arcs in UV as they are where their supports are round: there arcs of
    both sides of a seam are the same, but for mirrored UV."""
    step, left = lines.step, np.stack([-lines.step[:, 1], lines.step[:, 0]], axis=1)
    along = np.einsum("nij,nj->ni", lines.root, step)
    found = np.zeros_like(slopes)
    for end in (0, 1):
        tangent = step + slopes[:, end, None] * left
        there = np.einsum("nij,nj->ni", lines.root, tangent)
        ahead = (along * there).sum(-1)
        steep = cross(along, there) / np.where(ahead > 0, ahead, np.inf)
        found[:, end] = np.clip(steep, -STEEPEST, STEEPEST)
    return found


def _round_on_surface(
    arrays: Arrays, surface: Surface, borders: Borders, rows: IntArray
) -> tuple[Shapes, FloatArray]:
    """Wrinkles whose ends are round on the surface, as wide as they are, and their metrics.

    Round in UV an end would reach many times as far on the surface where the UV are stretched.
    """
    ends = arrays["node_uv"][arrays["edge_nodes"][rows]].astype(np.float64)
    step, triangle = ends[:, 1] - ends[:, 0], arrays["edge_triangle"][rows]
    longer = np.linalg.norm(surface.along(triangle, step), axis=-1) / np.linalg.norm(step, axis=-1)
    width = arrays["edge_half_width"][rows] * surface.density[triangle] / longer
    jacobian = surface.jacobian[triangle]
    metric = jacobian.transpose(0, 2, 1) @ jacobian / np.square(width)[:, None, None]
    return Shapes(ends[:, 0], step, _roots(metric), borders.chart[triangle]), metric


def _roots(metric: FloatArray) -> FloatArray:
    """(N, 2, 2) with rootᵀ·root = metric."""
    roots: FloatArray = np.linalg.cholesky(metric).transpose(0, 2, 1)
    return roots


def _turned(metric: FloatArray, turn: FloatArray) -> FloatArray:
    """(T, 2, 2) metrics (T, 2, 2) as they are in the UV that `turn` (T, 2, 2) leads to."""
    back = np.linalg.inv(turn)
    turned: FloatArray = back.transpose(0, 2, 1) @ metric @ back
    return turned


def _holds(metric: FloatArray, uv: FloatArray) -> BoolArray:
    """(T,) whether a graph can hold a support at a place."""
    sizes = np.linalg.eigvalsh(metric)
    slim = sizes[:, 1] <= _LONGEST**2 * sizes[:, 0]
    sized = (sizes[:, 0] > 1.001) & (sizes[:, 1] * LEAST_SIZE**2 < 0.5)
    holds: BoolArray = slim & sized & (np.abs(uv) < UV_LIMIT).all(axis=1)
    return holds


def _growth(twins: Twins) -> FloatArray:
    """(T,) UV length in the other chart per UV length, the mean of both directions."""
    growth: FloatArray = np.sqrt(np.abs(np.linalg.det(twins.turn)))
    return growth


def _landing(borders: Borders, twins: Twins) -> NDArray[np.int32]:
    """(T,) the triangle across the seam."""
    landing: NDArray[np.int32] = borders.triangle[borders.mate[twins.side]].astype(np.int32)
    return landing


def _full(metric: NDArray[np.float32]) -> FloatArray:
    full: FloatArray = metric.astype(np.float64)[:, [0, 1, 1, 2]].reshape(-1, 2, 2)
    return full


def _flat(metric: FloatArray) -> NDArray[np.float32]:
    flat: NDArray[np.float32] = metric.reshape(-1, 4)[:, [0, 1, 3]].astype(np.float32)
    return flat
