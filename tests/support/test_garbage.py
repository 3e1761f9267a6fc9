"""A process that answers requests looks for garbage among all its objects while it rests."""

from __future__ import annotations

import gc
import threading
import time
import weakref
from collections.abc import Iterator

import pytest

from rhytid.support import garbage
from rhytid.support.garbage import GarbageAtRest, tidy_at_rest


class Node:
    """An object that refers to itself: only a search finds that nobody else does."""

    def __init__(self) -> None:
        self.own = self


@pytest.fixture(autouse=True)
def _as_before() -> Iterator[None]:
    before = gc.get_threshold()
    gc.collect()
    yield
    gc.set_threshold(*before)
    gc.unfreeze()


def old_garbage() -> weakref.ref[Node]:
    """Garbage that searches among younger objects do not find any more."""
    made = Node()
    gc.collect()  # it is old from now on
    return weakref.ref(made)


@pytest.fixture
def worked(monkeypatch: pytest.MonkeyPatch) -> None:
    """As if the process had worked for long before each search, and did not meanwhile."""
    seconds = iter([0.0, 10.0, 10.0, 10.0, 20.0, 20.0, 20.0])
    monkeypatch.setattr(time, "process_time", lambda: next(seconds))


@pytest.mark.usefixtures("worked")
def test_garbage_goes_while_the_process_rests() -> None:
    at_rest, found = GarbageAtRest(), old_garbage()
    assert at_rest.search(threading.Event())
    assert found() is None


@pytest.mark.usefixtures("worked")
def test_garbage_of_what_was_there_at_an_earlier_rest_goes() -> None:
    at_rest, made = GarbageAtRest(), Node()
    assert at_rest.search(threading.Event())
    found = weakref.ref(made)
    del made
    gc.collect()
    assert found() is not None  # no search looks at it while the process works
    assert at_rest.search(threading.Event())
    assert found() is None


@pytest.mark.parametrize(
    "seconds", [(0.0, 10.0, 10.2, 10.2), (0.0, 0.5, 0.5, 0.5)], ids=["works", "did little"]
)
def test_nobody_waits_for_a_search(
    seconds: tuple[float, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    times = iter(seconds)
    monkeypatch.setattr(time, "process_time", lambda: next(times))
    at_rest, found = GarbageAtRest(), old_garbage()
    assert not at_rest.search(threading.Event())
    assert found() is not None


def test_frames_do_not_set_off_a_search_among_all_objects() -> None:
    """Each keeps some objects for a while, as those that are kept for the next call."""
    full, kept = [], list[list[Node]]()

    def note(phase: str, info: dict[str, int]) -> None:
        if phase == "stop" and info["generation"] == 2:
            full.append(info)

    GarbageAtRest()
    gc.callbacks.append(note)
    try:
        for _ in range(300):
            kept.append([Node() for _ in range(700)])
    finally:
        gc.callbacks.remove(note)
    assert not full


def test_others_are_tidied_every_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(garbage, "_PAUSE", 0.001)
    end, called = threading.Event(), threading.Event()
    tidy_at_rest(end, also=called.set)
    assert called.wait(10.0)
    end.set()
