"""The graph from its parts: weights and sizes of wrinkles and pores."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.graph import WrinkleGraph
from rhytid.synthesis import shapes
from rhytid.synthesis.drawing import Lines
from rhytid.synthesis.fields import Fields
from rhytid.synthesis.progress import Progress
from rhytid.synthesis.rows import row_blocks
from rhytid.synthesis.surface import Points, Surface

_LEAST_WEIGHT = 1e-4


def assemble(
    surface: Surface,
    pores: Points,
    lines: Lines,
    strength: NDArray[np.float32],
    hubs: NDArray[np.int32],
    spacing: float,
    rng: np.random.Generator,
    fields: Fields,
    progress: Progress,
) -> WrinkleGraph:
    """Pores and lines with what they are drawn with.

    strength: of all candidate edges.  hubs: the pores where primary lines meet.  spacing: mean, of
    pores.  Nodes beyond a border are as large as their pore and not drawn.
    """
    weight, factor, half_width = _lines(surface, pores, lines, strength, spacing, fields, progress)
    progress(0.4, "shapes")
    size = shapes.pore_sizes(pores.position, spacing, rng)
    size[hubs] *= np.float32(shapes.HUB)
    size *= fields.pore_radius(pores.triangle, pores.uv)
    progress(0.6, "shapes")
    depth = shapes.pore_weights(lines.nodes, weight, size, rng)
    _scale(depth, fields.pore_strength(pores.triangle, pores.uv))
    _scale(weight, factor)
    metric, radius = shapes.pore_ellipses(surface, pores.triangle, size)
    progress(0.8, "shapes")
    none = np.zeros(len(lines.owner), np.float32)
    return WrinkleGraph(
        node_uv=np.concatenate([pores.uv, lines.beyond]),
        node_weight=np.concatenate([depth, none]),
        node_radius=np.concatenate([radius, radius[lines.owner]]),
        node_metric=np.concatenate([metric, metric[lines.owner]]),
        node_triangle=np.concatenate([pores.triangle, pores.triangle[lines.owner]]),
        edge_nodes=lines.nodes,
        edge_weight=weight,
        edge_half_width=half_width,
        edge_triangle=lines.triangle,
    )


def _lines(
    surface: Surface,
    pores: Points,
    lines: Lines,
    strength: NDArray[np.float32],
    spacing: float,
    fields: Fields,
    progress: Progress,
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """(W,) weights, factors that these still lack, and half widths in UV."""
    chosen = strength[lines.edge]
    mean = float(chosen.mean(dtype=np.float64))
    weight, factor, half_width = (np.empty(len(chosen), np.float32) for _ in range(3))
    for rows in row_blocks(len(chosen)):
        progress(0.4 * rows.start / len(chosen), "shapes")
        triangle, step = lines.triangle[rows], lines.step[rows]
        middle = pores.uv[lines.nodes[rows, 0]] + np.float32(0.5) * step
        weight[rows] = shapes.edge_weights(chosen[rows], mean)
        width = shapes.widths(weight[rows], spacing) * fields.width(triangle, middle)
        half_width[rows] = shapes.half_widths_uv(surface, triangle, step, width)
        factor[rows] = fields.strength(triangle, middle)
    second = 1 + np.flatnonzero(lines.edge[1:] == lines.edge[:-1])
    factor[second] = factor[second - 1]  # both halves across a seam are one wrinkle
    return weight, factor, half_width


def _scale(weight: NDArray[np.float32], factor: NDArray[np.float32]) -> None:
    """Times a factor, in place, still above 0 and at most 1."""
    np.clip(weight * factor, _LEAST_WEIGHT, 1.0, out=weight)
