"""The two clients, one after the other, and a clock that stands still."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import pytest

from clients.shells import Clock, Shell


@pytest.fixture(params=["sync", "async"])
def shell(request: pytest.FixtureRequest) -> Callable[..., Shell]:
    """Makes a client of one kind over a handler."""
    return partial(Shell, request.param)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    return Clock(monkeypatch)
