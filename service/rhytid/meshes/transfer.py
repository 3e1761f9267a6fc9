"""A wrinkle graph carried to another mesh of the same head, or of one that lies near it.

Pores go to the nearest points of the other surface; what they are in its UV follows from how the
two triangles lie, taken as linear maps. Wrinkles follow their pores, and those that reach over a
seam of the other mesh are stored on both sides of it, as synthesis stores them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from rhytid.domain.graph import (
    LEAST_SIZE,
    ORIGINAL,
    STEEPEST,
    GraphOrigin,
    WrinkleGraph,
    mesh_digest,
)
from rhytid.domain.graph_geometry import surface_points, whole_wrinkles
from rhytid.domain.mesh import Mesh
from rhytid.domain.wording import plural
from rhytid.errors import GraphError
from rhytid.meshes.nearest import closest
from rhytid.synthesis.seams.borders import Borders
from rhytid.synthesis.seams.charts import BORDER, neighbours, trace
from rhytid.synthesis.seams.copies import flat, full, holds, roots, with_copies
from rhytid.synthesis.surface import Surface, cross

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
# How far a pore may be from the other surface: a share of the longest side of the first mesh.
REACH = 0.02
# A wrinkle that would be so much longer or shorter has ends on places that do not belong together.
TORN = 2.0
# Seams are looked at as closely as synthesis does: 8 times as dense as the mean.
_CLOSEST = 8.0**-0.5


@dataclass(frozen=True)
class Transfer:
    """A graph on another mesh, and what was lost on the way.

    distance: mean and most, of the pores that were kept to the other surface, mesh units. Events
    count as pores here.  far: pores with nothing within reach.  averse: pores whose nearest place
    faces away from them, as the other lip does.  unheld: pores that the UV there cannot hold.
    lost: wrinkles without one of these.  torn: wrinkles that would be TORN times as long or short.
    over_seams: wrinkles kept whose ends lie in two charts.
    """

    graph: WrinkleGraph
    distance: tuple[float, float]
    far: int
    averse: int
    unheld: int
    lost: int
    torn: int
    over_seams: int


def transfer(graph: WrinkleGraph, old: Mesh, new: Mesh, reach: float | None = None) -> Transfer:
    """Carry a graph of the mesh `old`, which names the triangles of its pores, to `new`.

    Both meshes are where they were sent, in one space and unit. reach: how far a pore may be from
    the other surface, mesh units; absent, REACH of the longest side of `old`. Raises GraphError
    where nothing can be carried.
    """
    if graph.node_triangle is None:
        raise GraphError("node_triangle is missing: the triangle of every pore must be known")
    reach = REACH * float(np.ptp(old.positions, axis=0).max()) if reach is None else reach
    moved = _Moved(graph, old, new, reach)
    rows, pairs = whole_wrinkles(old, graph)
    number = np.full(graph.pores, -1, np.int64)
    number[moved.nodes[moved.kept]] = np.arange(np.count_nonzero(moved.kept))
    ends = number[pairs]
    there = (ends >= 0).all(axis=1)
    wrinkles = _Wrinkles(graph, moved, rows[there], ends[there])
    if not len(wrinkles.rows):
        raise GraphError(
            f"no wrinkle can be carried: of {plural(len(moved.nodes), 'pore')} {moved.far} are "
            f"more than {reach:.3g} from the other mesh; are both meshes in one place and unit?"
        )
    carried = _assembled(graph, moved, wrinkles)
    origin = replace(graph.origin or GraphOrigin(), mesh=mesh_digest(new))
    gaps = moved.distance[moved.kept]
    return Transfer(
        replace(carried, origin=origin), (float(gaps.mean()), float(gaps.max())), moved.far,
        moved.averse, moved.unheld, int((~there).sum()), wrinkles.torn, wrinkles.over_seams,
    )  # fmt: skip


class _Moved:
    """The pores of a graph on another mesh.

    nodes (N,): of the graph.  kept (N,): which of these have a place; of those kept, K:
    triangle (K,), uv (K, 2), point and before (K, 3), where they are now and were, and turn
    (K, 2, 2), UV steps there from those before.
    """

    def __init__(self, graph: WrinkleGraph, old: Mesh, new: Mesh, reach: float) -> None:
        known = graph.node_triangle
        assert known is not None
        self.surface, first = Surface.of(new), Surface.of(old)
        self.across = neighbours(new)
        self.borders = Borders.of(new, self.surface, self.across)
        self.nodes = _pores(graph, known, first)
        triangle = known[self.nodes]
        before = surface_points(old, graph.node_uv[self.nodes].astype(np.float64), triangle)
        before = before + (old.centre - new.centre)
        usable = np.flatnonzero(self.surface.carries)
        corners = new.positions[new.faces].astype(np.float64)
        landing = closest(corners[usable], before)
        there, self.distance = usable[landing.triangle], landing.distance
        far = landing.distance > reach
        averse = ~far & (_facing(first.corners[triangle], self.surface.corners[there]) <= 0)
        jacobian = (
            one.jacobian[t] * one.scale for one, t in ((first, triangle), (self.surface, there))
        )
        from_uv, to_uv = jacobian
        turn = np.linalg.pinv(to_uv) @ from_uv
        uv = np.einsum("nk,nkc->nc", landing.weights, new.triangle_uv()[there])
        metric = _metrics(graph, self.nodes)
        sound = np.abs(np.linalg.det(turn)) > 1e-12
        back = np.linalg.inv(np.where(sound[:, None, None], turn, np.eye(2)))
        metric = back.transpose(0, 2, 1) @ metric @ back
        unheld = ~far & ~averse & ~(sound & holds(metric, uv))
        self.kept = kept = ~(far | averse | unheld)
        self.far, self.averse, self.unheld = (int(m.sum()) for m in (far, averse, unheld))
        self.triangle, self.uv, self.metric = there[kept], uv[kept], metric[kept]
        self.turn, self.before = turn[kept], before[kept]
        self.point = np.einsum("nk,nkc->nc", landing.weights, corners[there])[kept]


def _pores(graph: WrinkleGraph, triangle: NDArray[np.int32], surface: Surface) -> IntArray:
    """Nodes that are pores of their own, on triangles with area."""
    good = surface.density > 0
    own = graph.own_nodes & (triangle >= 0) & good[np.maximum(triangle, 0)]
    return np.flatnonzero(own)


def _facing(one: FloatArray, two: FloatArray) -> FloatArray:
    """(N,) of triangles (N, 3, 3), above 0 where they face the same way."""
    normals = (np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]) for t in (one, two))
    facing: FloatArray = np.einsum("ni,ni->n", *normals)
    return facing


def _metrics(graph: WrinkleGraph, nodes: IntArray) -> FloatArray:
    """(N, 2, 2) of pores, of the circles of those without."""
    if graph.node_metric is not None:
        return full(graph.node_metric[nodes])
    radius = graph.node_radius[nodes].astype(np.float64)
    return np.eye(2) / np.square(radius)[:, None, None]


class _Wrinkles:
    """Wrinkles whose pores are kept, in the UV of one of these.

    rows (W,): of the graph.  ends (W, 2): kept pores; where `split` (W,), the second one lies in
    another chart.  step (W, 2): in UV, from the first to the second.  triangle (W,): at the middle.
    ratio (W,): half widths to those before.  slopes (W, 2).
    """

    def __init__(self, graph: WrinkleGraph, moved: _Moved, rows: IntArray, ends: IntArray) -> None:
        length = np.linalg.norm(moved.point[ends[:, 1]] - moved.point[ends[:, 0]], axis=1)
        was = np.linalg.norm(moved.before[ends[:, 1]] - moved.before[ends[:, 0]], axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            torn = ~((length < TORN * was) & (was < TORN * length))
        chart = moved.borders.chart[moved.triangle]
        split = chart[ends[:, 0]] != chart[ends[:, 1]]
        step = moved.uv[ends[:, 1]] - moved.uv[ends[:, 0]]
        step[split] = _laid(moved, ends[split])
        kept = ~torn & (np.linalg.norm(step, axis=1) > 2 * LEAST_SIZE)
        self.torn, self.over_seams = int((~kept).sum()), int((split & kept).sum())
        self.rows, self.ends, self.split, self.step = (
            rows[kept],
            ends[kept],
            split[kept],
            step[kept],
        )
        first, uv = self.ends[:, 0], graph.node_uv.astype(np.float64)
        self.triangle = _middles(moved, first, self.step)
        stored = graph.edge_nodes[self.rows]
        before = uv[stored[:, 1]] - uv[stored[:, 0]]
        # In the chart of the pore that is stored there itself; the other end may be a copy.
        second = ~graph.own_nodes[stored[:, 0]] & graph.own_nodes[stored[:, 1]]
        turn = moved.turn[np.where(second, self.ends[:, 1], first)]
        self.ratio = _widths(turn, self.step)
        self.slopes = _slopes(graph, self.rows, before, turn)


def _widths(turn: FloatArray, step: FloatArray) -> FloatArray:
    """(W,) half widths to those before: a strip covers det times the area in the other UV, and is
    as much longer as its steps (W, 2) there are."""
    before = np.einsum("nij,nj->ni", np.linalg.inv(turn), step)
    grown = np.linalg.norm(step, axis=1) / np.linalg.norm(before, axis=1)
    ratio: FloatArray = np.abs(np.linalg.det(turn)) / grown
    return ratio


def _middles(moved: _Moved, first: IntArray, step: FloatArray) -> NDArray[np.int32]:
    """(W,) the triangles at the middle of wrinkles; of such as end before it, of their pore."""
    triangle = moved.triangle[first].astype(np.int32)
    uv = moved.uv[first]
    middle = trace(moved.surface, moved.across, triangle, uv, step).middle
    found: NDArray[np.int32] = np.where(middle == BORDER, triangle, middle)
    return found


def _laid(moved: _Moved, ends: IntArray) -> FloatArray:
    """(S, 2) UV steps from first pores towards second ones in other charts, as long as the way."""
    first = ends[:, 0]
    way = moved.point[ends[:, 1]] - moved.point[first]
    jacobian = moved.surface.jacobian[moved.triangle[first]] * moved.surface.scale
    step = np.einsum("nij,nj->ni", np.linalg.pinv(jacobian), way)
    there = np.linalg.norm(np.einsum("nij,nj->ni", jacobian, step), axis=1)
    whole = np.linalg.norm(way, axis=1)
    grown = np.divide(whole, there, out=np.ones_like(whole), where=there > 0)
    steps: FloatArray = step * np.minimum(grown, TORN)[:, None]
    return steps


def _slopes(graph: WrinkleGraph, rows: IntArray, step: FloatArray, turn: FloatArray) -> FloatArray:
    """(W, 2) slopes of arcs as they lie in the other UV, over what their chords become there."""
    if graph.edge_slopes is None:
        return np.zeros((len(rows), 2))
    root = np.tile(np.eye(2), (len(rows), 1, 1))
    if graph.edge_metric is not None:
        some = np.flatnonzero(graph.edge_metric[rows].any(axis=1))
        root[some] = roots(full(graph.edge_metric[rows[some]]))
    round_ = np.einsum("nij,nj->ni", root, step)
    left = np.stack([-round_[:, 1], round_[:, 0]], axis=1)
    onward = turn @ np.linalg.inv(root)
    chord = np.einsum("nij,nj->ni", onward, round_)
    found = np.zeros((len(rows), 2))
    for end in (0, 1):
        tangent = round_ + graph.edge_slopes[rows, end, None] * left
        there = np.einsum("nij,nj->ni", onward, tangent)
        ahead = (chord * there).sum(-1)
        steep = cross(chord, there) / np.where(ahead > 0, ahead, np.inf)
        found[:, end] = np.clip(steep, -STEEPEST, STEEPEST)
    return found


_OPTIONAL = ("edge_slopes", "edge_end_weights", "edge_end_half_widths", "edge_partners")


def _assembled(graph: WrinkleGraph, moved: _Moved, wrinkles: _Wrinkles) -> WrinkleGraph:
    """The graph with copies over the seams of the other mesh."""
    count, split = len(moved.uv), np.flatnonzero(wrinkles.split)
    owner, other = wrinkles.ends[split].T
    nodes = wrinkles.ends.copy()
    nodes[split, 1] = count + np.arange(len(split))
    source = moved.nodes[moved.kept]
    beyond = moved.uv[owner] + wrinkles.step[split]
    radius = 1.0 / np.sqrt(np.sqrt(np.linalg.det(moved.metric)))
    arrays: dict[str, Any] = {
        "node_uv": np.concatenate([moved.uv, beyond]),
        "node_weight": np.concatenate([graph.node_weight[source], np.zeros(len(split))]),
        "node_radius": np.concatenate([radius, radius[owner]]),
        "node_metric": flat(np.concatenate([moved.metric, moved.metric[owner]])),
        "node_triangle": np.concatenate([moved.triangle, moved.triangle[owner]]),
        "node_copy_of": np.concatenate([np.full(count, ORIGINAL), other]),
        "edge_nodes": nodes,
        "edge_triangle": wrinkles.triangle,
        "edge_copy_of": np.full(len(nodes), ORIGINAL),
        "edge_metric": np.zeros((len(nodes), 3)),
        **_strengths(graph, wrinkles),
    }
    if graph.node_kind is not None:
        arrays["node_kind"] = np.concatenate([graph.node_kind[source], np.zeros(len(split))])
    arrays = {name: _typed(name, array) for name, array in arrays.items()}
    arrays = with_copies(arrays, moved.surface, moved.borders, _apart(moved))
    for name in _OPTIONAL:
        if getattr(graph, name) is None:
            del arrays[name]
    for name in ("node_grain", "node_undulation", "node_patchiness"):
        factor = getattr(graph, name)
        if factor is None:
            continue
        own = np.concatenate([factor[source], factor[source][owner]])
        copies = arrays["node_copy_of"][len(own) :] if "node_copy_of" in arrays else own[:0]
        arrays[name] = np.concatenate([own, own[copies.astype(np.int64)]])
    return WrinkleGraph(**arrays, origin=None)


def _strengths(graph: WrinkleGraph, wrinkles: _Wrinkles) -> dict[str, Any]:
    """Weights, half widths, slopes and partners of the wrinkles."""
    rows, ratio = wrinkles.rows, wrinkles.ratio
    weight, half = graph.edge_weight[rows], graph.edge_half_width[rows]
    ends = graph.edge_end_weights, graph.edge_end_half_widths
    both = (np.repeat(one[:, None], 2, axis=1) for one in (weight, half))
    weights, halves = (
        default if one is None else one[rows] for one, default in zip(ends, both, strict=True)
    )
    return {
        "edge_weight": weight,
        "edge_half_width": np.clip(half * ratio, LEAST_SIZE * 2, 1.0),
        "edge_slopes": wrinkles.slopes,
        "edge_end_weights": weights,
        "edge_end_half_widths": np.clip(halves * ratio[:, None], LEAST_SIZE * 2, 1.0),
        "edge_partners": _partners(graph, rows),
        **({} if graph.edge_share is None else {"edge_share": graph.edge_share[rows]}),
    }


def _partners(graph: WrinkleGraph, rows: IntArray) -> IntArray:
    """(W, 2) the wrinkles that go on, by their new numbers; -1 where there is none any more."""
    if graph.edge_partners is None:
        return np.full((len(rows), 2), -1)
    number = np.full(graph.wrinkles + 1, -1, np.int64)
    number[rows] = np.arange(len(rows))
    if graph.edge_copy_of is not None:
        copies = np.flatnonzero(graph.edge_copy_of != ORIGINAL)
        number[copies] = number[graph.edge_copy_of[copies]]
    found: IntArray = number[graph.edge_partners[rows]]
    return found


def _apart(moved: _Moved) -> float:
    """How closely seams are looked at, in units of the surface."""
    near, _ = scipy.spatial.cKDTree(moved.point).query(moved.point, k=[2])
    return float(np.median(near[np.isfinite(near)])) * _CLOSEST / moved.surface.scale


def _typed(name: str, array: NDArray[Any]) -> NDArray[Any]:
    """An array in the type that the graph has for it."""
    whole = name.endswith(("_nodes", "_partners", "_kind", "_triangle", "_copy_of"))
    return np.asarray(array, np.int32 if whole else np.float32)
