"""Maps painted on sheets, and what grew there, for tests of synthesis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.painted_maps import Controls
from rhytid.synthesis.surface import Surface
from synthesis import sheets

MID = 0.5


def right(value: float, left: float = MID) -> NDArray[np.float32]:
    """A map of one value right of u = 0.5 and another left of it."""
    map = np.full((64, 64), left, np.float32)
    map[:, 32:] = value
    return map


def painted(**maps: NDArray[np.float32]) -> Controls:
    """Maps of UDIM 1001."""
    return Controls({name: {1001: map} for name, map in maps.items()})


@dataclass(frozen=True)
class Half:
    """Of the pores and wrinkles of one half of a sheet: counts, means, and the sum of squared
    weights times (cos 2a, sin 2a) over that of the squared weights, a = angle of the wrinkle."""

    pores: int
    spacing: float
    weight: float
    half_width: float
    radius: float
    order: complex

    @property
    def axis(self) -> float:
        """Degrees, from 0 to 180."""
        return float(np.degrees(np.angle(self.order)) / 2 % 180)


def halves(mesh: Mesh, graph: WrinkleGraph) -> tuple[Half, Half]:
    """Left and right of u = 0.5, without a strip in between. For sheets in the plane z = 0."""
    at = sheets.places(Surface.of(mesh), graph)[:, :2]
    nearest = cKDTree(at).query(at, k=2)[0][:, 1]
    u = graph.node_uv[:, 0]
    return _half(graph, at, nearest, u < 0.45), _half(graph, at, nearest, u > 0.55)


def _half(
    graph: WrinkleGraph,
    at: NDArray[np.float64],
    nearest: NDArray[np.float64],
    chosen: NDArray[np.bool_],
) -> Half:
    both = chosen[graph.edge_nodes].all(axis=1)
    way = np.diff(at[graph.edge_nodes[both]], axis=1)[:, 0] @ [1, 1j]
    weight = graph.edge_weight[both].astype(np.float64)
    order = (weight**2 * (way / abs(way)) ** 2).sum() / (weight**2).sum()
    means = (x.mean() for x in (nearest[chosen], weight, graph.edge_half_width[both]))
    return Half(int(chosen.sum()), *map(float, means), graph.node_radius[chosen].mean(), order)
