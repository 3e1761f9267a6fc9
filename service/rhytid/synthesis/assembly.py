"""The graph from its parts: weights and sizes of wrinkles and pores."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.graph import WrinkleGraph
from rhytid.synthesis import shapes
from rhytid.synthesis.continuations import ends_of
from rhytid.synthesis.drawing import Lines
from rhytid.synthesis.net import Ground
from rhytid.synthesis.progress import Progress
from rhytid.synthesis.rows import row_blocks
from rhytid.synthesis.surface import Points

_LEAST_WEIGHT = 1e-4


@dataclass(frozen=True, eq=False)
class Worn:
    """strength (E,) float32: of all candidate edges.  hubs (H,) int32: the pores where primary
    lines meet."""

    strength: NDArray[np.float32]
    hubs: NDArray[np.int32]


def assemble(
    ground: Ground,
    pores: Points,
    lines: Lines,
    worn: Worn,
    spacing: float,
    rng: np.random.Generator,
    progress: Progress,
) -> WrinkleGraph:
    """Pores and lines with what they are drawn with.

    spacing: mean, of pores.  Nodes beyond a border are as large as their pore and not drawn.
    """
    fields = ground.fields
    weight, factor, half_width, width = _lines(
        ground, pores, lines, worn.strength, spacing, progress
    )
    progress(0.4, "shapes")
    size = shapes.pore_sizes(pores.position, spacing, rng)
    size[worn.hubs] *= np.float32(shapes.HUB)
    size *= fields.pore_radius(pores.triangle, pores.uv)
    progress(0.6, "shapes")
    depth = shapes.pore_weights(lines.nodes, weight, size, rng)
    _scale(depth, fields.pore_strength(pores.triangle, pores.uv))
    _scale(weight, factor)
    metric, radius = shapes.pore_ellipses(ground.surface, pores.triangle, size)
    progress(0.8, "shapes")
    none = np.zeros(len(lines.owner), np.float32)
    ends = ends_of(ground, pores, lines, weight, half_width, width)
    progress(0.9, "shapes")
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
        **ends.arrays(),
    )


def _lines(
    ground: Ground,
    pores: Points,
    lines: Lines,
    strength: NDArray[np.float32],
    spacing: float,
    progress: Progress,
) -> tuple[NDArray[np.float32], ...]:
    """(W,) weights, factors that these still lack, and half widths in UV and on the surface."""
    chosen, fields = strength[lines.edge], ground.fields
    mean = float(chosen.mean(dtype=np.float64))
    weight, factor, half_width, wide = (np.empty(len(chosen), np.float32) for _ in range(4))
    for rows in row_blocks(len(chosen)):
        progress(0.4 * rows.start / len(chosen), "shapes")
        triangle, step = lines.triangle[rows], lines.step[rows]
        middle = pores.uv[lines.nodes[rows, 0]] + np.float32(0.5) * step
        weight[rows] = shapes.edge_weights(chosen[rows], mean)
        width = shapes.widths(weight[rows], spacing) * fields.width(triangle, middle)
        wide[rows] = width
        half_width[rows] = shapes.half_widths_uv(ground.surface, triangle, step, width)
        factor[rows] = fields.strength(triangle, middle)
    second = 1 + np.flatnonzero(lines.edge[1:] == lines.edge[:-1])
    factor[second] = factor[second - 1]  # both halves across a seam are one wrinkle
    return weight, factor, half_width, wide


def _scale(weight: NDArray[np.float32], factor: NDArray[np.float32]) -> None:
    """Times a factor, in place, still above 0 and at most 1."""
    np.clip(weight * factor, _LEAST_WEIGHT, 1.0, out=weight)
