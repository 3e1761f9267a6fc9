"""Work on all cores is in order, and leaves room for that of others."""

from __future__ import annotations

import gc
import threading
import time
import weakref
from collections.abc import Iterator
from contextlib import suppress

import pytest

from rhytid.support import cores
from rhytid.support.cores import on_all_cores


@pytest.fixture(autouse=True)
def three_cores(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(cores, "core_count", lambda: 3)
    cores._pool.cache_clear()
    yield
    cores._pool.cache_clear()


def test_results_come_in_order_whatever_takes_longest() -> None:
    def slow_first(item: int) -> int:
        time.sleep(0.05 if item == 0 else 0.0)
        return item * item

    assert on_all_cores(slow_first, range(20)) == [n * n for n in range(20)]


def test_short_work_does_not_wait_for_all_that_another_has_asked_for() -> None:
    begun: list[int] = []
    go = threading.Event()

    def long(item: int) -> None:
        begun.append(item)
        go.wait(10)

    other = threading.Thread(target=lambda: on_all_cores(long, range(30)))
    other.start()
    threading.Timer(0.1, go.set).start()
    before = on_all_cores(lambda _: len(begun), range(2))
    other.join()
    assert max(before) < 30
    assert sorted(begun) == [*range(30)]


def test_what_has_not_begun_is_dropped_after_an_error() -> None:
    begun = []

    def fails(item: int) -> None:
        begun.append(item)
        raise ValueError(item)

    with pytest.raises(ValueError, match="0"):
        on_all_cores(fails, range(30))
    assert len(begun) <= 2 * 3


def test_an_error_leaves_nothing_behind() -> None:
    class Found(ValueError):
        pass

    kept: list[weakref.ref[Found]] = []

    def made() -> Found:
        kept.append(weakref.ref(found := Found()))
        return found

    def fails(item: int) -> Found:
        if item == 5:
            raise made()
        return made()

    gc.disable()
    try:
        with suppress(ValueError):
            on_all_cores(fails, range(6))
        assert len(kept) == 6
        assert not [one for one in kept if one() is not None]
    finally:
        gc.enable()
