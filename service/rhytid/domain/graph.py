"""The wrinkle graph: pores are nodes, wrinkles are edges (section 2.1 of the paper).

`GraphOrigin` is what the file of a graph says beside the arrays: its lengths, and for which mesh it
was made.
"""

from __future__ import annotations

import copy
import hashlib
import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.events import EVENT_NAMES, MOST_KIND
from rhytid.domain.lengths import Lengths, millimetres
from rhytid.domain.mesh import UV_LIMIT, Mesh
from rhytid.domain.validation import first_bad_row, fixed_array
from rhytid.domain.wording import plural
from rhytid.errors import GraphError, SettingsError

# The least length of a wrinkle, half width and radius, uv units: a 60,000th of the finest texel.
# Below, squares underflow on the device.
LEAST_SIZE = 1e-9
# What node_copy_of and edge_copy_of hold for elements that are no copies.
ORIGINAL = -1
# The steepest end of an arc over its chord: what the drawing keeps its distances for (line.clh).
STEEPEST = 0.8
# The most of node_grain, node_undulation and node_patchiness, and of edge_share.
MOST_GRAIN, MOST_SHARE = 16.0, 8.0
MOST_SEED = 2**31 - 1
# Rows checked at a time: what is computed on the way is in double.
_ROWS = 1 << 16
_F32 = np.float32
_SHAPES: dict[str, tuple[tuple[int | None, ...], Any]] = {
    "node_uv": ((None, 2), _F32),
    "node_weight": ((None,), _F32),
    "node_radius": ((None,), _F32),
    "edge_nodes": ((None, 2), np.int32),
    "edge_weight": ((None,), _F32),
    "edge_half_width": ((None,), _F32),
    "node_metric": ((None, 3), _F32),
    "node_triangle": ((None,), np.int32),
    "node_grain": ((None,), _F32),
    "node_undulation": ((None,), _F32),
    "node_patchiness": ((None,), _F32),
    "edge_triangle": ((None,), np.int32),
    "node_copy_of": ((None,), np.int32),
    "edge_copy_of": ((None,), np.int32),
    "edge_metric": ((None, 3), _F32),
    "edge_slopes": ((None, 2), _F32),
    "edge_end_weights": ((None, 2), _F32),
    "edge_end_half_widths": ((None, 2), _F32),
    "edge_partners": ((None, 2), np.int32),
    "node_kind": ((None,), np.int32),
    "edge_share": ((None,), _F32),
}
ARRAYS = tuple(_SHAPES)
REQUIRED = ARRAYS[:6]
_LEAST, _MOST = 1e-30, 1e30
_TEXTS = {"unit": 16, "mesh": 64}


@dataclass(frozen=True, eq=False)
class WrinkleGraph:
    """Pores and wrinkles in UV space. N pores, M wrinkles; arrays are read-only copies.

    node_uv (N, 2) f32: centres, UDIM offset included.  node_weight (N,) f32: strength in [0, 1].
    node_radius (N,) f32: neutral support radius, uv units.
    edge_nodes (M, 2) i32: the two pores joined.  edge_weight (M,) f32: strength in [0, 1].
    edge_half_width (M,) f32: neutral support half width, uv units.
    node_metric (N, 3) f32 or None: symmetric UV metric (uu, uv, vv) of a pore, in place of
    the circle of node_radius: the rim is where dᵀ·metric·d = 1.
    node_triangle (N,), edge_triangle (M,) i32 or None: the triangle to sample; -1 = find it.
    node_grain, node_undulation (N,) f32 or None: factor of the grain, and of the undulation, around
    a pore, from 0 to MOST_GRAIN.
    node_patchiness (N,) f32 or None: how far grain and undulation vary from patch to patch around a
    pore, from 0 to MOST_GRAIN; 1 is usual, None is 0.
    node_kind (N,) i32 or None: 0 for a pore, above it an event: the number of its kind in EVENTS,
    counted from 1; its strength is its height, see EVENT_DEPTHS. None: all are pores.
    node_copy_of (N,), edge_copy_of (M,) i32 or None: -1, or for what is stored again because it
    reaches over a UV seam, in the UV of the other side, the row of what it is a copy of. A copy
    answers to stretch as its original does, whatever triangle it names; it is the same pore or
    wrinkle. A node of strength 0 that is a copy is the end of a wrinkle whose pore has its place in
    another chart; one of strength 0 that ends no wrinkle may say what grain there is, and no more.
    edge_metric (M, 3) f32 or None: as node_metric, of the points of the segment: the rim of a
    wrinkle is that far from it, in place of edge_half_width; 0, 0, 0 for a wrinkle without one.
    origin: what it was made with, and of which mesh; None where that is not known.

    Of wrinkles that are not straight and even, at their first node and at their second, or None:
    edge_slopes (M, 2) f32: dy/dx of the arc over the chord e from node to node, in UV, to its left,
    within STEEPEST: p(s) = a + s e + y(s) n, y(s) = |e| (m₁ s(1-s)² - m₂ s²(1-s)); of one with an
    edge_metric in coordinates in which that is round: both sides of a seam have the same arc.
    edge_end_weights (M, 2), edge_end_half_widths (M, 2) f32: strength and half width there, linear
    between, in place of edge_weight and edge_half_width; of edge_weight 0 none is drawn still. A
    metric is of edge_half_width, and wider and narrower as these are.
    edge_partners (M, 2) i32: the wrinkle that goes on there, -1 for none; of copies, too.

    edge_share (M,) f32 or None: how much of the shortening of skin each wrinkle takes, of what it
    would take by itself, from 0 to MOST_SHARE: at log stretch r its depth is 1 - alpha_d (share -
    1) r times as large, 0 to 4; None is 1 throughout.

    Radii, those of a metric too, half widths and lengths are at least LEAST_SIZE; radii and half
    widths at most 1. Raises GraphError naming the array and the first element that cannot be used.
    """

    node_uv: NDArray[np.float32]
    node_weight: NDArray[np.float32]
    node_radius: NDArray[np.float32]
    edge_nodes: NDArray[np.int32]
    edge_weight: NDArray[np.float32]
    edge_half_width: NDArray[np.float32]
    node_metric: NDArray[np.float32] | None = None
    node_triangle: NDArray[np.int32] | None = None
    edge_triangle: NDArray[np.int32] | None = None
    node_copy_of: NDArray[np.int32] | None = None
    edge_copy_of: NDArray[np.int32] | None = None
    edge_metric: NDArray[np.float32] | None = None
    edge_slopes: NDArray[np.float32] | None = None
    edge_end_weights: NDArray[np.float32] | None = None
    edge_end_half_widths: NDArray[np.float32] | None = None
    edge_partners: NDArray[np.int32] | None = None
    node_grain: NDArray[np.float32] | None = None
    node_undulation: NDArray[np.float32] | None = None
    node_patchiness: NDArray[np.float32] | None = None
    node_kind: NDArray[np.int32] | None = None
    edge_share: NDArray[np.float32] | None = None
    origin: GraphOrigin | None = None

    def __post_init__(self) -> None:
        for name, (shape, dtype) in _SHAPES.items():
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, fixed_array(value, name, shape, dtype, GraphError))
        self._check_lengths()
        self._check_values()
        self._check_edges()

    @property
    def pores(self) -> int:
        """Number of nodes: pores and events, copies and ends beyond seams included."""
        return len(self.node_uv)

    @property
    def wrinkles(self) -> int:
        """Number of edges, copies included."""
        return len(self.edge_nodes)

    @property
    def own_nodes(self) -> NDArray[np.bool_]:
        """(N,) true for nodes that are no copies."""
        return _originals(self.node_copy_of, self.pores)

    @property
    def own_edges(self) -> NDArray[np.bool_]:
        """(M,) true for edges that are no copies."""
        return _originals(self.edge_copy_of, self.wrinkles)

    @property
    def pore_weight(self) -> NDArray[np.float32]:
        """(N,) the strengths of pores; 0 for events."""
        if self.node_kind is None:
            return self.node_weight
        found: NDArray[np.float32] = self.node_weight * (self.node_kind == 0)
        return found

    @property
    def event_weight(self) -> NDArray[np.float32]:
        """(N,) the strengths of events; 0 for pores."""
        if self.node_kind is None:
            return np.zeros_like(self.node_weight)
        found: NDArray[np.float32] = self.node_weight * (self.node_kind > 0)
        return found

    def counts(self) -> tuple[int, int]:
        """Numbers of pores and of wrinkles: nodes but for events, and edges, without copies. Where
        nodes say what grain there is, those that have no strength and end no wrinkle are no pores.
        """
        pores = self.own_nodes
        if self.node_grain is not None:
            shown = self.node_weight > 0
            for start in range(0, self.wrinkles, _ROWS):
                shown[self.edge_nodes[start : start + _ROWS]] = True
            pores = pores & shown
        if self.node_kind is not None:
            pores = pores & (self.node_kind == 0)
        return int(np.count_nonzero(pores)), int(np.count_nonzero(self.own_edges))

    def event_counts(self) -> dict[str, int]:
        """Numbers of events by their kind, without copies; kinds of which there are none are left
        out."""
        if self.node_kind is None:
            return {}
        found = np.bincount(self.node_kind[self.own_nodes], minlength=MOST_KIND + 1)[1:]
        return {n: int(k) for n, k in zip(EVENT_NAMES, found, strict=True) if k}

    def without_copies(self) -> WrinkleGraph:
        """The graph in which copies have no strength and no wrinkle has a metric: it is drawn as
        if there were no UV seams."""
        return replace(
            self,
            node_weight=self.node_weight * self.own_nodes.astype(np.float32),
            edge_weight=self.edge_weight * self.own_edges.astype(np.float32),
            edge_metric=None,
        )

    def with_origin(self, origin: GraphOrigin | None) -> WrinkleGraph:
        """The same arrays, which need no other check, with another origin."""
        found = copy.copy(self)
        object.__setattr__(found, "origin", origin)
        return found

    def original_nodes(self, nodes: NDArray[np.integer]) -> NDArray[np.integer]:
        """Nodes, of any shape, in which the original stands in place of each copy."""
        if self.node_copy_of is None:
            return nodes
        first = self.node_copy_of[nodes]
        return np.where(first == ORIGINAL, nodes, first)

    def centres(self) -> NDArray[np.float32]:
        """(M, 2) the middle of each wrinkle, where it samples stretch (Alg. 1, line 1)."""
        ends = self.node_uv[self.edge_nodes]
        middle: NDArray[np.float32] = (0.5 * (ends[:, 0] + ends[:, 1])).astype(np.float32)
        return middle

    def figures(self) -> dict[str, Any]:
        """Figures of the graph for JSON: `degree`, mean wrinkles per pore that is drawn,
        `strengths`, numbers of wrinkles by weight in tenths from 0 to 1, and `events`, as
        `event_counts`. Copies do not count."""
        drawn, strong = (self.pore_weight > 0) & self.own_nodes, self.edge_weight > 0
        strong &= self.own_edges
        ends = np.count_nonzero(drawn[self.original_nodes(self.edge_nodes[strong])])
        shown = self.edge_weight[strong]
        return {
            "degree": int(ends) / max(int(np.count_nonzero(drawn)), 1),
            "strengths": np.histogram(shown, 10, (0.0, 1.0))[0].tolist(),
            "events": self.event_counts(),
        }

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The arrays by name, absent ones left out."""
        pairs = ((name, getattr(self, name)) for name in ARRAYS)
        return {name: value for name, value in pairs if value is not None}

    def _check_lengths(self) -> None:
        for name, array in self.arrays().items():
            first = "node_uv" if name.startswith("node") else "edge_nodes"
            wanted = len(getattr(self, first))
            if len(array) != wanted:
                raise GraphError(f"{name} has {plural(len(array), 'row')}, {first} has {wanted}")

    def _check_values(self) -> None:
        self._require("node_uv", lambda uv: np.abs(uv) <= UV_LIMIT, f"within ±{UV_LIMIT:g}")
        for name in ("node_weight", "edge_weight", "edge_end_weights"):
            self._require(name, lambda weight: (weight >= 0) & (weight <= 1), "from 0 to 1")
        for name in ("node_radius", "edge_half_width", "edge_end_half_widths"):
            rule = f"from {LEAST_SIZE:g} to 1"
            self._require(name, lambda size: (size >= LEAST_SIZE) & (size <= 1), rule)
        rule = f"a UV metric, positive definite, radii from {LEAST_SIZE:g} to 1"
        self._require("node_metric", _is_metric, rule)
        self._require("edge_metric", lambda m: _is_metric(m) | (m == 0).all(axis=1), f"0 or {rule}")
        for name in ("node_triangle", "edge_triangle"):
            self._require(name, lambda index: index >= -1, "-1 or the index of a triangle")
        rule = f"from 0 to {MOST_GRAIN:g}"
        for name in ("node_grain", "node_undulation", "node_patchiness"):
            self._require(name, lambda share: (share >= 0) & (share <= MOST_GRAIN), rule)
        rule = f"from 0 to {MOST_KIND}"
        self._require("node_kind", lambda kind: (kind >= 0) & (kind <= MOST_KIND), rule)
        rule = f"from 0 to {MOST_SHARE:g}"
        self._require("edge_share", lambda share: (share >= 0) & (share <= MOST_SHARE), rule)
        rule = f"slopes within ±{STEEPEST:g}"
        self._require("edge_slopes", lambda slope: np.abs(slope) <= _F32(STEEPEST), rule)
        rule = f"-1 or the index of a wrinkle, at most {self.wrinkles - 1}"
        self._require("edge_partners", lambda i: (i >= -1) & (i < self.wrinkles), rule)
        for name in ("node_copy_of", "edge_copy_of"):
            self._check_copies(name, getattr(self, name))

    def _check_copies(self, name: str, of: NDArray[np.int32] | None) -> None:
        if of is not None:
            rule = f"-1 or from 0 to {len(of) - 1}"
            self._require(name, lambda index: (index >= ORIGINAL) & (index < len(of)), rule)
            rule = "-1 or a row that is no copy itself"
            self._require(name, lambda index: (index == ORIGINAL) | (of[index] == ORIGINAL), rule)

    def _check_edges(self) -> None:
        rule = f"from 0 to {self.pores - 1}"
        self._require("edge_nodes", lambda ends: (ends >= 0) & (ends < self.pores), rule)
        rule = f"two pores at different places, {LEAST_SIZE:g} apart or more"
        self._require("edge_nodes", lambda ends: self._lengths(ends) >= LEAST_SIZE, rule)

    def _lengths(self, ends: NDArray[np.int32]) -> NDArray[np.float64]:
        """(K,) distances in UV of pairs of nodes (K, 2)."""
        one, two = (self.node_uv[end].astype(np.float64) for end in ends.T)
        lengths: NDArray[np.float64] = np.linalg.norm(one - two, axis=-1)
        return lengths

    def _require(self, name: str, good: Callable[[Any], NDArray[np.bool_]], rule: str) -> None:
        """Raise GraphError for the first row of an array that is not good."""
        array = getattr(self, name)
        for start in range(0, 0 if array is None else len(array), _ROWS):
            rows = array[start : start + _ROWS]
            bad = first_bad_row(good(rows))
            if bad is not None:
                found = f"{name}[{start + bad}] is {rows[bad].tolist()}"
                raise GraphError(f"{found}: must be {rule}")


@dataclass(frozen=True)
class GraphOrigin:
    """What a graph was made with: the lengths of `Lengths` in `unit`; None where its file does not
    say.

    seed: of the relief between the lines, `graph.seed`.  mesh: `mesh_digest` of the mesh that the
    graph was made for.  patch_size: the longest wave of its patches, where `unit` has no known
    length from which it follows.
    """

    unit: str | None = None
    spacing: float | None = None
    depth: float | None = None
    sigma: float | None = None
    wave_frequency: float | None = None
    grain_size: float | None = None
    undulation_size: float | None = None
    seed: int | None = None
    mesh: str | None = None
    patch_size: float | None = None

    @classmethod
    def of(
        cls,
        mesh: Mesh,
        unit: str,
        lengths: Lengths,
        seed: int | None = None,
        before: GraphOrigin | None = None,
    ) -> GraphOrigin:
        """The origin of a graph that is made for this mesh, in its unit.  before: what the graph
        says, of which patches stay."""
        size = None if before is None else before.patch_size_in(unit)
        return cls(unit, **asdict(lengths), seed=seed, mesh=mesh_digest(mesh), patch_size=size)

    @classmethod
    def parse(cls, metadata: Mapping[str, str]) -> GraphOrigin | None:
        """Read the metadata of a file; None where it says nothing of the origin. Other keys are
        ignored.

        Raises GraphError naming the key whose value cannot be used.
        """
        known = {field.name for field in fields(cls)}
        found = {key: _value(key, text) for key, text in metadata.items() if key in known}
        return cls(**found) if found else None  # type: ignore[arg-type]

    def metadata(self) -> dict[str, str]:
        """The inverse of `parse`; numbers keep all their digits."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return {
            name: value if isinstance(value, str) else repr(value)
            for name, value in values.items()
            if value is not None
        }

    def lengths(self, unit: str, spacing: float) -> Lengths:
        """The lengths in another unit.

        spacing: of the pores in that unit, used where the file does not say it. Raises
        SettingsError where lengths cannot be converted.
        """
        own = self.in_unit(unit)
        usual = Lengths.of(spacing if own.spacing is None else own.spacing)
        names = [field.name for field in fields(Lengths)]
        said = {n: getattr(own, n) for n in names if getattr(own, n) is not None}
        return replace(usual, **said)

    def in_unit(self, unit: str) -> GraphOrigin:
        """The origin in another unit; raises SettingsError where one of the two has no length."""
        if self.unit is None or self.unit == unit:
            return replace(self, unit=unit)
        one, other = millimetres(self.unit), millimetres(unit)
        if one is None or other is None:
            raise SettingsError(
                f"the graph is in {self.unit!r} and the mesh in {unit!r} (settings.unit): one of "
                "them is no known unit of length, so that depth and spacing cannot be converted"
            )
        factor = one / other
        names = ("spacing", "depth", "sigma", "grain_size", "undulation_size", "patch_size")
        changed: dict[str, Any] = {n: _times(getattr(self, n), factor) for n in names}
        changed["wave_frequency"] = _times(self.wave_frequency, 1.0 / factor)
        return replace(self, unit=unit, **changed)

    def patch_size_in(self, unit: str) -> float | None:
        """The longest wave of patches, where this is the unit that it was said in."""
        return self.patch_size if self.unit == unit else None

    def check_mesh(self, mesh: Mesh) -> None:
        """Raise GraphError where the graph was made for a mesh of other triangles or UV."""
        if self.mesh is not None and self.mesh != mesh_digest(mesh):
            raise GraphError(
                "the graph was made for another mesh: the triangles or the UV of this one differ; "
                "`force` (--force, or the form field of that name) takes it all the same"
            )


def mesh_digest(mesh: Mesh) -> str:
    """32 hexadecimal digits of the triangles and their texture coordinates (as float32), to which a
    graph is tied. Positions do not count: a graph fits every head of one topology."""
    digest = hashlib.sha256(np.ascontiguousarray(mesh.faces, "<i4").tobytes())
    digest.update(np.ascontiguousarray(mesh.triangle_uv(), "<f4").tobytes())
    return digest.hexdigest()[:32]


def _originals(copy_of: NDArray[np.int32] | None, count: int) -> NDArray[np.bool_]:
    if copy_of is None:
        return np.ones(count, np.bool_)
    own: NDArray[np.bool_] = copy_of == ORIGINAL
    return own


def _is_metric(metric: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Positive definite, with radii from LEAST_SIZE to 1: eigenvalues are radii to the power -2."""
    uu, uv, vv = metric.astype(np.float64).T
    largest = 0.5 * (uu + vv) + np.hypot(0.5 * (uu - vv), uv)
    # Products of two float32 are exact in double: this loses nothing where one is much smaller.
    smallest = (uu * vv - uv * uv) / np.where(largest > 0, largest, 1.0)
    sized = (largest <= (1.0 + 1e-6) / LEAST_SIZE**2) & (smallest >= 1.0 - 1e-6)
    good: NDArray[np.bool_] = (uu > 0) & (vv > 0) & sized
    return good


def _times(length: float | None, factor: float) -> float | None:
    return None if length is None else length * factor


def _value(key: str, text: str) -> str | float:
    if key == "seed":
        # Digits of ASCII alone: int() takes signs, spaces, underscores and other scripts, too.
        if not (text.isascii() and text.isdecimal() and len(text) <= 10 and int(text) <= MOST_SEED):
            raise GraphError(f"metadata seed is {text!r:.80}: must be from 0 to {MOST_SEED}, whole")
        return int(text)
    if key in _TEXTS:
        if not 0 < len(text) <= _TEXTS[key] or not text.isprintable():
            rule = f"1 to {_TEXTS[key]} printable characters"
            raise GraphError(f"metadata {key} is {text!r:.80}: must be {rule}")
        return text
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not (_LEAST <= number <= _MOST):
        raise GraphError(f"metadata {key} is {text!r:.80}: must be a number above 0")
    return number
