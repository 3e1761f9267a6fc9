"""Pores that reach over a UV seam, stored once more on each other side of it."""

from __future__ import annotations

import numpy as np

from rhytid.domain.graph import ORIGINAL
from rhytid.synthesis.arrays import Arrays
from rhytid.synthesis.seams.borders import Borders
from rhytid.synthesis.seams.reaching import WIDEST, Seams
from rhytid.synthesis.seams.supports import Supports
from rhytid.synthesis.seams.uv_metrics import flat, full, holds, roots, turned


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
