"""How far from what is painted a graph differs, for tests that painting is local."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from rhytid.domain.graph import ORIGINAL, WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.synthesis.surface import Surface
from synthesis import sheets

Floats = NDArray[np.floating[Any]]
Things = dict[bytes, Floats]


@dataclass(frozen=True)
class Reach:
    """How far the farthest change is from what is painted: of where pores lie, of which wrinkles
    there are, and of any bit of either; and the share of wrinkles that changed."""

    pores: float
    wrinkles: float
    anything: float
    share: float


class Painted:
    """A mesh with maps (R, R) of UDIM 1001 in which a patch around a place is painted."""

    def __init__(self, mesh: Mesh, at: Floats, side: float, texels: int = 512) -> None:
        """at: (3,) in mesh units; what is no farther than half of `side` from it, along each axis,
        is painted."""
        self.mesh, self.surface = mesh, Surface.of(mesh)
        uv = (np.indices((texels, texels)).reshape(2, -1).T[:, ::-1] + 0.5) / texels
        uv[:, 1] = 1.0 - uv[:, 1]
        triangle = cKDTree(self.surface.uv.mean(axis=1)).query(uv)[1]
        place = self.surface.place(triangle, uv) * self.surface.scale
        inside = (np.abs(place - at) <= 0.5 * side).all(axis=1)
        self.texels, self.places = inside.reshape(texels, texels), place.reshape(texels, texels, 3)
        self._patch = cKDTree(place[inside])

    def map(self, value: float, elsewhere: float) -> NDArray[np.float32]:
        """One value on the patch and another elsewhere."""
        return np.where(self.texels, np.float32(value), np.float32(elsewhere))

    def away(self, places: Floats) -> Floats:
        """(N,) straight distance of places (N, 3) to the patch, mesh units."""
        distance: Floats = self._patch.query(places.reshape(-1, 3))[0].reshape(places.shape[:-1])
        return distance

    def reach(self, one: WrinkleGraph, two: WrinkleGraph, spacing: float) -> Reach:
        """In units of `spacing`."""
        both = [self._things(graph) for graph in (one, two)]
        farthest = []
        for kind in range(4):
            first, second = both[0][kind], both[1][kind]
            changed = [first[k] for k in first.keys() - second.keys()]
            changed += [second[k] for k in second.keys() - first.keys()]
            away = self.away(np.array(changed)) / spacing if changed else np.zeros(1)
            farthest.append(float(away.max()))
        lost = len(both[0][3].keys() - both[1][3].keys()) / len(both[0][3])
        return Reach(farthest[0], farthest[1], max(farthest[2:]), lost)

    def _things(self, graph: WrinkleGraph) -> tuple[Things, Things, Things, Things]:
        """Where pores lie and which wrinkles there are, and the same with all that is drawn: bytes
        that tell them apart, and where on the surface they are."""
        place = sheets.places(self.surface, graph) * self.surface.scale
        uv, metric = graph.node_uv, graph.node_metric
        assert metric is not None
        drawn = np.column_stack([uv, graph.node_weight, graph.node_radius, metric])
        ends = graph.edge_nodes
        across = np.column_stack([uv[ends[:, 0]], uv[ends[:, 1]]])
        worn = np.column_stack([across, graph.edge_weight, graph.edge_half_width])
        middle = place[ends].mean(axis=1)
        # Nodes that only stand for a pore beyond a seam come and go with their wrinkles.
        copied = graph.node_copy_of
        pores = slice(None) if copied is None else copied == ORIGINAL
        return (
            _by_bytes(uv[pores], place[pores]), _by_bytes(across, middle), _by_bytes(drawn, place),
            _by_bytes(worn, middle),
        )  # fmt: skip


def _by_bytes(values: Floats, places: Floats) -> Things:
    rows = np.ascontiguousarray(values, np.float32)
    return {row.tobytes(): place for row, place in zip(rows, places, strict=True)}


def beside(mesh: Mesh, other: Mesh, uv: tuple[float, float], at: Floats) -> Mesh:
    """A mesh with all triangles of another after its own, that moved in UV and in space."""
    return Mesh(
        np.concatenate([mesh.positions, (other.positions + at).astype(np.float32)]),
        np.concatenate([mesh.faces, other.faces + len(mesh.positions)]),
        np.concatenate([mesh.uv, other.uv + np.array(uv)]),
        np.concatenate([mesh.face_uv, other.face_uv + len(mesh.uv)]),
    )
