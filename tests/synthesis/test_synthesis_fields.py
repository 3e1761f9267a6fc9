"""What differs from place to place: each field does what it says, and where it says."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from rhytid.device.runtime import Device
from rhytid.domain.graph import WrinkleGraph
from rhytid.synthesis.fields import Directions, Fields
from rhytid.synthesis.generate import synthesize
from rhytid.synthesis.lattice import Lattice
from rhytid.synthesis.progress import silent
from rhytid.synthesis.trails import FINE, Paths, wear
from rhytid.synthesis.workspace import Workspace
from synthesis import sheets

COUNT = 4000


class Right(Fields):
    """One field with another value right of the middle of the map."""

    def __init__(self, name: str, value: float) -> None:
        even = getattr(Fields, name)

        def found(triangle: NDArray[Any], uv: NDArray[Any]) -> NDArray[np.float32]:
            left = even(self, triangle, uv)
            return np.where(uv[:, 0] > 0.5, np.float32(value), left).astype(np.float32)

        setattr(self, name, found)


def grown(device: Device, fields: Fields) -> WrinkleGraph:
    return synthesize(sheets.sheet(), sheets.wanted(COUNT), device, fields=fields).graph


@pytest.fixture(scope="module")
def even(device: Device) -> WrinkleGraph:
    return grown(device, Fields())


def sides(graph: WrinkleGraph) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Wrinkles wholly left and wholly right of the middle of the map, with a margin."""
    u = graph.node_uv[graph.edge_nodes, 0]
    return (u < 0.45).all(axis=1), (u > 0.55).all(axis=1)


def test_strength_scales_weights(device: Device, even: WrinkleGraph) -> None:
    graph = grown(device, Right("strength", 0.5))
    left, right = sides(even)
    assert (graph.edge_nodes == even.edge_nodes).all()
    assert graph.edge_weight[right] == pytest.approx(0.5 * even.edge_weight[right], rel=1e-6)
    assert (graph.edge_weight[left] == even.edge_weight[left]).all()
    assert (graph.edge_half_width == even.edge_half_width).all()
    far = even.node_uv[:, 0] > 0.55
    assert graph.node_weight[far] == pytest.approx(0.5 * even.node_weight[far], rel=0.01)


@pytest.mark.parametrize("value", [0.0, 100.0])
def test_weights_stay_in_range(device: Device, value: float) -> None:
    graph = grown(device, Right("strength", value))
    for weight in (graph.edge_weight, graph.node_weight):
        assert 0 < weight.min() <= weight.max() <= 1


def test_width_and_pore_radius_scale_sizes(device: Device, even: WrinkleGraph) -> None:
    wide, large = grown(device, Right("width", 2.0)), grown(device, Right("pore_radius", 2.0))
    left, right = sides(even)
    assert wide.edge_half_width[right] == pytest.approx(2 * even.edge_half_width[right], rel=1e-6)
    assert (wide.edge_half_width[left] == even.edge_half_width[left]).all()
    u = even.node_uv[:, 0]
    assert large.node_radius[u > 0.5] == pytest.approx(2 * even.node_radius[u > 0.5], rel=1e-6)
    assert (large.node_radius[u < 0.5] == even.node_radius[u < 0.5]).all()


def test_turn_turns_directions_left(device: Device) -> None:
    pores = sheets.scattered(device, sheets.sheet(), 0.05)
    fields = (Fields(), Right("turn", np.pi / 2))
    (along, left), turned = (
        Directions(0.05, np.random.default_rng(1), field).frames(pores, silent) for field in fields
    )
    there = pores.uv[:, 0] > 0.5
    assert turned[0][there] == pytest.approx(left[there], abs=1e-5)
    assert turned[1][there] == pytest.approx(-along[there], abs=1e-5)
    assert (turned[0][~there] == along[~there]).all()


def test_without_anisotropy_walkers_go_every_way(device: Device) -> None:
    pores, edges = sheets.net(device, sheets.sheet(), 0.03)
    along, left = (np.tile(axis.astype(np.float32), (len(pores), 1)) for axis in np.eye(3)[:2])
    way = pores.position[edges.nodes[:, 1]] - pores.position[edges.nodes[:, 0]]
    level = np.abs(way[:, 0]) > 0.97 * np.linalg.norm(way, axis=-1)
    lattice, shares = Lattice.absolute(0.03, np.zeros(3), np.ones(3)), []
    for anisotropy in (Fields(), Right("anisotropy", 0.0)):
        with Workspace(device) as work:
            found = anisotropy.anisotropy(pores.triangle, np.ones((len(pores), 2)))
            paths = Paths.of(work, pores, edges, along, left, found, lattice, 0.04)
            strength = wear(work, paths, np.empty((0, 2), np.int32), 2, 2.86, FINE, silent)
        shares.append(strength[level].mean() / strength.mean())
    assert shares[0] > 1.3
    assert 0.8 < shares[1] < 1.15
