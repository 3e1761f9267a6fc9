"""What failed a moment ago, and what is pushed again later."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Callable

import pytest

from rhytid.engine import shared_assets
from rhytid.engine.shared_assets import PushRetries
from rhytid.engine.shared_calls import RecentFailures
from rhytid.errors import SharedDamageError

LONG = 10.0


class Much:
    """Stands in for an asset that was read."""


class Timers:
    """In place of `threading.Timer`: what was started, to be fired by hand."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.started: list[Callable[[], None]] = []
        patch.setattr(shared_assets.threading, "Timer", self)

    def __call__(self, seconds: float, call: Callable[[], None]) -> Timers:
        assert seconds == shared_assets.PAUSE
        self._call = call
        return self

    def start(self) -> None:
        self.started.append(self._call)

    def cancel(self) -> None:
        self.started.clear()

    def fire(self) -> None:
        """The pause is over."""
        [call] = self.started
        self.started.clear()
        call()


@pytest.fixture
def timers(monkeypatch: pytest.MonkeyPatch) -> Timers:
    return Timers(monkeypatch)


def test_a_store_that_stays_away_is_asked_once_in_a_pause(timers: Timers) -> None:
    pushed: list[str] = []
    retries = PushRetries(pushed.append)
    for id in "abca":
        retries.add(id)
    for tried in "abcab":
        timers.fire()
        assert pushed.pop() == tried
        assert pushed == []
        retries.add(tried)


def test_once_a_push_went_well_all_are_pushed(timers: Timers) -> None:
    pushed: list[str] = []
    retries = PushRetries(pushed.append)
    for id in "abc":
        retries.add(id)
    timers.fire()
    assert pushed == ["a"]
    retries.went_well()
    assert pushed == ["a", "b", "c"]
    timers.fire()
    assert (pushed, timers.started) == (["a", "b", "c"], [])


def test_one_that_is_gone_keeps_no_other_waiting(timers: Timers) -> None:
    """It is neither pushed nor does it fail because the store is away."""
    pushed: list[str] = []
    retries = PushRetries(pushed.append)
    for id in "ab":
        retries.add(id)
    timers.fire()
    timers.fire()
    assert pushed == ["a", "b"]


def test_nothing_is_pushed_after_the_end(timers: Timers) -> None:
    pushed: list[str] = []
    retries = PushRetries(pushed.append)
    retries.add("a")
    retries.close()
    assert timers.started == []
    retries.add("b")
    retries.went_well()
    assert (pushed, timers.started) == ([], [])


def test_a_timer_pushes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shared_assets, "PAUSE", 0.01)
    done = threading.Event()
    PushRetries(lambda id: done.set()).add("a")
    assert done.wait(LONG)


def test_what_failed_is_remembered_without_what_had_been_read() -> None:
    failures, much = RecentFailures(60.0), Much()
    kept = weakref.ref(much)

    def read(much: Much) -> None:
        raise SharedDamageError("a place and why")

    try:
        read(much)
    except SharedDamageError as error:
        failures.add("a", error)
    del much
    assert kept() is None
    for _ in range(2):
        with pytest.raises(SharedDamageError, match="a place and why"):
            failures.check("a")
    failures.check("b")
    failures.forget("a")
    failures.check("a")


def test_what_failed_is_forgotten_after_a_while() -> None:
    failures = RecentFailures(0.0)
    failures.add("a", SharedDamageError("why"))
    failures.check("a")
    assert not failures._errors
