"""What is measured of a device: in memory that another process reads, and by a real engine."""

from __future__ import annotations

import threading
from contextvars import copy_context
from pathlib import Path

import pytest

from engine.engines import BINNED, REDRAW, built, draw, new_asset, running
from rhytid.device.budget import BufferPool, MemoryBudget
from rhytid.device.figures import (
    BOUNDS,
    DROPPED,
    JOB_ENDS,
    JOB_KINDS,
    NANOSECONDS,
    SIZE,
    Figures,
    keep_spans,
    spans_are_kept,
    spans_of_request,
    working_on,
)
from rhytid.domain.tiles import TileAddress

AT = TileAddress(1001, 0, 0, 0)


@pytest.fixture
def figures() -> Figures:
    return Figures()


@pytest.mark.parametrize("place", range(len(BOUNDS)))
def test_a_time_is_counted_from_its_bound_on(figures: Figures, place: int) -> None:
    figures.took("kernel", round(BOUNDS[place] * NANOSECONDS))
    counts, seconds = figures.histogram("kernel", "other")
    assert counts == [0] * place + [1] * (len(BOUNDS) + 1 - place)
    assert seconds == pytest.approx(BOUNDS[place])


def test_what_is_longer_than_all_bounds_is_counted(figures: Figures) -> None:
    figures.took("kernel", round(99 * NANOSECONDS))
    counts, seconds = figures.histogram("kernel", "other")
    assert (counts, seconds) == ([0] * len(BOUNDS) + [1], 99)


def test_time_is_spent_on_what_the_block_says(figures: Figures) -> None:
    with working_on("redraw"):
        figures.took("encode", 1)
    with working_on("an asset id"):
        figures.took("encode", 1)
    assert figures.histogram("encode", "redraw")[0][-1] == 1
    assert figures.histogram("encode", "other")[0][-1] == 1
    assert figures.histogram("kernel", "redraw")[0][-1] == 0


def test_the_time_of_a_task_is_split(figures: Figures, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter([1000, 1700])
    monkeypatch.setattr("time.perf_counter_ns", lambda: next(clock))

    def task() -> str:
        figures.read_back(150)
        figures.read_back(50)
        return "done"

    assert figures.task(task, queued=400) == "done"
    found = {stage: figures.histogram(stage, "other")[1] for stage in ("queue", "kernel")}
    assert found == pytest.approx({"queue": 600e-9, "kernel": 500e-9})
    assert figures.histogram("read_back", "other")[1] == pytest.approx(200e-9)


def test_another_process_reads_and_goes_on(figures: Figures) -> None:
    memory = memoryview(bytearray(SIZE))
    first = Figures(memory)
    first.count("ended", "build", "done")
    first.set(7, "used")
    first.took("queue", 5)
    second = Figures(memory)
    second.begin()
    second.count("ended", "build", "done")
    assert (first.value("ended", "build", "done"), first.value("used")) == (2, 0)
    assert first.histogram("queue", "other")[0][-1] == 1


def test_no_count_is_lost_between_threads(figures: Figures) -> None:
    def count() -> None:
        for _ in range(2000):
            figures.count("dropped", "asset")
            figures.took("queue", 1)

    threads = [threading.Thread(target=count) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert figures.value("dropped", "asset") == 8000
    assert figures.histogram("queue", "other")[0][-1] == 8000


def test_the_stages_of_one_request_are_kept_over_threads(figures: Figures) -> None:
    assert not spans_are_kept()
    keep_spans([])
    with spans_of_request() as spans:
        context = copy_context()
        thread = threading.Thread(target=lambda: context.run(figures.took, "kernel", 30))
        thread.start()
        thread.join()
        keep_spans(spans[:1])
    figures.took("kernel", 1)
    assert [(span.stage, span.nanoseconds) for span in spans] == [("kernel", 30)] * 2
    assert spans[0].start > 0


def test_an_engine_counts_what_it_does(tmp_path: Path) -> None:
    with running(tmp_path) as engine:
        (figures,) = engine.figures.values()
        asset = built(engine, new_asset())
        draw(engine, asset, "neutral", REDRAW, AT)
        ended = {
            (kind, state): n
            for kind in JOB_KINDS
            for state in JOB_ENDS
            if (n := figures.value("ended", kind, state))
        }
        assert ended == {("build", "done"): 1, ("bins", "done"): 1}
        assert not any(figures.value("jobs", kind, "running") for kind in JOB_KINDS)
        for stage in ("queue", "kernel", "read_back"):
            assert figures.histogram(stage, "redraw")[0][-1] >= 1, stage
            assert figures.histogram(stage, "binned")[0][-1] == 0, stage
            assert figures.histogram(stage, "job")[0][-1] > 10, stage
        draw(engine, asset, "neutral", BINNED, AT)
        assert figures.histogram("kernel", "binned")[0][-1] == 1
        assert 0 < figures.value("used") <= figures.value("limit")
        assert sum(figures.value("dropped", what) for what in DROPPED) == 0


def test_what_a_short_memory_drops_is_counted(figures: Figures) -> None:
    class Thing:
        def release(self) -> None:
            budget.free(10)

    dropped: list[object] = []
    budget = MemoryBudget(25, BufferPool(), dropped.append)

    def make() -> Thing:
        budget.reserve(10)
        return Thing()

    budget.keep("first", make)
    budget.keep("second", make)
    budget.new_task()
    budget.reserve(10)
    budget.discard("second")
    assert dropped == ["first"]
