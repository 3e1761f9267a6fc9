"""The edges along leaders."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from rhytid.synthesis import ranks


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
    found = ranks._edges_along(net, leaders)
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
    found = ranks._edges_between(net, np.array(pairs, np.int32)).tolist()
    assert found == [joined.index(pair) if pair in joined else -1 for pair in pairs]


def test_where_the_net_does_not_join_two_the_leader_goes_over_the_pore_beside() -> None:
    around = [(1, 4), (2, 4), (1, 5), (2, 5), (3, 4)]
    found = along([(0, 1), (2, 3), *around])
    assert found == {(0, 1): 0.5, (1, 4): 2.0, (2, 4): 2.0, (2, 3): 4.0}


def test_where_they_have_no_neighbour_in_common_it_is_broken() -> None:
    assert along([(0, 1), (2, 3), (1, 4), (2, 5)]) == {(0, 1): 0.5, (2, 3): 4.0}
    assert along([]) == {}
