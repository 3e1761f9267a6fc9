"""One task uses the device at a time; others wait in a bounded queue, where assets take turns."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict, deque
from collections.abc import Callable, Hashable
from concurrent.futures import Future, wait
from contextvars import copy_context
from functools import partial
from typing import Any, TypeVar

from rhytid.device.figures import Figures
from rhytid.domain.wording import waiting
from rhytid.errors import BusyError

T = TypeVar("T")
# Seconds in which a device that computes answers, or ends a task.
READY = 5.0
_Task = tuple["Future[Any]", Callable[[], Any]]


class DeviceWorker:
    """Runs calls one after the other: on the thread of the caller where nothing else runs or waits,
    which saves waking two threads, else on a thread of its own. A call must not call again.

    Each call belongs to a turn, such as the asset that it draws. Turns with calls in the queue are
    served in rotation, one call each; calls of one turn are served in the order in which they came.
    So a call waits for at most one call of every other turn, however many of those wait.

    `size` is the number of calls that may wait.  figures: how long calls wait and take.
    """

    def __init__(self, size: int, figures: Figures | None = None) -> None:
        self.size = size
        self._figures = figures or Figures()
        self._turns: OrderedDict[Hashable, deque[_Task]] = OrderedDict()
        # Before all turns, and not counted among those that wait.
        self._first: deque[_Task] = deque()
        self._waiting = self._ended = 0
        self._runs = False
        self._closed = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._work, name="rhytid-device", daemon=True)
        self._thread.start()

    @property
    def waiting(self) -> int:
        """Calls in the queue."""
        return self._waiting

    @property
    def runs(self) -> bool:
        """Whether its thread is there."""
        return self._thread.is_alive()

    def call(self, task: Callable[[], T], turn: Hashable = None) -> T:
        """Run `task` alone and return what it returns.

        Raises BusyError at once where the queue is full, and whatever the task raises.
        """
        return self._run(task, turn, block=False)

    def call_patiently(self, task: Callable[[], T], turn: Hashable = None) -> T:
        """As `call`, for long work: waits for a place in the queue."""
        return self._run(task, turn, block=True)

    def answers(self, probe: Callable[[], bool], seconds: float) -> bool:
        """What a probe returns that goes before whatever waits, also where the queue is full; where
        it does not get its turn in time, whether any call ended meanwhile.

        Raises BusyError where the worker is closed, and what the probe raises.
        """
        with self._changed:
            ended, future = self._ended, self._in_front(probe)
        if wait([future], seconds).done or not future.cancel():
            return future.result()
        return self._ended > ended

    def close(self) -> None:
        """Let the call at work finish, refuse those that wait, and end the thread."""
        with self._changed:
            self._closed = True
            refused = [item for tasks in self._turns.values() for item in tasks]
            refused += self._first
            self._turns.clear()
            self._first.clear()
            self._waiting = 0
            self._changed.notify_all()
        for future, _ in refused:
            _refuse(future)
        self._thread.join()

    def _run(self, task: Callable[[], T], turn: Hashable, *, block: bool) -> T:
        timed = partial(self._figures.task, task, time.perf_counter_ns())
        with self._changed:
            alone = not (self._runs or self._waits() or self._closed or _interruptible())
            if alone:
                self._runs = True
            else:
                future = self._queued(timed, turn, block)
        if alone:
            try:
                return timed()
            finally:
                self._finished()
        try:
            return future.result()
        finally:  # else its error's traceback and this frame hold each other
            del future

    def _queued(self, task: Callable[[], T], turn: Hashable, block: bool) -> Future[T]:
        """A call in the queue; a refused one, where the queue is closed."""
        while block and self._waiting >= self.size and not self._closed:
            self._changed.wait()
        future: Future[T] = Future()
        if self._closed:
            _refuse(future)
        elif self._waiting >= self.size:
            raise BusyError(f"{waiting(self.size)} already")
        else:
            # In the context of the caller: `device.watch` reports for whom the device works.
            run = partial(copy_context().run, task)
            self._turns.setdefault(turn, deque()).append((future, run))
            self._waiting += 1
            self._changed.notify_all()
        return future

    def _in_front(self, probe: Callable[[], bool]) -> Future[bool]:
        future: Future[bool] = Future()
        if self._closed:
            _refuse(future)
        else:
            self._first.append((future, partial(copy_context().run, probe)))
            self._changed.notify_all()
        return future

    def _waits(self) -> bool:
        return bool(self._turns or self._first)

    def _work(self) -> None:
        while (item := self._take()) is not None:
            _perform(*item)
            del item  # while the thread waits, nobody holds what the task answered
            self._finished()

    def _take(self) -> _Task | None:
        """The next call; None once the queue is closed."""
        with self._changed:
            while self._runs or not (self._waits() or self._closed):
                self._changed.wait()
            if self._closed:
                return None
            if self._first:
                self._runs = True
                return self._first.popleft()
            turn, tasks = self._turns.popitem(last=False)
            item = tasks.popleft()
            if tasks:
                self._turns[turn] = tasks  # at the end: the others come first
            self._waiting -= 1
            self._runs = True
            self._changed.notify_all()
            return item

    def _finished(self) -> None:
        with self._changed:
            self._runs = False
            self._ended += 1
            if self._waits() or self._closed:
                self._changed.notify_all()


def _interruptible() -> bool:
    """Whether an interrupt may stop this thread at any instruction, within a task too."""
    return threading.current_thread() is threading.main_thread()


def _perform(future: Future[T], task: Callable[[], T]) -> None:
    if not future.set_running_or_notify_cancel():
        return
    try:
        future.set_result(task())
    except BaseException as error:  # noqa: BLE001 handed to the caller, who waits for it
        future.set_exception(error)
    finally:  # as above
        del future


def _refuse(future: Future[Any]) -> None:
    future.set_exception(BusyError("the server is shutting down"))
