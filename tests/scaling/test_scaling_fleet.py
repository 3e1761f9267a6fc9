"""Placement and eviction: laws of hashing, of least recently used, and of queues."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rhytid.errors import InputError
from rhytid_lab.scaling.fleet import Fleet, compare, simulate
from rhytid_lab.scaling.hashing import modulo, preference
from rhytid_lab.scaling.lru import Held
from rhytid_lab.scaling.policies import Rendezvous
from rhytid_lab.scaling.usage import Requests, shares, zipf_requests

DEVICES = list(range(100))
HEADS = range(4000)
SMALL = Fleet(devices=50, heads=500, held=20)


def test_rendezvous_moves_only_the_heads_of_the_device_that_left() -> None:
    before = {head: preference(head, DEVICES)[0] for head in HEADS}
    left = [device for device in DEVICES if device != 17]
    moved = [head for head in HEADS if preference(head, left)[0] != before[head]]

    assert moved == [head for head in HEADS if before[head] == 17]
    assert len(moved) / len(HEADS) == pytest.approx(1 / 100, rel=0.5)


def test_naive_hashing_moves_nearly_all() -> None:
    left = DEVICES[:-1]
    moved = [head for head in HEADS if modulo(head, left) != modulo(head, DEVICES)]

    assert len(moved) / len(HEADS) > 0.95


def test_rendezvous_shares_heads_out_evenly() -> None:
    counts = np.bincount([preference(head, DEVICES, 1)[0] for head in HEADS], minlength=100)

    # Of a fair share each count has the mean 40 and about that variance.
    assert counts.mean() == 40
    assert counts.var() == pytest.approx(40, rel=0.5)


def test_the_first_of_an_order_are_the_first_of_the_whole() -> None:
    for head in range(20):
        order = preference(head, DEVICES)
        assert sorted(order) == DEVICES
        assert preference(head, DEVICES, 7) == order[:7]


@given(st.lists(st.integers(0, 9), max_size=60), st.integers(1, 6))
def test_least_recently_used_is_that_of_a_plain_list(used: list[int], most: int) -> None:
    held, plain = Held(most), list[int]()
    for head in used:
        assert held.use(head) == (head in plain)
        plain = [*(one for one in plain if one != head), head][-most:]
        assert {one for one in range(10) if one in held} == set(plain)
        assert len(held) == len(plain)


def test_a_device_holds_something() -> None:
    with pytest.raises(InputError, match="at least 1"):
        Held(0)


def test_requests_follow_the_law_and_the_seed() -> None:
    made = zipf_requests(50_000, 200.0, 100, 1.0, seed=3)
    again = zipf_requests(50_000, 200.0, 100, 1.0, seed=3)

    assert (made.heads == again.heads).all()
    assert (made.times == again.times).all()
    assert made.times[-1] == pytest.approx(250.0, rel=0.02)
    counts = np.bincount(made.heads, minlength=100) / 50_000
    assert counts[:10] == pytest.approx(shares(100, 1.0)[:10], rel=0.1)
    assert shares(100, 1.0)[0] / shares(100, 1.0)[9] == pytest.approx(10.0)


def test_waits_of_one_device_by_hand() -> None:
    fleet = Fleet(devices=1, heads=3, held=2, work=1.0, load=10.0)
    # Two heads are there at first, those that are used most; the third is loaded and drives 1 out.
    requests = Requests(np.array([0.0, 0.5, 1.0, 20.0]), np.array([0, 2, 0, 1]))
    found = simulate(fleet, Rendezvous(1), requests, warm=0.0)

    waits = [0.0, 0.5 + 10.0, 12.0 - 1.0, 10.0]
    assert found.hits == 0.5
    assert found.median == pytest.approx(np.median(waits))
    assert found.p99 == pytest.approx(np.percentile(waits, 99))
    assert found.loads == pytest.approx(2 / 20.0)


def test_hot_heads_wait_less_where_they_are_replicated() -> None:
    found = {one.policy: one for one in compare(SMALL, 20_000)}

    naive, replicated = found["id mod N"], found["rendezvous, hot heads replicated"]
    assert replicated.p99 < naive.p99 / 10
    assert replicated.balance < naive.balance / 2
    assert replicated.hits > 0.9


def test_the_same_seed_gives_the_same_outcome() -> None:
    assert compare(SMALL, 2000) == compare(SMALL, 2000)
