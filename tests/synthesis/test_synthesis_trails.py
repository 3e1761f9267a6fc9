"""Trails: what walkers like is worn."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from rhytid.device.runtime import Device
from rhytid.synthesis.candidate_graph import CandidateGraph, priorities
from rhytid.synthesis.edges import Edges, crossings
from rhytid.synthesis.lattice import Lattice
from rhytid.synthesis.pore_density import edges_per_pore
from rhytid.synthesis.progress import silent
from rhytid.synthesis.surface import Points
from rhytid.synthesis.trails import FINE, Paths, wear
from rhytid.synthesis.workspace import Workspace
from synthesis import sheets

LATTICE = Lattice.absolute(0.03, np.zeros(3), np.ones(3))
Worn = tuple[Points, Edges, NDArray[np.int32], NDArray[np.float32]]


@pytest.fixture(scope="module")
def worn(device: Device) -> Worn:
    """A sheet whose preferred direction is x everywhere, with the strength of its edges."""
    pores, edges = sheets.net(device, sheets.sheet(), 0.03, seed=2)
    with Workspace(device) as work:
        found = crossings(work, pores, edges.nodes, edges.length)
        as_usual = np.ones(len(pores), np.float32)
        paths = Paths.of(work, pores, edges, *frames(len(pores)), as_usual, LATTICE, 0.04)
        return pores, edges, found, wear(work, paths, found, 2, edges_per_pore(8), FINE, silent)


def frames(count: int) -> tuple[NDArray[np.float32], ...]:
    """Along x, and left of it along y."""
    return tuple(np.tile(axis.astype(np.float32), (count, 1)) for axis in np.eye(3)[:2])


def test_ways_out_lead_along_their_edges(device: Device) -> None:
    nodes = np.array([[0, 1], [1, 2], [0, 2]], np.int32)
    position = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], float)
    points = Points(np.zeros(3, int), position[:, :2], position, np.tile([0.0, 0, 1], (3, 1)))
    edges = Edges(nodes, np.float32([1, 1.4, 1]), np.zeros(3, np.int32))
    with Workspace(device) as work:
        paths = Paths.of(work, points, edges, *frames(3), np.ones(3, np.float32), LATTICE, 1.0)
        starts = work.read(paths.ways.offsets, (4,), np.int32)
        pairs = work.read(paths.ways.pairs, (6,), np.int32)
        others = work.read(paths.ways.others, (6,), np.int32)
        direction = work.read(paths.direction, (6, 2), np.int16) / 32767
    assert starts.tolist() == [0, 2, 4, 6]
    assert pairs.tolist() == [0, 2, 0, 1, 1, 2]
    assert others.tolist() == [1, 2, 0, 2, 1, 0]
    way = position[others] - position[np.repeat(np.arange(3), 2)]
    way /= np.linalg.norm(way, axis=-1, keepdims=True)
    assert direction == pytest.approx(way[:, :2], abs=1e-4)


def test_every_edge_has_some_strength_and_few_have_much(worn: Worn) -> None:
    strength = worn[3]
    assert strength.min() > 0
    assert np.median(strength) < strength.mean()
    assert np.percentile(strength, 99) > 3 * strength.mean()


def test_lines_along_the_preferred_direction_are_worn_most(worn: Worn) -> None:
    pores, edges, _, strength = worn
    way = pores.position[edges.nodes[:, 1]] - pores.position[edges.nodes[:, 0]]
    angle = np.degrees(np.arctan2(way[:, 1], way[:, 0])) % 180
    mean = {a: strength[np.abs((angle - a + 90) % 180 - 90) < 15].mean() for a in (0, 72, 126)}
    assert mean[0] > 1.2 * mean[72]
    assert mean[72] > 1.2 * mean[126]


def test_strong_lines_go_on(worn: Worn) -> None:
    # A strong edge has a strong neighbour straight ahead at both ends, far more than by chance.
    pores, edges, _, strength = worn
    strong = edges.nodes[strength > np.percentile(strength, 85)]
    ends = np.bincount(strong.ravel(), minlength=len(pores))
    dead = np.count_nonzero(ends[strong] == 1) / strong.size
    assert dead < 0.25


def test_what_is_wanted_first_is_flat_and_closed(device: Device, worn: Worn) -> None:
    pores, edges, found, strength = worn
    with Workspace(device) as work:
        net = CandidateGraph(
            pores, edges, found, LATTICE, 0.04, edges_per_pore(8), np.empty(0, np.int32),
            np.empty(0, np.float32),
        )  # fmt: skip
        priority = priorities(work, net, strength, silent)
    first = edges.take(np.argsort(-priority)[: int(2.1 * len(pores))])
    with Workspace(device) as work:
        assert len(crossings(work, pores, first.nodes, first.length)) == 0
    degree = np.bincount(first.nodes.ravel(), minlength=len(pores))
    inner = (np.abs(pores.position[:, :2] - 0.5) < 0.42).all(axis=1)
    assert degree[inner].min() >= 3
