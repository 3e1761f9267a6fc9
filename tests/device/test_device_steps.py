"""A device that other threads use in steps."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from rhytid.device.buffer import Buffer, BufferGroup
from rhytid.device.runtime import Device, OnFirstUse
from rhytid.engine.worker import DeviceWorker


class Pair(BufferGroup):
    """Two buffers."""

    def __init__(self, device: Device) -> None:
        self.one, self.two = (device.empty(4, np.float32) for _ in range(2))

    @property
    def _buffers(self) -> tuple[Buffer, ...]:
        return (self.one, self.two)


@pytest.fixture
def worker() -> Iterator[DeviceWorker]:
    worker = DeviceWorker(16)
    yield worker
    worker.close()


def whole(device: Device, worker: DeviceWorker) -> Any:
    """Runs a call as one task on the thread of the device."""

    def call(task: Any, *arguments: Any) -> Any:
        def run() -> Any:
            with device.task():
                return task(*arguments)

        return worker.call_patiently(run)

    return call


def test_others_get_the_device_between_two_steps(device: Device, worker: DeviceWorker) -> None:
    threads: list[str] = []
    call, came = whole(device, worker), threading.Event()

    def step(task: Any, *arguments: Any) -> Any:
        threads.append(threading.current_thread().name)
        return task(*arguments)

    def other() -> None:
        worker.call(lambda: threads.append("other"))
        came.set()

    with device.in_steps(lambda task, *a: call(step, task, *a)):
        one = device.upload(np.arange(4, dtype=np.float32))
        waiting = threading.Thread(target=other)
        waiting.start()
        assert came.wait(60)  # while the block still is at work
        found = device.read(one, (4,), np.float32)
        one.release()
    waiting.join()
    assert found.tolist() == [0, 1, 2, 3]
    assert len(threads) > 2
    assert threads.index("other") == 1


def test_a_block_that_fails_gives_back_what_it_made(device: Device, worker: DeviceWorker) -> None:
    before = device.budget.used

    def fails() -> None:
        with device.in_steps(whole(device, worker)):
            kept = [device.upload(np.zeros(100, np.float32)), device.empty(100, np.float32)]
            kept.append(device.full(100, np.float32(1.0)))
            kept.append(device.step(lambda: device.empty(100, np.float32)))
            raise ValueError("half-way")

    with pytest.raises(ValueError, match="half-way"):
        fails()
    assert device.budget.used == before
    assert device.steps is None


def test_a_check_that_fails_stops_the_block_and_leaves_nothing(
    device: Device, worker: DeviceWorker
) -> None:
    before, allowed = device.budget.used, [True, True, False]

    def check() -> None:
        if not allowed.pop(0):
            raise KeyError("gone")

    def fails() -> None:
        with device.in_steps(whole(device, worker), check):
            for _ in range(3):
                device.empty(100, np.float32)

    with pytest.raises(KeyError, match="gone"):
        fails()
    assert device.budget.used == before


def test_launches_run_with_the_step_after_them_in_order(
    device: Device, worker: DeviceWorker
) -> None:
    steps: list[int] = []
    call = whole(device, worker)

    def counted(task: Any, *arguments: Any) -> Any:
        steps.append(1)
        return call(task, *arguments)

    with device.in_steps(counted):
        degree = device.full(4, np.int32(0))
        members = device.upload(np.array([[0, 1], [1, 2], [1, 3]], np.int32))
        before = len(steps)
        head = (np.int32(0), np.int32(6))
        for _ in range(3):
            device.launch("incidence", "count_pairs", (64,), *head, members, degree, group=(64,))
        assert len(steps) == before
        found = device.read(degree, (4,), np.int32)
        assert len(steps) == before + 1
        members.release()
        degree.release()
    assert found.tolist() == [3, 9, 3, 3]


def test_a_part_made_at_first_use_outlives_the_task_that_failed_after_it(device: Device) -> None:
    part = OnFirstUse(device, lambda: device.upload(np.arange(4, dtype=np.float32)))
    lost = []

    def fails() -> None:
        with device.task():
            lost.extend([part.get(), device.empty(4, np.float32)])
            raise ValueError("later")

    with pytest.raises(ValueError, match="later"):
        fails()
    assert lost[1].released
    assert not part.get().released
    assert device.read(part.get(), (4,), np.float32).tolist() == [0, 1, 2, 3]
    part.release()
    assert part.get().released


def test_a_part_whose_making_fails_is_given_back_and_made_again(device: Device) -> None:
    before, parts = device.budget.used, [device.upload(np.zeros(100, np.float32))]

    def make() -> Buffer:
        made = device.empty(100, np.float32)
        if parts:
            parts.pop().release()
            raise ValueError("half-way")
        return made

    part = OnFirstUse(device, make)
    with pytest.raises(ValueError, match="half-way"), device.task():
        part.get()
    assert device.budget.used == before
    assert not part.get().released
    part.release()


def failed_block(device: Device, worker: DeviceWorker, work: Callable[[], None]) -> None:
    """Do work in a block of steps that then fails."""

    def failing() -> None:
        with device.in_steps(whole(device, worker)):
            work()
            raise RuntimeError

    with pytest.raises(RuntimeError):
        failing()


def test_what_a_step_finds_stays_where_the_block_fails_and_what_it_makes_does_not(
    device: Device, worker: DeviceWorker
) -> None:
    """A group of buffers that a step returns may be kept by others: one that is made says so."""
    kept, made = Pair(device), []

    def work() -> None:
        assert device.step(lambda: kept) is kept
        made.append(device.make_in_step(lambda: Pair(device)))

    failed_block(device, worker, work)
    assert not kept.one.released
    assert made[0].one.released
    kept.release()


def test_a_group_that_was_handed_over_stays(device: Device, worker: DeviceWorker) -> None:
    made = []

    def work() -> None:
        made.append(device.make_in_step(lambda: Pair(device)))
        device.hand_over()

    failed_block(device, worker, work)
    assert not made[0].one.released
    made[0].release()
