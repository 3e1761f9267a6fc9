"""Mixed skin: where a scan is flat, masked out or missing, grown skin fills in, with a soft border.

    graph = traced lines times share + grown lines times (1 - share)
    residual = share · (scan - drawn(graph, neutral))

The share of the scan is 1 from the border on: there the skin at rest is the scan.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.expressions import Folds
from rhytid.domain.graph import ORIGINAL, WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.painted_maps import Controls, texels_of
from rhytid.domain.residual import ScanRelief
from rhytid.domain.tiles import mesh_udims, texel_centres, udim_origin
from rhytid.domain.uv_layout import mean_uv_length
from rhytid.pipeline.grain import relief
from rhytid.support import cancellation
from rhytid.tracing.detail import at_places, bare_in, grain_at_rest
from rhytid.tracing.elements import Arrays, selected, together
from rhytid.tracing.fit import drawn_neutral
from rhytid.tracing.trace import Trace, shown, traced_settings

Shares = NDArray[np.float32]
# Cells a side on which the share of a scan is found, and cells around charts.
_CELLS, _AROUND = 1024, 2
# What elements have where the arrays of a graph lack it, integers where that is one, and the shape
# of each; the rest is made of others.
_USUAL: dict[str, tuple[float, tuple[int, ...]]] = {
    "node_grain": (1.0, ()),
    "node_undulation": (1.0, ()),
    "node_patchiness": (0.0, ()),
    "node_kind": (0, ()),
    "node_copy_of": (ORIGINAL, ()),
    "node_triangle": (-1, ()),
    "edge_copy_of": (ORIGINAL, ()),
    "edge_partners": (-1, (2,)),
    "edge_share": (1.0, ()),
    "edge_slopes": (0.0, (2,)),
    "edge_metric": (0.0, (3,)),
    "edge_triangle": (-1, ()),
}


@dataclass(frozen=True)
class Growth:
    """What skin grows by that fills in: painted maps, and the folds of expressions."""

    controls: Controls | None = None
    folds: Folds | None = None


@dataclass(frozen=True, eq=False)
class ScanShares:
    """How much of the skin is the scan, of each UDIM of a mesh: cells (G, G) from 0 to 1."""

    cells: Mapping[int, Shares]

    @property
    def all_scan(self) -> bool:
        """Whether the scan counts in full everywhere."""
        return all((cells == 1.0).all() for cells in self.cells.values())

    @classmethod
    def of(cls, device: Device, mesh: Mesh, scan: ScanRelief, resolution: int) -> ScanShares:
        """Those of a scan with a border, by the distance in space from where it is denied."""
        side = min(_CELLS, resolution)
        places, denied, rims = {}, {}, []
        for udim in mesh_udims(mesh):
            cancellation.check()
            inside = shown(device, mesh, udim, side, 0) < len(mesh.faces)
            places[udim] = _places(mesh, udim, shown(device, mesh, udim, side, _AROUND))
            denied[udim] = denied_of(scan, udim, side)
            rims.append(places[udim][_rim(denied[udim], inside)])
        if not any(map(len, rims)):
            return cls({udim: np.ones((side, side), np.float32) for udim in places})
        tree = scipy.spatial.cKDTree(np.concatenate(rims))
        return cls({u: _shares(tree, places[u], denied[u], scan.border) for u in places})

    def texels(self, udim: int, resolution: int) -> Shares:
        """(R, R) of a UDIM."""
        return texels_of(self.cells[udim], resolution, 0, 0, resolution)

    def nodes(self, graph: WrinkleGraph) -> Shares:
        """(N,) at the nodes of a graph; at copies that of what they are copies of."""
        found = at_places(self.cells, graph.node_uv)
        of_originals: Shares = found[graph.original_nodes(np.arange(graph.pores))]
        return of_originals


def denied_of(scan: ScanRelief, udim: int, side: int) -> NDArray[np.bool_]:
    """(side, side) where a UDIM has no scan: all of one without a map."""
    if udim not in scan.maps:
        return np.ones((side, side), np.bool_)
    if udim not in scan.denied:
        return np.zeros((side, side), np.bool_)
    map = scan.denied[udim]
    rows, columns = ((texel_centres(0, side, side) * n).astype(np.int64) for n in map.shape)
    found: NDArray[np.bool_] = map[rows[:, None], columns] != 0
    return found


def mixed(
    device: Device,
    mesh: Mesh,
    scan: ScanRelief,
    found: Trace,
    grown: tuple[WrinkleGraph, float],
    shares: ScanShares,
    settings: AssetSettings,
) -> Trace:
    """What was traced and what was grown as one.

    grown: a graph, and the depth that it is drawn with.  settings: resolved, with which the scan
    was traced.
    """
    graph, depth = grown
    assert settings.depth is not None
    each = (
        _of_scan(found.graph, shares),
        _of_grown(mesh, graph, shares, scan.border, depth / settings.depth),
    )
    both = together([_with_all(arrays, set().union(*each)) for arrays in each])
    assert found.graph.origin is not None  # of what is traced
    patch = None if graph.origin is None else graph.origin.patch_size
    whole = WrinkleGraph(**both, origin=replace(found.graph.origin, patch_size=patch))
    whole = bare_in(mesh, whole, at_places(shares.cells, mesh.triangle_uv().mean(axis=1)) == 1.0)
    drawn, residual, charts = traced_settings(settings, filled=True), {}, {}
    for udim, map in scan.maps.items():
        rest = drawn_neutral(device, whole, drawn, udim)
        if relief(drawn) > 0.0:
            rest += grain_at_rest(device, mesh, whole, rest, drawn, udim)
        share = shares.texels(udim, settings.resolution)
        residual[udim] = share * (map - rest)
        charts[udim] = found.charts[udim] & (share == 1.0)
    return replace(found, graph=whole, residual=residual, charts=charts, grown=True)


def without_grain(graph: WrinkleGraph) -> WrinkleGraph:
    """A traced graph, which settings with grain draw without any."""
    none = np.zeros(graph.pores, np.float32)
    return replace(graph, node_grain=none, node_undulation=none)


def _places(mesh: Mesh, udim: int, triangles: NDArray[np.int32]) -> NDArray[np.float32]:
    """(G, G, 3) where the middles of cells are in space, NaN without a triangle; outside of theirs
    its plane goes on."""
    side = len(triangles)
    found = np.full((side, side, 3), np.nan, np.float32)
    row, column = np.nonzero(triangles < len(mesh.faces))
    at = triangles[row, column]
    uv = np.stack([(column + 0.5) / side, 1.0 - (row + 0.5) / side], axis=1) + udim_origin(udim)
    corners, places = mesh.triangle_uv()[at], mesh.positions[mesh.faces[at]].astype(np.float64)
    edges = np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2)
    share = np.linalg.solve(edges, (uv - corners[:, 0])[..., None])
    found[row, column] = places[:, 0] + np.sum(share * (places[:, 1:] - places[:, :1]), axis=1)
    return found


def _rim(denied: NDArray[np.bool_], inside: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Cells of what is denied that others, or the end of a chart or of the UDIM, lie next to."""
    rim = denied & inside
    rim &= scipy.ndimage.binary_dilation(~rim, border_value=1)
    return rim


def _shares(
    tree: scipy.spatial.cKDTree,
    places: NDArray[np.float32],
    denied: NDArray[np.bool_],
    border: float,
) -> Shares:
    there = np.isfinite(places[..., 0])
    found = np.zeros(denied.shape, np.float32)
    asked = there & ~denied
    far, _ = tree.query(places[asked], distance_upper_bound=border)
    along = np.minimum(far / border, 1.0)
    found[asked] = along * along * (3.0 - 2.0 * along)
    near = scipy.ndimage.distance_transform_edt(~there, return_distances=False, return_indices=True)
    filled: Shares = found[tuple(near)]
    return filled


def _of_scan(graph: WrinkleGraph, shares: ScanShares) -> Arrays:
    """The arrays of what was traced, as deep as the scan counts, and without grain."""
    return _faded(without_grain(graph), shares.nodes(graph))


def _of_grown(
    mesh: Mesh, graph: WrinkleGraph, shares: ScanShares, border: float, depth: float
) -> Arrays:
    """The arrays of what was grown, as deep as the scan does not count.

    depth: of a line of strength 1, in those of the scan, at most 1. Events are left out where they
    would be seen in the scan.
    """
    share = np.float32(1.0) - shares.nodes(graph)
    strength = share.copy()
    if graph.node_kind is not None:
        reach = (
            graph.node_radius
            * np.array([mean_uv_length(mesh, int(u)) for u in shares.cells], np.float32).max()
        )
        strength[(graph.node_kind > 0) & ((share < 1.0) | (reach > border))] = 0.0
    each, even = np.float32(depth), np.ones(graph.pores, np.float32)
    grain, swells = (
        even if one is None else one for one in (graph.node_grain, graph.node_undulation)
    )
    graph = replace(graph, node_grain=each * grain, node_undulation=each * swells)
    return _faded(graph, each * strength)


def _faded(graph: WrinkleGraph, share: Shares) -> Arrays:
    """The arrays of a graph whose strengths are times a share at each node."""
    arrays, ends = graph.arrays(), share[graph.edge_nodes]
    arrays["node_weight"] = arrays["node_weight"] * share
    arrays["edge_weight"] = arrays["edge_weight"] * ends.mean(axis=1)
    if "edge_end_weights" in arrays:
        arrays["edge_end_weights"] = arrays["edge_end_weights"] * ends
    return _without_strength(arrays)


def _without_strength(arrays: Arrays) -> Arrays:
    """Without wrinkles of no strength, and without nodes that neither have any nor end one."""
    edges = _with_originals(arrays["edge_weight"] > 0.0, arrays.get("edge_copy_of"))
    nodes = arrays["node_weight"] > 0.0
    nodes[arrays["edge_nodes"][edges]] = True
    nodes = _with_originals(nodes, arrays.get("node_copy_of"))
    return selected(arrays, nodes, edges)


def _with_originals(
    kept: NDArray[np.bool_], copy_of: NDArray[np.int32] | None
) -> NDArray[np.bool_]:
    """What is kept, and what that is copies of."""
    if copy_of is not None:
        first = copy_of[kept]
        kept = kept.copy()
        kept[first[first != ORIGINAL]] = True
    return kept


def _with_all(arrays: Arrays, names: set[str]) -> Arrays:
    """The arrays with those of `names` that they lack, which change nothing."""
    found = dict(arrays)
    for name in names - set(arrays):
        count = len(arrays["node_uv" if name.startswith("node") else "edge_nodes"])
        if name == "node_metric":
            square = arrays["node_radius"] ** np.float32(-2.0)
            found[name] = np.stack([square, np.zeros_like(square), square], axis=1)
        elif name in ("edge_end_weights", "edge_end_half_widths"):
            plain = arrays["edge_weight" if name.endswith("weights") else "edge_half_width"]
            found[name] = np.stack([plain, plain], axis=1)
        else:
            usual, more = _USUAL[name]
            found[name] = np.full(
                (count, *more), usual, np.int32 if isinstance(usual, int) else np.float32
            )
    return found
