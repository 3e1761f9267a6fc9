"""The order in which devices are tried."""

from __future__ import annotations

import pytest

from rhytid.device import select
from rhytid.errors import NoDeviceError

POCL, OTHER = "Portable Computing Language", "Another platform"


def candidate(index, kind, platform=OTHER):
    return select.Candidate(
        index=index, name=f"{kind} {index}", platform=platform, kind=kind, version="1.2",
        compute_units=1, memory=1, largest_buffer=1, local_memory=1,
        largest_group=1, handle=None,
    )  # fmt: skip


FOUND = (
    candidate(0, "other"),
    candidate(1, "cpu", POCL),
    candidate(2, "cpu"),
    candidate(3, "gpu", POCL),
    candidate(4, "gpu"),
    candidate(5, "gpu"),
)


def chosen(monkeypatch, working, wanted=None):
    monkeypatch.setattr(select, "candidates", lambda: FOUND)
    monkeypatch.setattr(select, "computes", lambda c: c.index in working)
    return select.choose(wanted).index


def test_gpus_come_first_then_cpus_other_than_pocl_then_pocl(monkeypatch):
    left, order = set(range(6)), []
    while left:
        order.append(chosen(monkeypatch, left))
        left.discard(order[-1])
    assert order == [4, 5, 3, 2, 1, 0]


def test_what_is_named_is_used_or_nothing(monkeypatch):
    assert chosen(monkeypatch, {1, 4}, "portable") == 1
    with pytest.raises(NoDeviceError, match="other 0"):
        chosen(monkeypatch, {1, 4}, "0")
