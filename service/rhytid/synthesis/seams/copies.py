"""What reaches over a UV seam, stored once more on each other side of it (see WrinkleGraph)."""

from __future__ import annotations

import numpy as np

from rhytid.domain.graph import ORIGINAL
from rhytid.synthesis.arrays import Arrays
from rhytid.synthesis.seams.borders import Borders
from rhytid.synthesis.seams.copied_pores import copied_pores
from rhytid.synthesis.seams.copied_wrinkles import copied_wrinkles
from rhytid.synthesis.seams.reaching import PLACES, Seams
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
