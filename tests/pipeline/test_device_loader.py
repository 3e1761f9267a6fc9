"""What is told to OpenCL drivers before they are loaded."""

from __future__ import annotations

import os
import sys

import pytest

from rhytid.device import loader


@pytest.fixture
def told(monkeypatch):
    """What POCL_AFFINITY is, where it was `before` and a process may use some of the cores."""

    def found(cores, before=None):
        monkeypatch.setenv("POCL_AFFINITY", "")  # so that it is put back
        monkeypatch.delenv("POCL_AFFINITY")
        if before is not None:
            monkeypatch.setenv("POCL_AFFINITY", before)
        monkeypatch.setattr(sys, "platform", "linux")
        monkeypatch.setattr(os, "cpu_count", lambda: 4)
        monkeypatch.setattr(os, "sched_getaffinity", lambda pid: cores, raising=False)
        loader._pin_pocl()
        return os.environ.get("POCL_AFFINITY")

    return found


def test_pocl_is_pinned_where_every_core_may_be_used(told):
    assert told({0, 1, 2, 3}) == "1"


def test_pocl_is_not_pinned_to_cores_that_it_may_not_use(told):
    assert told({2, 3}) is None


def test_what_the_user_says_stands(told):
    assert told({0, 1, 2, 3}, before="0") == "0"
