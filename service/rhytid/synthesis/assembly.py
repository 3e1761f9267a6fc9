"""Puts a graph together: weights and sizes of wrinkles and pores, and their copies at UV seams."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.graph import ORIGINAL, WrinkleGraph
from rhytid.synthesis import shapes
from rhytid.synthesis.candidate_graph import Ground
from rhytid.synthesis.crows_feet import crows_feet
from rhytid.synthesis.events import Events
from rhytid.synthesis.fields import Fields, looked_up
from rhytid.synthesis.hashes import place_keys
from rhytid.synthesis.leader_families import leading_any_way
from rhytid.synthesis.leaders import unit_length
from rhytid.synthesis.lines import Lines, ends_of, joins_of
from rhytid.synthesis.perioral import perioral_lines
from rhytid.synthesis.pore_density import Usual
from rhytid.synthesis.progress import Progress, over_block, over_rows, row_blocks
from rhytid.synthesis.ranks import RankedLines, Ranks, calm_of
from rhytid.synthesis.seams.borders import Borders
from rhytid.synthesis.seams.charts import trace
from rhytid.synthesis.seams.copies import Arrays, with_copies
from rhytid.synthesis.shapes import pore_axes, pore_ellipses
from rhytid.synthesis.strands import unevenness
from rhytid.synthesis.strips import Strips
from rhytid.synthesis.surface import Points, Surface

_LEAST_WEIGHT = 1e-4
# How far leaders follow patches, of how far other lines do.
_PATCHED = np.float32(0.4)
# The most patchiness of swells among leaders: lively ones would be lumps, and beads where pressed.
_CALM = np.float32(1.8)
# What nodes have around them where a graph has no array of it.
_USUAL = {"node_grain": 1.0, "node_undulation": 1.0, "node_patchiness": 0.0}
# Seams are looked at as closely as painted density can ask for: were it as closely as it does, what
# is painted in one place would move copies at all seams.
_CLOSEST = 8.0**-0.5
# How far around a line skin is looked at, in pore spacings, and in how many directions.
_REACH, _LOOKS = 2.0, 8
# Lines that get their sizes between two reports of progress.
_LINES = 1 << 21
# Power of the share that is not bare. At the rim half is; lines along it are then as deep as
# others, within a tenth.
_FADING = 1.25


@dataclass(frozen=True, eq=False)
class EdgeStrengths:
    """Strengths of a candidate graph.

    strength (E,) float32: of all candidate edges.  hubs (H,) int32: the pores where primary lines
    meet.  usual: means of even skin, which strengths are measured against.  ranks: leaders, if skin
    has any.
    """

    strength: NDArray[np.float32]
    hubs: NDArray[np.int32]
    usual: Usual
    ranks: Ranks | None = None


@dataclass(frozen=True, eq=False)
class GraphParts:
    """The pores of a graph and the lines between them, to be given sizes and weights.

    spacing: mean distance of a pore to the nearest on even skin, in units of the surface.  events:
    None where there are none.
    """

    ground: Ground
    pores: Points
    lines: Lines
    borders: Borders
    strengths: EdgeStrengths
    spacing: float
    seed: int
    events: Events | None = None

    def arrays(self, progress: Progress, copying: Progress) -> Arrays:
        """The arrays of the graph: pores and lines with sizes and weights, and copies of those that
        reach over a seam, which have a progress of their own. Nodes beyond a border are as large as
        their pore and are not drawn."""
        ground, pores, lines, fields = self.ground, self.pores, self.lines, self.ground.fields
        weight, factor, half_width, width = self._sizes_of_lines(progress)
        progress(0.4, "shapes")
        drawn_strength = weight[: lines.whole].copy()
        _scale(weight, factor)
        del factor
        none = np.zeros(len(lines.owner), np.float32)
        ranks = self.strengths.ranks
        leads = None if ranks is None else ranks.leads[lines.edge]
        aged = None if leads is None else self._aged(leads, (weight, width, half_width))
        if leads is not None and aged is not None:
            leads |= aged
        joins = joins_of(ground, pores, lines, weight, leads)
        if ranks is not None:
            amount = ranks.unevenness(lines.edge, lines.pores)
            if aged is not None:
                amount[aged] = 0.0
            fainter, narrower = unevenness(pores, lines, joins.partners, amount, self.seed)
            _scale(weight, fainter)
            width *= narrower
            half_width *= narrower
            del amount, fainter, narrower
        progress(0.6, "shapes")
        shares = self._shares(weight, width)  # what else there is of the graph comes after it
        progress(0.7, "shapes")
        depth, metric, radius = self._shapes_of_pores(drawn_strength, progress)
        del drawn_strength
        progress(0.9, "shapes")
        ends = ends_of(lines, joins, weight, half_width, width)
        del joins, width
        arrays = {
            "node_uv": np.concatenate([pores.uv, lines.beyond]),
            "node_weight": np.concatenate([depth, none]),
            "node_radius": np.concatenate([radius, radius[lines.owner]]),
            "node_metric": np.concatenate([metric, metric[lines.owner]]),
            "node_triangle": np.concatenate([pores.triangle, pores.triangle[lines.owner]]),
            "node_copy_of": np.concatenate(
                [np.full(len(pores), ORIGINAL, np.int32), lines.stands_for]
            ),
            "edge_nodes": lines.nodes,
            "edge_weight": weight,
            "edge_half_width": half_width,
            "edge_triangle": lines.triangle,
            "edge_copy_of": lines.copy_of,
            "edge_metric": np.zeros((len(weight), 3), np.float32),
            **ends.arrays(),
            **shares,
        }
        del depth, metric, radius
        beside = self._beside()
        if self.events is not None:
            arrays = self.events.added_to(arrays)
        least = self.spacing * min(fields.least_spacing, _CLOSEST)

        def over_seams(fraction: float, stage: str) -> None:
            copying(fraction, "shapes")

        arrays = with_copies(arrays, ground.surface, self.borders, least, over_seams)
        return arrays | _of_nodes(arrays, beside)

    def _aged(
        self, leads: NDArray[np.bool_], sizes: tuple[NDArray[np.float32], ...]
    ) -> NDArray[np.bool_] | None:
        """Which lines (W,) age draws from the border of the lips and from the corners of the eyes;
        None where there are none. Their weights and half widths, on the surface and in UV, are
        changed in place.  leads (W,): which are parts of leaders."""
        ground, lines, ranks = self.ground, self.lines, self.strengths.ranks
        assert ranks is not None
        worn = max(ranks.worn_by_age, 0.0)
        if worn == 0.0:
            return None
        scale, found = ground.surface.scale, None
        millimetre = unit_length(ground.unit, self.spacing * scale) / scale
        for of in (perioral_lines, crows_feet):
            aged = of(ground, self.pores, lines, sizes[0], millimetre, worn, ranks, self.seed)
            if aged is not None:
                drawn = aged.drawn(lines, leads, sizes, self.spacing)
                found = drawn if found is None else found | drawn
        return found

    def _beside(self) -> dict[str, NDArray[np.float32]]:
        """Factors of nodes by name: of pores, of nodes beyond a border, then of events."""
        found, fields, ranks = {}, self.ground.fields, self.strengths.ranks
        points = [self.pores] if self.events is None else [self.pores, self.events.points]
        for name in _USUAL:
            factor = getattr(fields, name.removeprefix("node_"))
            every = [looked_up(factor, some) for some in points]
            if name == "node_patchiness" and ranks is not None:
                beside = (leading_any_way(fields, p.triangle, p.uv) for p in points[1:])
                calm = ranks.calm, *(calm_of(leading, ranks.rank) for leading in beside)
                every = [_calmed(*both) for both in zip(every, calm, strict=True)]
            found[name] = np.concatenate([every[0], every[0][self.lines.owner], *every[1:]])
        return found

    def _shares(self, weight: NDArray[np.float32], width: NDArray[np.float32]) -> Arrays:
        """The array `edge_share`, if there are leaders.  weight, width (W,): of lines, the half
        width on the surface."""
        ranks, lines, position = self.strengths.ranks, self.lines, self.pores.position
        if ranks is None:
            return {}
        first, second = slice(0, lines.whole), slice(lines.whole, None)
        pores, mass = lines.pores[first], np.empty(lines.whole)

        def find(rows: slice) -> None:
            one, two = pores[rows].T
            length = np.linalg.norm(position[two] - position[one], axis=1)
            mass[rows] = length * weight[rows] * width[rows]

        over_rows(len(mass), find)
        share = np.empty(len(weight), np.float32)
        strips = Strips(lines.edge[first], pores, weight[first], mass, position, self.spacing)
        share[first] = ranks.shares(strips)
        share[second] = share[lines.copy_of[second]]
        return {"edge_share": share}

    def _shapes_of_pores(
        self, strengths: NDArray[np.float32], progress: Progress
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
        """(P,) weights, (P, 3) metrics and (P,) radii of pores, from the weights of the lines that
        are no copies."""
        surface, fields, pores, lines = (
            self.ground.surface,
            self.ground.fields,
            self.pores,
            self.lines,
        )
        key = place_keys(pores.uv)
        size = shapes.pore_sizes(pores.position, self.spacing, key, self.seed)
        size[self.strengths.hubs] *= np.float32(shapes.HUB)
        size *= looked_up(fields.pore_radius, pores)
        progress(0.8, "shapes")
        first = slice(0, lines.whole)
        relative = size / np.float32(fields.usual_pore_radius)
        meeting = self.strengths.usual.meeting
        depth = shapes.pore_weights(
            lines.pores[first], strengths, meeting, relative, key, self.seed
        )
        size *= np.float32(shapes.PORE_SIZE * self.spacing)
        if self.strengths.ranks is not None:
            depth *= self.strengths.ranks.of_pores
        _scale(depth, looked_up(fields.pore_strength, pores))
        if self.events is not None:
            _scale(depth, self.events.fading(surface, pores.triangle, pores.uv))
        axes = pore_axes(
            surface, pores.triangle, lines.nodes[first], lines.step[first], strengths, key,
            self.seed,
        )  # fmt: skip
        return (depth, *pore_ellipses(surface, pores.triangle, size, *axes))

    def _sizes_of_lines(self, progress: Progress) -> tuple[NDArray[np.float32], ...]:
        """(W,) each, of lines: weights, factors by which these are still to be multiplied, and half
        widths in UV and on the surface."""
        ground, lines, spacing, fields = self.ground, self.lines, self.spacing, self.ground.fields
        chosen, ranks = self.strengths.strength[lines.edge], self.strengths.ranks
        uv = np.concatenate([self.pores.uv, lines.beyond])
        weight, factor, half_width, wide = (np.empty(len(chosen), np.float32) for _ in range(4))
        even = fields.unpatched

        def find(rows: slice) -> None:
            triangle, step = lines.triangle[rows], lines.step[rows]
            middle = uv[lines.nodes[rows, 0]] + np.float32(0.5) * step
            weight[rows] = shapes.edge_weights(chosen[rows], self.strengths.usual.strength)
            width = shapes.widths(weight[rows], spacing)
            if ranks is not None:
                ranked = ranks.of_lines(lines.edge[rows], lines.pores[rows])
                weight[rows] = np.where(ranked.leads, ranked.weight, weight[rows])
                width = np.where(ranked.leads, ranked.width * np.float32(spacing), width)
            width *= fields.width(triangle, middle)
            wide[rows] = width
            half_width[rows] = shapes.half_widths_uv(ground.surface, triangle, step, width)
            factor[rows] = fields.strength(triangle, middle)
            if ranks is not None:
                _follow_patches(factor[rows], ranked, even, triangle, middle)
            if self.events is not None:
                factor[rows] *= self.events.fading(ground.surface, triangle, middle)
            if fields.some_bare:
                factor[rows] *= beside_bare(
                    ground.surface, ground.across, fields, triangle, middle, spacing
                )
            if fields.some_contrast:
                factor[rows] *= weight[rows] ** (fields.contrast(triangle, middle) - 1.0)
            if ranks is not None:
                factor[rows] *= ranked.factor
                np.minimum(factor[rows], ranked.most, out=factor[rows])

        for block in row_blocks(len(chosen), _LINES):
            progress(0.4 * block.start / len(chosen), "shapes")
            over_block(block, find)
        second = slice(lines.whole, None)
        factor[second] = factor[lines.copy_of[second]]  # both halves across a seam are one wrinkle
        return weight, factor, half_width, wide


def graph_of(arrays: Arrays) -> WrinkleGraph:
    """The graph of its arrays, which are taken out of `arrays` one by one, so that no more than one
    is there twice: a graph has a copy of what somebody else could change."""
    found = {}
    for name in list(arrays):
        array = np.ascontiguousarray(arrays.pop(name))
        if array.size:
            array = np.frombuffer(array.tobytes(), array.dtype).reshape(array.shape)
        found[name] = array
    return WrinkleGraph(**found, origin=None)


def _calmed(patchiness: NDArray[np.float32], calm: NDArray[np.float32]) -> NDArray[np.float32]:
    """(N,) patchiness of grain and undulation: the calmer the skin, the less above _CALM."""
    above = np.maximum(patchiness - _CALM, np.float32(0.0))
    calmed: NDArray[np.float32] = patchiness - above * calm
    return calmed


def _of_nodes(arrays: Arrays, every: dict[str, NDArray[np.float32]]) -> Arrays:
    """Factors of all nodes from those of nodes that are no copies, by name; none where these
    are as usual throughout."""
    found = {}
    for name, factor in every.items():
        if (factor == _USUAL[name]).all():
            continue
        if len(factor) < len(arrays["node_uv"]):
            copied = arrays["node_copy_of"][len(factor) :]
            factor = np.concatenate([factor, factor[copied]])
        found[name] = factor
    return found


def _follow_patches(
    factor: NDArray[np.float32],
    ranked: RankedLines,
    even: Fields,
    triangle: NDArray[np.integer],
    uv: NDArray[np.floating],
) -> None:
    """Have leaders run on through patches, and lines among them be no livelier in any: of the
    logarithm of what patches make of the strength of lines, leaders follow _PATCHED, and others,
    the calmer the skin, only what is below 0.

    factor (N,): strengths of lines, changed in place.  even: the fields without patches.
    triangle (N,), uv (N, 2): of the middles of lines.
    """
    of = np.flatnonzero(ranked.leads | (ranked.calm > 0))
    unpatched, leads = even.strength(triangle[of], uv[of]), ranked.leads[of]
    patched = factor[of] / np.maximum(unpatched, _LEAST_WEIGHT)
    less = np.maximum(patched, np.float32(1.0)) ** -ranked.calm[of]
    factor[of] = np.where(leads, unpatched * patched**_PATCHED, factor[of] * less)


def _scale(weight: NDArray[np.float32], factor: NDArray[np.float32]) -> None:
    """Multiply weights by a factor, in place, and keep them above 0 and at most 1."""
    np.clip(weight * factor, _LEAST_WEIGHT, 1.0, out=weight)


def beside_bare(
    surface: Surface,
    across: NDArray[np.int32],
    fields: Fields,
    triangle: NDArray[np.integer],
    uv: NDArray[np.floating],
    spacing: float,
) -> NDArray[np.float32]:
    """(N,) factors of the weight of lines with their middles at uv (N, 2): 1 away from bare skin.

    Walkers cannot cross bare skin and wear its rim twice as deep as other lines: left alone, a ring
    of a crack goes round. Lines fade there instead, as they do towards a scar.

    across: (F, 3) neighbours of the triangles; bare skin in other charts does not count.
    spacing: of pores on even skin, in units of the surface.
    """
    reach = _REACH * spacing * fields.spacing(triangle, uv).astype(np.float64)
    bare = np.zeros(len(triangle), np.float32)
    jacobian = surface.jacobian[triangle]
    # With JᵀJ = LLᵀ a step of L⁻ᵀe in UV is as long as e on the surface.
    uu = np.sqrt((jacobian[..., 0] ** 2).sum(-1))
    along = (jacobian[..., 0] * jacobian[..., 1]).sum(-1) / uu
    upward = surface.density[triangle] / uu
    for angle in 2.0 * np.pi * np.arange(_LOOKS) / _LOOKS:
        v = np.sin(angle) / upward
        step = reach[:, None] * np.stack([(np.cos(angle) - along * v) / uu, v], axis=-1)
        seen = np.flatnonzero(fields.bare(triangle, (uv + step).astype(np.float32)))
        line = trace(surface, across, triangle[seen], uv[seen].astype(np.float64), step[seen])
        bare[seen[line.share >= 1.0]] += 1.0
    found: NDArray[np.float32] = (1.0 - bare / np.float32(_LOOKS)) ** np.float32(_FADING)
    return found
