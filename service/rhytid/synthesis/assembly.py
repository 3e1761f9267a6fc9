"""The graph from its parts: weights and sizes of wrinkles and pores."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.graph import ORIGINAL, WrinkleGraph
from rhytid.synthesis import shapes
from rhytid.synthesis.arrays import Arrays, row_blocks
from rhytid.synthesis.drawing import Lines
from rhytid.synthesis.edges.candidate_graph import Ground
from rhytid.synthesis.hashes import place_keys
from rhytid.synthesis.pores.even_skin import Usual
from rhytid.synthesis.pores.pore_shapes import pore_axes, pore_ellipses
from rhytid.synthesis.progress import Progress
from rhytid.synthesis.seams.borders import Borders
from rhytid.synthesis.seams.copies import with_copies
from rhytid.synthesis.surface import Points
from rhytid.synthesis.trails.continuations import ends_of
from rhytid.synthesis.trails.rim import beside_bare

_LEAST_WEIGHT = 1e-4
# Seams are looked at as closely as painted density can ask for: were it as closely as it does, what
# is painted in one place would move copies at all seams.
_CLOSEST = 8.0**-0.5


@dataclass(frozen=True, eq=False)
class Worn:
    """strength (E,) float32: of all candidate edges.  hubs (H,) int32: the pores where primary
    lines meet.  usual: what strengths are meant against.
    """

    strength: NDArray[np.float32]
    hubs: NDArray[np.int32]
    usual: Usual


def assemble(
    ground: Ground,
    pores: Points,
    lines: Lines,
    borders: Borders,
    worn: Worn,
    spacing: float,
    seed: int,
    progress: Progress,
) -> WrinkleGraph:
    """Pores and lines with what they are drawn with, and copies of what reaches over a seam.

    spacing: mean, of pores on even skin.  Nodes beyond a border are as large as their pore and not
    drawn.
    """
    fields = ground.fields
    weight, factor, half_width, width = _lines(ground, pores, lines, worn, spacing, progress)
    progress(0.4, "shapes")
    key = place_keys(pores.uv)
    size = shapes.pore_sizes(pores.position / spacing, key, seed)
    size[worn.hubs] *= np.float32(shapes.HUB)
    size *= fields.pore_radius(pores.triangle, pores.uv)
    progress(0.6, "shapes")
    first = lines.copy_of == ORIGINAL
    usual = np.float32(fields.usual_pore_radius)
    strengths, meeting = weight[first], worn.usual.meeting
    depth = shapes.pore_weights(lines.pores[first], strengths, meeting, size / usual, key, seed)
    size *= np.float32(shapes.PORE_SIZE * spacing)
    _scale(depth, fields.pore_strength(pores.triangle, pores.uv))
    _scale(weight, factor)
    axes = pore_axes(
        ground.surface, pores.triangle, lines.nodes[first], lines.step[first], strengths, key, seed
    )
    metric, radius = pore_ellipses(ground.surface, pores.triangle, size, *axes)
    progress(0.8, "shapes")
    none = np.zeros(len(lines.owner), np.float32)
    ends = ends_of(ground, pores, lines, weight, half_width, width)
    progress(0.9, "shapes")
    arrays = {
        "node_uv": np.concatenate([pores.uv, lines.beyond]),
        "node_weight": np.concatenate([depth, none]),
        "node_radius": np.concatenate([radius, radius[lines.owner]]),
        "node_metric": np.concatenate([metric, metric[lines.owner]]),
        "node_triangle": np.concatenate([pores.triangle, pores.triangle[lines.owner]]),
        "node_copy_of": np.concatenate([np.full(len(pores), ORIGINAL), lines.stands_for]),
        "edge_nodes": lines.nodes,
        "edge_weight": weight,
        "edge_half_width": half_width,
        "edge_triangle": lines.triangle,
        "edge_copy_of": lines.copy_of,
        "edge_metric": np.zeros((len(weight), 3), np.float32),
        **ends.arrays(),
    }
    least = spacing * min(fields.least_spacing, _CLOSEST)
    arrays = with_copies(arrays, ground.surface, borders, least)
    grain = fields.grain(pores.triangle, pores.uv)
    return WrinkleGraph(**arrays, **_grain(arrays, grain, lines.owner), origin=None)


def _grain(arrays: Arrays, grain: NDArray[np.float32], owner: NDArray[np.integer]) -> Arrays:
    """`node_grain` from that of the pores, nothing where it is 1 throughout. Nodes of pores come
    first, then ends of their wrinkles, then copies."""
    if (grain == 1.0).all():
        return {}
    found = np.concatenate([grain, grain[owner]])
    if len(found) < len(arrays["node_uv"]):
        found = np.concatenate([found, found[arrays["node_copy_of"][len(found) :]]])
    return {"node_grain": found}


def _lines(
    ground: Ground,
    pores: Points,
    lines: Lines,
    worn: Worn,
    spacing: float,
    progress: Progress,
) -> tuple[NDArray[np.float32], ...]:
    """(W,) weights, factors that these still lack, and half widths in UV and on the surface."""
    chosen, fields = worn.strength[lines.edge], ground.fields
    uv = np.concatenate([pores.uv, lines.beyond])
    weight, factor, half_width, wide = (np.empty(len(chosen), np.float32) for _ in range(4))
    for rows in row_blocks(len(chosen)):
        progress(0.4 * rows.start / len(chosen), "shapes")
        triangle, step = lines.triangle[rows], lines.step[rows]
        middle = uv[lines.nodes[rows, 0]] + np.float32(0.5) * step
        weight[rows] = shapes.edge_weights(chosen[rows], worn.usual.strength)
        width = shapes.widths(weight[rows], spacing) * fields.width(triangle, middle)
        wide[rows] = width
        half_width[rows] = shapes.half_widths_uv(ground.surface, triangle, step, width)
        factor[rows] = fields.strength(triangle, middle)
        if fields.some_bare:
            factor[rows] *= beside_bare(
                ground.surface, ground.across, fields, triangle, middle, spacing
            )
        if fields.some_contrast:
            factor[rows] *= weight[rows] ** (fields.contrast(triangle, middle) - 1.0)
    second = np.flatnonzero(lines.copy_of != ORIGINAL)
    factor[second] = factor[lines.copy_of[second]]  # both halves across a seam are one wrinkle
    return weight, factor, half_width, wide


def _scale(weight: NDArray[np.float32], factor: NDArray[np.float32]) -> None:
    """Times a factor, in place, still above 0 and at most 1."""
    np.clip(weight * factor, _LEAST_WEIGHT, 1.0, out=weight)
