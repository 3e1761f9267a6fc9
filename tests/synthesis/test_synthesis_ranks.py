"""The edges along leaders, and their sizes."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rhytid.synthesis import ranks
from rhytid.synthesis.leader_families import FROWN_LEFT, RINGS
from rhytid.synthesis.leaders import LeaderEdges, _edges_between, edges_along


class Pores(SimpleNamespace):
    def __len__(self) -> int:
        return len(self.position)


def along(edges: list[tuple[int, int]]) -> dict[tuple[int, int], float]:
    """The depths of edges along a leader over pores 0, 1, 2 and 3, which lie in a row; 4 and 5 lie
    beside 1 and 2, 5 farther off."""
    places = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0], [1.5, 0.3, 0], [1.5, -0.6, 0]]
    net: Any = SimpleNamespace(
        pores=Pores(position=np.array(places, np.float64)),
        edges=SimpleNamespace(nodes=np.array(sorted(edges), np.int32).reshape(-1, 2)),
        first=np.arange(4),
    )
    depth = np.array([0.0, 1.0, 3.0, 5.0], np.float32)
    leaders: Any = SimpleNamespace(
        line=np.zeros(4, int), depth=depth, width=depth, profile=depth, family=np.zeros(4, int)
    )
    found = edges_along(net, leaders)
    nodes = map(tuple, net.edges.nodes[found.edge].tolist())
    return dict(zip(nodes, found.depth.tolist(), strict=True))


def test_leaders_follow_the_edges_between_their_pores() -> None:
    row = [(0, 1), (1, 2), (2, 3)]
    assert along([*row, (1, 4), (2, 4)]) == {(0, 1): 0.5, (1, 2): 2.0, (2, 3): 4.0}


def test_every_edge_of_a_pore_is_found_by_its_other_end() -> None:
    rng = np.random.default_rng(2)
    pairs = [(i, j) for i in range(12) for j in range(i + 1, 12)]
    joined = sorted(pairs[k] for k in rng.choice(len(pairs), 40, replace=False))
    net: Any = SimpleNamespace(edges=SimpleNamespace(nodes=np.array(joined, np.int32)))
    found = _edges_between(net, np.array(pairs, np.int32)).tolist()
    assert found == [joined.index(pair) if pair in joined else -1 for pair in pairs]


def test_where_the_net_does_not_join_two_the_leader_goes_over_the_pore_beside() -> None:
    around = [(1, 4), (2, 4), (1, 5), (2, 5), (3, 4)]
    found = along([(0, 1), (2, 3), *around])
    assert found == {(0, 1): 0.5, (1, 4): 2.0, (2, 4): 2.0, (2, 3): 4.0}


def test_where_they_have_no_neighbour_in_common_it_is_broken() -> None:
    assert along([(0, 1), (2, 3), (1, 4), (2, 5)]) == {(0, 1): 0.5, (2, 3): 4.0}
    assert along([]) == {}


@pytest.mark.parametrize(("worn", "power"), [(-1.2, 1.0), (0.0, 1.0), (0.5, 1.25), (1.0, 1.5)])
def test_a_worn_pair_of_a_frown_is_uneven(worn: float, power: float) -> None:
    """Where it fades or is shallow by chance it is the shallower the older skin is, and never
    steps: it stays a power of what it is at 35."""
    profile, one = np.linspace(0.05, 1.0, 20, dtype=np.float32), np.ones(20, np.float32)
    family = np.where(np.arange(20) % 2, FROWN_LEFT.number, RINGS.number)
    along = LeaderEdges(
        np.arange(20), 0.8 * profile, 0.8 * one, profile, family, np.zeros(20, np.int64)
    )
    _, found, width = ranks._sizes(along, one, one, 1.0, worn, one, 0.0 * one)
    pair = family == FROWN_LEFT.number
    np.testing.assert_allclose(found[pair], profile[pair] ** power, rtol=1e-5)
    np.testing.assert_array_equal(found[~pair], profile[~pair])
    assert (width == width[0]).all()
