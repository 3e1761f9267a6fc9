"""What reaches over a UV seam, stored once more on each other side of it (see WrinkleGraph)."""

from __future__ import annotations

import numpy as np

from rhytid.domain.graph import ORIGINAL
from rhytid.synthesis.arrays import Arrays
from rhytid.synthesis.seams.borders import Borders
from rhytid.synthesis.seams.copied_wrinkles import copied_wrinkles
from rhytid.synthesis.seams.reaching import PLACES, WIDEST, Seams
from rhytid.synthesis.seams.supports import Supports
from rhytid.synthesis.seams.uv_metrics import flat, full, holds, roots, turned
from rhytid.synthesis.surface import Surface


def with_copies(arrays: Arrays, surface: Surface, borders: Borders, spacing: float) -> Arrays:
    """The arrays of a graph with the copies of its pores and wrinkles after these; themselves
    where nothing reaches over a seam.

    arrays: with metrics and triangles, and with `*_copy_of`.  spacing: on the surface, the least
    of neighbouring pores.
    """
    if len(borders.seams):
        seams = Seams(borders, PLACES * spacing)
        pores = copied_pores(arrays, borders, seams)
        found = pores, copied_wrinkles(arrays, surface, borders, seams)
        first = len(arrays["node_uv"]) + len(found[0]["node_uv"])
        found[1]["edge_nodes"] += first
        arrays = {
            name: np.concatenate([array, *(part[name] for part in found if name in part)])
            for name, array in arrays.items()
        }
    return _without_empty(arrays)


def _without_empty(arrays: Arrays) -> Arrays:
    """Without the arrays that only copies and metrics need, where there are none."""
    nodes, edges = ((arrays[f"{kind}_copy_of"] != ORIGINAL).any() for kind in ("node", "edge"))
    metrics = arrays["edge_metric"].any()
    needed = {"node_copy_of": nodes, "edge_copy_of": edges, "edge_metric": metrics}
    return {name: array for name, array in arrays.items() if needed.get(name, True)}


def copied_pores(arrays: Arrays, borders: Borders, seams: Seams) -> Arrays:
    """The nodes of copied pores."""
    own = (arrays["node_copy_of"] == ORIGINAL) & (arrays["node_weight"] > 0)
    rows = np.flatnonzero(own)
    centre = arrays["node_uv"][rows].astype(np.float64)
    chart = borders.chart[arrays["node_triangle"][rows]]
    metric = full(arrays["node_metric"][rows])
    none, widest = np.zeros_like(centre), np.full(len(rows), WIDEST)
    twins = seams.twins(Supports(centre, none, roots(metric), chart, widest, none))
    there = turned(metric[twins.of], twins.turn)
    radius = arrays["node_radius"][rows[twins.of]] * twins.growth()
    place = twins.at(centre[twins.of])
    kept = np.flatnonzero(holds(there, place) & (radius <= 1.0))
    of = rows[twins.of[kept]]
    return {
        "node_uv": place[kept].astype(np.float32),
        "node_weight": arrays["node_weight"][of],
        "node_radius": radius[kept].astype(np.float32),
        "node_metric": flat(there[kept]),
        "node_triangle": twins.landing(borders)[kept],
        "node_copy_of": of.astype(np.int32),
    }
