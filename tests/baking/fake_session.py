"""A session that draws nothing: what runs on a cluster are tested over."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, cast

from rhytid.baking.farm.chunks import Chunk
from rhytid.errors import FrameError, InputError, NoDeviceError, StorageError

if TYPE_CHECKING:
    from rhytid.baking.farm.bake_session import WorkerJob


@dataclass(frozen=True)
class FakeJob:
    """What is to happen, by the numbers of frames.

    log: a folder, in which each frame that is begun adds a file.  deaths: how often the process is
    killed at a frame, once what it told before is sent.  bad: of frames that cannot be read.
    stale: of frames at which the disk fails once.  missing: whether a session cannot be made.
    apart: whether the process that begins first has no device.
    full: of frames at which memory is short once.
    """

    log: Path
    deaths: tuple[tuple[int, int], ...] = ()
    bad: tuple[int, ...] = ()
    stale: tuple[int, ...] = ()
    missing: bool = False
    apart: bool = False
    full: tuple[int, ...] = ()

    def session(self, folder: Path) -> FakeSession:
        """As that of a WorkerJob."""
        return FakeSession(self, folder)

    def begin(self, number: int) -> int:
        """Note that a frame is begun; returns how often it was before."""
        before = len(self.begun(number))
        (self.log / f"{number}-{before}-{os.getpid()}").touch()
        return before

    def begun(self, number: int) -> list[str]:
        """The processes that began a frame."""
        return [file.name.split("-")[2] for file in self.log.glob(f"{number}-*")]


def fake(job: FakeJob) -> WorkerJob:
    """The job, for what takes those of bakes."""
    return cast("WorkerJob", job)


class FakeSession:
    """Sessions that follow a FakeJob."""

    def __init__(self, job: FakeJob, folder: Path) -> None:
        if job.missing:
            raise InputError("no such file: /nowhere/face.obj")
        if job.apart:
            (job.log / f"tried-{os.getpid()}").touch(exist_ok=False)
            with suppress(FileExistsError):
                (job.log / "first").touch(exist_ok=False)
                raise NoDeviceError("no OpenCL device matches 'gpu'")
        self._job = job
        (job.log / f"made-{os.getpid()}-{folder.name}").touch()

    def bake(self, chunk: Chunk, done: Callable[[str], None]) -> int:
        for number in chunk.numbers:
            before = self._job.begin(number)
            if before < dict(self._job.deaths).get(number, 0):
                time.sleep(0.5)
                os.kill(os.getpid(), signal.SIGKILL)
            if number in self._job.bad:
                raise FrameError(f"frame {number} has 3 vertices")
            if number in self._job.stale and not before:
                raise StorageError("the disk failed")
            if number in self._job.full and not before:
                raise MemoryError
            done(f"{number:04d}", True)
        return len(chunk.numbers)

    def close(self) -> None:
        (self._job.log / f"closed-{os.getpid()}").touch()
