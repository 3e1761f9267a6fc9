"""The threads that write the files of a bake, and the bytes that its maps take until then."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from pathlib import Path

from rhytid.engine.byte_budget import ByteBudget, Hold
from rhytid.errors import CancelledError
from rhytid.support.cores import core_count

# Frames that are drawn before the first of them is written, at least.
_AHEAD = 3


class FileWriters:
    """Threads that write files, and the bytes that wait for them.

    limit: of the bytes.  ahead: frames that are drawn before the first of them is written, at most.
    under_way: files that are being written by their keys, and the writing of each. Work that writes
    several files asks `check` before each.
    """

    def __init__(self, limit: int) -> None:
        self._budget = ByteBudget(limit, "RHYTID_HOST_MEMORY_MB", math.inf)
        self.ahead = max(_AHEAD, core_count() + 1)
        self._pool = ThreadPoolExecutor(self.ahead, "rhytid-writer")
        self.under_way: dict[str, tuple[Path, Future[int]]] = {}
        self._stopping = threading.Event()
        # What is neither written nor cancelled.
        self._left: set[Future[int]] = set()

    def __enter__(self) -> FileWriters:
        return self

    def __exit__(self, kind: type[BaseException] | None, *raised: object) -> None:
        """Wait until everything is written; after an error, until the files that were begun are. A
        signal that comes meanwhile is such an error: else its folder may be removed under a
        writer."""
        try:
            if kind is None:
                self._end()
        except BaseException:
            self._stop()
            raise
        if kind is not None:
            self._stop()

    def _stop(self) -> None:
        self._stopping.set()
        # A copy waits for a file that was queued before it, so that is never cancelled under it.
        self._pool.shutdown(wait=False, cancel_futures=True)
        self._end()

    def _end(self) -> None:
        # Not by threads alone: Python takes one whose `join` a signal has interrupted for ended
        # (bpo-45274), and would not wait for it again.
        wait({*self._left})
        self._pool.shutdown()

    def check(self) -> None:
        """Raise CancelledError where no more files are to be begun."""
        if self._stopping.is_set():
            raise CancelledError("the bake has ended")

    def note(self, files: Mapping[str, Path], writing: Future[int]) -> None:
        """Have files, by their keys, in `under_way` until they are written."""
        self.under_way.update((key, (file, writing)) for key, file in files.items())

        def forget(done: Future[int]) -> None:
            for key, file in files.items():
                if self.under_way.get(key) == (file, done):
                    del self.under_way[key]

        writing.add_done_callback(forget)

    def hold(self, nbytes: int) -> Hold:
        """Wait until so many bytes are free, or all, and hold them."""
        held = self._budget.hold("maps")
        held.grow(min(nbytes, self._budget.limit))
        return held

    def submit(self, write: Callable[[], int]) -> Future[int]:
        """Have files written."""
        writing = self._pool.submit(write)
        self._left.add(writing)
        writing.add_done_callback(self._left.discard)
        return writing


def release_after(held: Hold, writing: Sequence[Future[int]]) -> None:
    """Release bytes when the last of some files is written."""
    left, lock = set(writing), threading.Lock()

    def forget(done: Future[int]) -> None:
        with lock:
            left.discard(done)
            if not left:
                held.release()

    for future in writing:
        future.add_done_callback(forget)


def all_written(writing: Sequence[Future[int]]) -> bool:
    """Whether files have been written."""
    return all(future.done() for future in writing)
