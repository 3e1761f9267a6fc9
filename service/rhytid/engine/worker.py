"""One thread owns the device; calls from other threads wait in a bounded queue."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, TypeVar

from rhytid.domain.wording import waiting
from rhytid.errors import BusyError

T = TypeVar("T")
_Task = tuple["Future[Any]", Callable[[], Any]]


class DeviceWorker:
    """Runs calls one after the other on a thread of its own.

    `size` is the number of calls that may wait.
    """

    def __init__(self, size: int) -> None:
        self._tasks: queue.Queue[_Task | None] = queue.Queue(size)
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._work, name="rhytid-device", daemon=True)
        self._thread.start()

    @property
    def size(self) -> int:
        """Calls that may wait."""
        return self._tasks.maxsize

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
        """Finish the running call, refuse those that wait, and end the thread."""
        if not self._closed.is_set():
            self._closed.set()
            self._tasks.put(None)
            self._thread.join()
            self._refuse_waiting()

    def _run(self, task: Callable[[], T], *, block: bool) -> T:
        future: Future[T] = Future()
        try:
            self._tasks.put((future, task), block=block)
        except queue.Full:
            raise BusyError(f"{waiting(self.size)} already") from None
        # Also after the put: once the thread has ended, the queue is not read any more.
        if self._closed.is_set() and not self._thread.is_alive():
            self._refuse_waiting()
        return future.result()

    def _work(self) -> None:
        while (item := self._tasks.get()) is not None:
            if self._closed.is_set():
                _refuse(item[0])
            else:
                _perform(*item)
            del item  # lets go of the result while the thread waits

    def _refuse_waiting(self) -> None:
        while True:
            try:
                item = self._tasks.get_nowait()
            except queue.Empty:
                return
            if item is not None:
                _refuse(item[0])


def _perform(future: Future[T], task: Callable[[], T]) -> None:
    try:
        future.set_result(task())
    except BaseException as error:  # noqa: BLE001 handed to the caller, who waits for it
        future.set_exception(error)


def _refuse(future: Future[Any]) -> None:
    future.set_exception(BusyError("the server is shutting down"))
