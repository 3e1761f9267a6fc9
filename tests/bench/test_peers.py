"""Every peer gives what rhytid gives. Run by `pytest -m peers`, and fails where one is missing."""

from __future__ import annotations

import sys
from collections.abc import Iterator

import pytest

from bench.small_bench import small_bench
from rhytid.device.runtime import Device
from rhytid_lab.bench import peers
from rhytid_lab.bench.comparison import OURS, Comparison
from rhytid_lab.bench.frame import FrameBench

pytestmark = pytest.mark.peers
# Readers of textures may round places; the rest differs by what float32 rounds.
CLOSE = {"convolved": 1e-4}


@pytest.fixture(scope="module")
def bench(device: Device) -> Iterator[FrameBench]:
    made = small_bench(device)
    yield made
    made.release()


@pytest.mark.parametrize(
    ("name", "case"), [(name, case) for name in peers.PEERS for case in peers.cases_of(name)]
)
def test_a_peer_agrees(bench: FrameBench, name: str, case: str) -> None:
    results = Comparison(bench, (OURS, name), 1).run([case])

    assert results.untimed == []
    assert 0 < results.timings[1].max_difference < CLOSE.get(case, 1e-5)


@pytest.mark.parametrize("name", peers.PEERS)
def test_the_table_of_peers_is_what_they_do(bench: FrameBench, name: str) -> None:
    case = peers.cases_of(name)[0]
    peers.prepare(name, case, bench.scene()).release()

    assert tuple(sys.modules[f"rhytid_lab.bench.peers.with_{name}"].CASES) == peers.cases_of(name)
