"""Bytes that requests hold at once: waiting, refusal and order."""

from __future__ import annotations

import asyncio
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine.engines import new_asset, rest, running
from pipeline.scenes import sheet
from rhytid.engine.byte_budget import ByteBudget, Hold
from rhytid.engine.jobs import Jobs
from rhytid.errors import HostBusyError, HostMemoryError


def held(budget: ByteBudget, nbytes: int, purpose: str = "answers") -> Hold:
    hold = budget.hold(purpose)
    hold.grow(nbytes)
    return hold


def until(budget: ByteBudget, waiting: int) -> None:
    """Until so many wait."""
    for _ in range(10_000):
        if budget.waiting == waiting:
            return
        asyncio.run(asyncio.sleep(0.001))
    raise AssertionError(f"{budget.waiting} wait, not {waiting}")


def test_bytes_are_counted_by_what_they_are_held_for() -> None:
    budget = ByteBudget(100, "X")
    one, two = held(budget, 40), held(budget, 50, "uploads")
    assert (budget.used, budget.used_for("answers"), budget.used_for("uploads")) == (90, 40, 50)
    one.resize(10)
    two.release()
    two.release()
    assert (budget.used, budget.used_for("answers"), budget.used_for("uploads")) == (10, 10, 0)


def test_what_does_not_fit_waits_until_others_give_back() -> None:
    budget = ByteBudget(100, "X", patience=30)
    first = held(budget, 80)
    with ThreadPoolExecutor(1) as pool:
        second = pool.submit(held, budget, 60)
        until(budget, 1)
        assert not second.done()
        first.resize(40)
        assert second.result(10).nbytes == 60
    assert (budget.used, budget.waiting) == (100, 0)


def test_who_waited_long_enough_is_refused_and_holds_nothing() -> None:
    budget = ByteBudget(100, "RHYTID_SOMETHING", patience=0.01)
    first, second = held(budget, 80), budget.hold("answers")
    with pytest.raises(HostBusyError, match=r"80 of 100 bytes .*RHYTID_SOMETHING.* 60 more"):
        second.grow(60)
    first.release()
    assert (budget.used, budget.waiting, second.nbytes) == (0, 0, 0)


def test_a_job_that_is_cancelled_waits_for_no_bytes() -> None:
    budget, jobs = ByteBudget(100, "X", patience=60), Jobs(4)
    first, second = held(budget, 80), budget.hold("jobs")
    job = jobs.start("package", "a", lambda job: second.grow(60))
    until(budget, 1)
    jobs.cancel(job.info.id)
    assert job.wait(5)
    assert (job.info.state, budget.used, budget.waiting) == ("cancelled", first.nbytes, 0)
    jobs.close()


def test_what_would_never_fit_is_refused_at_once() -> None:
    budget = ByteBudget(100, "RHYTID_SOMETHING", patience=1000)
    hold = held(budget, 60)
    with pytest.raises(HostMemoryError, match=r"takes 101 bytes: RHYTID_SOMETHING allows 100"):
        hold.grow(41)
    assert hold.nbytes == 60


def test_new_requests_do_not_overtake_one_that_waits() -> None:
    budget = ByteBudget(100, "X", patience=30)
    first = held(budget, 60)
    with ThreadPoolExecutor(3) as pool:
        much = pool.submit(held, budget, 90)
        until(budget, 1)
        little = pool.submit(held, budget, 30)  # would fit
        until(budget, 2)
        less = pool.submit(held, budget, 5)
        until(budget, 3)
        first.release()
        assert much.result(10).nbytes == 90
        assert budget.waiting == 2
        much.result().release()
        assert (little.result(10).nbytes, less.result(10).nbytes) == (30, 5)


def test_requests_behind_one_that_gives_up_are_served() -> None:
    budget = ByteBudget(100, "X", patience=0.5)
    held(budget, 60)
    with ThreadPoolExecutor(2) as pool:
        much = pool.submit(held, budget, 90)
        until(budget, 1)
        budget.patience = 30
        little = pool.submit(held, budget, 30)
        with pytest.raises(HostBusyError):
            much.result(10)
        assert little.result(10).nbytes == 30


def test_a_hold_that_has_bytes_grows_while_new_ones_wait() -> None:
    """A new request waits for those bytes: neither would end otherwise."""
    budget = ByteBudget(100, "X", patience=30)
    first, second = held(budget, 60), held(budget, 20)
    with ThreadPoolExecutor(3) as pool:
        new = pool.submit(held, budget, 90)
        until(budget, 1)
        first.grow(10)  # at once, on this thread
        large = pool.submit(first.grow, 30)
        until(budget, 2)
        newer = pool.submit(held, budget, 1)  # would fit, but large ones wait
        until(budget, 3)
        second.grow(5)
        second.release()
        large.result(10)
        assert (first.nbytes, new.done(), newer.done()) == (100, False, False)
        first.release()
        assert (new.result(10).nbytes, newer.result(10).nbytes) == (90, 1)


def test_nothing_is_held_at_once_though_others_wait() -> None:
    budget = ByteBudget(100, "X", patience=30)
    first = held(budget, 60)
    with ThreadPoolExecutor(1) as pool:
        much = pool.submit(held, budget, 90)
        until(budget, 1)
        assert held(budget, 0).nbytes == 0
        first.release()
        much.result(10)


def test_a_hold_is_split_without_waiting() -> None:
    budget = ByteBudget(100, "X", patience=30)
    whole = held(budget, 90, "uploads")
    part = whole.split("jobs", 40)
    assert (whole.nbytes, part.nbytes, budget.used) == (50, 40, 90)
    assert (budget.used_for("uploads"), budget.used_for("jobs")) == (50, 40)
    rest = whole.split("jobs", 60)  # it has no more
    assert (whole.nbytes, rest.nbytes) == (0, 50)
    part.release()
    assert (budget.used, budget.used_for("jobs")) == (50, 50)


def test_waiting_on_the_event_loop_blocks_nobody_on_it() -> None:
    budget = ByteBudget(100, "X", patience=30)

    async def both() -> tuple[int, int]:
        first, second = budget.hold("uploads"), budget.hold("uploads")
        await first.grow_async(80)
        waiting = asyncio.create_task(second.grow_async(60))
        while not budget.waiting:
            await asyncio.sleep(0)
        first.release()
        await waiting
        return first.nbytes, second.nbytes

    assert asyncio.run(both()) == (0, 60)


def test_a_wait_that_is_cancelled_leaves_nothing_behind() -> None:
    budget = ByteBudget(100, "X", patience=30)

    async def cancelled() -> None:
        first, second = budget.hold("uploads"), budget.hold("uploads")
        await first.grow_async(80)
        waiting = asyncio.create_task(second.grow_async(60))
        while not budget.waiting:
            await asyncio.sleep(0)
        waiting.cancel()
        with pytest.raises(asyncio.CancelledError):
            await waiting
        first.release()

    asyncio.run(cancelled())
    assert (budget.used, budget.waiting) == (0, 0)


def test_the_event_loop_is_told_when_bytes_did_not_come() -> None:
    budget = ByteBudget(100, "X", patience=0.01)
    held(budget, 80)
    with pytest.raises(HostBusyError):
        asyncio.run(budget.hold("uploads").grow_async(21))
    assert budget.waiting == 0


@given(st.lists(st.integers(1, 60), min_size=1, max_size=40))
def test_never_more_than_the_limit_is_held(sizes: list[int]) -> None:
    budget, most = ByteBudget(100, "X", patience=30), []

    def some(nbytes: int) -> None:
        hold = held(budget, nbytes)
        most.append(budget.used)
        hold.release()

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(some, sizes))
    assert max(most) <= 100
    assert (budget.used, budget.waiting) == (0, 0)


def test_frames_count_until_their_job_has_stored_them(tmp_path: Path) -> None:
    mesh = sheet()
    frames = np.stack([mesh.positions * np.float32(1.01)] * 3)
    with running(tmp_path, host_memory=frames.nbytes + 1) as engine:
        gate = threading.Event()
        for large in (True, False):
            engine.jobs.start("build", f"{large}", lambda job: gate.wait(60), small=not large)
        info = engine.assets.create(replace(new_asset(mesh), frames=frames))
        assert engine.memory.used_for("jobs") == frames.nbytes
        engine.memory.patience = 0.01
        with pytest.raises(HostBusyError, match="RHYTID_HOST_MEMORY_MB"):
            engine.assets.create(replace(new_asset(mesh, seed=2), frames=frames[[0, 1]]))
        assert [found.id for found in engine.assets.all()] == [info.id]
        gate.set()
        rest(engine)
        assert engine.memory.used == 0
        assert [frame.name for frame in engine.frames.all(info.id)][1:] == ["0001", "0002", "0003"]


def test_frames_of_an_upload_are_counted_once(tmp_path: Path) -> None:
    """They are moved from the request to the job, which waits for nothing though all is held."""
    mesh = sheet()
    frames = np.stack([mesh.positions * np.float32(1.01)] * 3)
    with running(tmp_path, host_memory=3 * frames.nbytes) as engine:
        gate = threading.Event()
        for large in (True, False):
            engine.jobs.start("build", f"{large}", lambda job: gate.wait(60), small=not large)
        engine.memory.patience = 0.01
        upload = held(engine.memory, 3 * frames.nbytes, "uploads")
        engine.assets.create(replace(new_asset(mesh), frames=frames), hold=upload)
        assert engine.memory.used_for("jobs") == frames.nbytes
        assert upload.nbytes == 2 * frames.nbytes
        upload.release()
        gate.set()
        rest(engine)
        assert engine.memory.used == 0
