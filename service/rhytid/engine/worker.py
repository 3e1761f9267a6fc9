"""One thread owns the device; everybody else waits in a bounded queue."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, TypeVar

from rhytid.errors import BusyError

T = TypeVar("T")
_Task = tuple["Future[Any]", Callable[[], Any]]


class DeviceWorker:
    """Runs calls one after the other on a thread of its own.

    `size` is the number of calls that may wait.
    """

    def __init__(self, size: int) -> None:
        self._tasks: queue.Queue[_Task | None] = queue.Queue(size)
        self._closed = False
        self._thread = threading.Thread(target=self._work, name="rhytid-device", daemon=True)
        self._thread.start()

    @property
    def waiting(self) -> int:
        """Calls in the queue."""
        return self._tasks.qsize()

    def call(self, task: Callable[[], T]) -> T:
        """Run `task` on the device thread and return what it returns.

        Raises BusyError at once where the queue is full, and whatever the task raises.
        """
        return self._run(task, block=False)

    def call_patiently(self, task: Callable[[], T]) -> T:
        """As `call`, for long work: waits for a place in the queue."""
        return self._run(task, block=True)

    def close(self) -> None:
        """Let the calls in the queue finish, then end the thread."""
        if not self._closed:
            self._closed = True
            self._tasks.put(None)
            self._thread.join()

    def _run(self, task: Callable[[], T], *, block: bool) -> T:
        if self._closed:
            raise BusyError("the server is shutting down")
        future: Future[T] = Future()
        try:
            self._tasks.put((future, task), block=block)
        except queue.Full:
            raise BusyError(f"{self._tasks.maxsize} requests wait for the device already") from None
        return future.result()

    def _work(self) -> None:
        while (item := self._tasks.get()) is not None:
            _perform(*item)


def _perform(future: Future[T], task: Callable[[], T]) -> None:
    try:
        future.set_result(task())
    except BaseException as error:  # noqa: BLE001 handed to the caller, who waits for it
        future.set_exception(error)
