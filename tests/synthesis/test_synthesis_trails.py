"""Trails: what walkers like is worn."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from rhytid.synthesis.charts import neighbours
from rhytid.synthesis.crossings import crossings
from rhytid.synthesis.edges import Edges, candidates
from rhytid.synthesis.paths import Paths, rank_at
from rhytid.synthesis.pores import scatter_pores
from rhytid.synthesis.progress import silent
from rhytid.synthesis.selection import preference
from rhytid.synthesis.surface import Points, Surface
from rhytid.synthesis.trails import wear
from synthesis import sheets

Worn = tuple[Points, Edges, NDArray[np.int64], NDArray[np.float64]]


@pytest.fixture(scope="module")
def worn() -> Worn:
    """A sheet whose preferred direction is x everywhere, with the strength of its edges."""
    mesh, radius = sheets.sheet(), 0.03
    surface, rng = Surface.of(mesh), np.random.default_rng(2)
    pores = scatter_pores(surface, radius, rng, silent)
    edges = candidates(surface, neighbours(mesh), pores, radius, 8)
    found = crossings(pores, edges.nodes, edges.length)
    along, left = (np.tile(axis, (len(pores), 1)) for axis in np.eye(3)[:2])
    paths = Paths.of(pores, edges.nodes, along, left)
    return pores, edges, found, wear(paths, edges.length, found, rng, silent)


def test_a_way_out_leads_back() -> None:
    nodes = np.array([[0, 1], [1, 2], [0, 2]])
    position = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], float)
    points = Points(np.zeros(3, int), position[:, :2], position, np.tile([0.0, 0, 1], (3, 1)))
    along, left = (np.tile(axis, (3, 1)) for axis in np.eye(3)[:2])
    paths = Paths.of(points, nodes, along, left)
    for pore in range(3):
        for slot in range(2):
            to, back = paths.to[pore, slot], paths.back[pore, slot]
            assert paths.edge[to, back] == paths.edge[pore, slot]
            assert paths.to[to, back] == pore
            assert paths.cosine[to, back] == pytest.approx(-paths.cosine[pore, slot])


def test_ranks_count_within_a_pore() -> None:
    assert rank_at(np.array([2, 0, 2, 2, 0]), 3).tolist() == [0, 0, 1, 2, 1]


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


def test_what_is_wanted_first_is_flat_and_closed(worn: Worn) -> None:
    pores, edges, found, strength = worn
    order = preference(len(pores), edges, strength, found)
    assert sorted(order.tolist()) == list(range(len(edges)))
    first = edges.take(order[: int(2.1 * len(pores))])
    assert len(crossings(pores, first.nodes, first.length)) == 0
    degree = np.bincount(first.nodes.ravel(), minlength=len(pores))
    inner = (np.abs(pores.position[:, :2]) < 0.42).all(axis=1)
    assert degree[inner].min() >= 3
