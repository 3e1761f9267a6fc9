"""The session of a worker, without a cluster."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, cast

import pytest

from baking.fake_session import FakeJob, fake
from rhytid.baking.farm.bake_session import packed
from rhytid.baking.farm.chunks import Chunk
from rhytid.baking.farm.dask_worker import IDLE, HeldSession
from rhytid.errors import CancelledError, StorageError

Bake = Callable[[Chunk], Any]


class FakeWorker:
    """What a session uses of its worker."""

    address = "tcp://farm:1"

    def __init__(self, folder: Path) -> None:
        self.local_directory = str(folder)
        self.events: list[dict[str, str]] = []

    def log_event(self, topic: str, event: dict[str, str]) -> None:
        self.events.append(event)


def begun(folder: Path, job: FakeJob, idle: float = IDLE) -> tuple[Bake, HeldSession, FakeWorker]:
    """What bakes a chunk, the session that it uses, and its worker."""
    worker = FakeWorker(folder)
    held = HeldSession("run", cast("Any", worker), idle)
    return partial(held.bake, packed(fake(job))), held, worker


def closed(folder: Path) -> bool:
    return any(folder.glob("closed-*"))


def timers() -> set[threading.Thread]:
    return {thread for thread in threading.enumerate() if isinstance(thread, threading.Timer)}


def test_a_session_closes_where_no_chunk_comes(tmp_path: Path) -> None:
    bake, _, worker = begun(tmp_path, FakeJob(tmp_path), 0.05)

    assert bake(Chunk((1, 2), "1-2")) == 2
    told = {"chunk": "1-2", "worked": True}
    assert worker.events == [{**told, "frame": f"000{n}"} for n in (1, 2)]
    by = time.monotonic() + 5
    while not closed(tmp_path) and time.monotonic() < by:
        time.sleep(0.01)
    assert closed(tmp_path)
    assert bake(Chunk((3,), "3")) == 1, "and another is made"


def test_one_thread_waits_however_many_chunks_there_were(tmp_path: Path) -> None:
    bake, held, _ = begun(tmp_path, FakeJob(tmp_path))
    before = timers()

    for number in range(1, 31):
        bake(Chunk((number,), f"{number}"))
    by = time.monotonic() + 5
    while len(timers() - before) > 1 and time.monotonic() < by:
        time.sleep(0.01)

    assert len(timers() - before) == 1
    held.close()


def test_a_session_that_failed_is_made_anew(tmp_path: Path) -> None:
    bake, _, _ = begun(tmp_path, FakeJob(tmp_path, stale=(1,)))

    with pytest.raises(StorageError, match=r"^worker tcp://farm:1: the disk failed$"):
        bake(Chunk((1,), "1"))
    assert closed(tmp_path)
    assert bake(Chunk((1,), "1")) == 1


def test_a_run_that_has_ended_bakes_no_more(tmp_path: Path) -> None:
    bake, held, _ = begun(tmp_path, FakeJob(tmp_path))
    assert bake(Chunk((1,), "1")) == 1
    held.stop()
    held.close()

    assert closed(tmp_path)
    with pytest.raises(CancelledError):
        bake(Chunk((2,), "2"))
