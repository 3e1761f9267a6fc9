"""A device that other threads use step by step, and launches that keep it for a short time each."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rhytid.device.paces import FIRST, LEAST, MOST, SECONDS, Paces
from rhytid.device.runtime import Device
from rhytid.engine.worker import DeviceWorker
from synthesis import sheets


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

    with device.from_elsewhere(lambda task, *a: call(step, task, *a)):
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
        with device.from_elsewhere(whole(device, worker)):
            kept = [device.upload(np.zeros(100, np.float32)), device.empty(100, np.float32)]
            kept.append(device.full(100, np.float32(1.0)))
            raise ValueError("half-way")

    with pytest.raises(ValueError, match="half-way"):
        fails()
    assert device.budget.used == before
    assert device.elsewhere is None


def test_a_check_that_fails_stops_the_block_and_leaves_nothing(
    device: Device, worker: DeviceWorker
) -> None:
    before, allowed = device.budget.used, [True, True, False]

    def check() -> None:
        if not allowed.pop(0):
            raise KeyError("gone")

    def fails() -> None:
        with device.from_elsewhere(whole(device, worker), check):
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

    with device.from_elsewhere(counted):
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


def test_paces_go_by_what_a_launch_took() -> None:
    paces = Paces()
    assert paces.items("p", "k") == FIRST
    paces.took("p", "k", FIRST, 10.0)  # it was compiled
    assert paces.items("p", "k") == LEAST
    for _ in range(4):
        paces.took("p", "k", paces.items("p", "k"), 1e-5)
    assert paces.items("p", "k") == MOST
    paces.took("p", "k", 64, 1e-5)  # the end of a run says nothing
    assert paces.items("p", "k") == MOST
    paces.took("p", "k", 64, 4 * SECONDS)  # unless even that is slow
    assert paces.items("p", "k") == LEAST
    assert paces.items("p", "other") == FIRST


@given(st.lists(st.tuples(st.integers(1, MOST), st.floats(0.0, 100.0)), max_size=20))
def test_launches_are_whole_groups_within_bounds(took: list[tuple[int, float]]) -> None:
    paces = Paces()
    for items, seconds in took:
        paces.took("p", "k", min(items, paces.items("p", "k")), seconds)
        assert LEAST <= paces.items("p", "k") <= MOST
        assert paces.items("p", "k") % 64 == 0


def test_how_work_is_cut_changes_no_bit(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    def made(items: int) -> list[bytes]:
        sizes: list[int] = []

        def fixed(paces: Paces, program: str, kernel: str) -> int:
            sizes.append(items)
            return items

        monkeypatch.setattr(Paces, "items", fixed)
        pores, edges = sheets.net(device, sheets.sheet(), 0.02)
        assert len(pores) > 1024
        return [a.tobytes() for a in (pores.position, pores.uv, edges.nodes, edges.length)]

    assert made(64) == made(256) == made(MOST)
