"""Runs one task of the device at a time. Others wait in bounded queues, where live connections and
other callers share the time, and assets take turns."""

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
from rhytid.domain.wording import waiting_requests
from rhytid.engine.call_context import is_live
from rhytid.errors import BusyError

T = TypeVar("T")
# Seconds in which a device that computes answers, or ends a task.
READY = 5.0
# The share of the device's time that live connections have while other calls wait, too.
LIVE_SHARE = 0.5
_Task = tuple["Future[Any]", Callable[[], Any]]


class _Lane:
    """Calls that wait, by turn.  share: of the device's time.  spent: seconds that its calls took,
    divided by its share."""

    def __init__(self, share: float) -> None:
        self.turns: OrderedDict[Hashable, deque[_Task]] = OrderedDict()
        self.waiting, self.spent, self._share = 0, 0.0, share

    def put(self, turn: Hashable, task: _Task) -> None:
        self.turns.setdefault(turn, deque()).append(task)
        self.waiting += 1

    def take(self) -> _Task:
        turn, tasks = self.turns.popitem(last=False)
        task = tasks.popleft()
        if tasks:
            self.turns[turn] = tasks  # at the end: the others come first
        self.waiting -= 1
        return task

    def took(self, seconds: float) -> None:
        self.spent += seconds / self._share

    def clear(self) -> list[_Task]:
        tasks = [task for turn in self.turns.values() for task in turn]
        self.turns.clear()
        self.waiting = 0
        return tasks


class DeviceWorker:
    """Runs calls one after the other: on the thread of the caller where nothing else runs or waits,
    which saves waking two threads, else on a thread of its own. A call must not call again.

    Each call belongs to a turn, such as the asset that it draws. Turns with calls in the queue are
    served in rotation, one call each; calls of one turn are served in the order in which they came.
    So a call waits for at most one call of every other turn, however many of those wait.

    Calls for live connections have turns of their own, and LIVE_SHARE of the time where other calls
    wait, too: the next call is of the kind that had less time since both wait. So one live call
    waits for the call at work alone, and the others have the rest of the time however many frames
    come.

    size: calls that may wait; of live connections as many again.  figures: counts how long calls
    wait and take.
    """

    def __init__(self, size: int, figures: Figures | None = None) -> None:
        self.size = size
        self._figures = figures or Figures()
        # By whether they are for live connections.
        self._lanes = {True: _Lane(LIVE_SHARE), False: _Lane(1.0 - LIVE_SHARE)}
        # Before all turns, and not counted among those that wait.
        self._first: deque[_Task] = deque()
        self._ended = 0
        self._clock = time.perf_counter
        self._runs = False
        self._closed = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._work, name="rhytid-device", daemon=True)
        self._thread.start()

    @property
    def waiting(self) -> int:
        """Calls in the queue."""
        return sum(lane.waiting for lane in self._lanes.values())

    @property
    def runs(self) -> bool:
        """Whether its thread is alive."""
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
        """Run a probe before all calls that wait, even if the queue is full, and return its result.

        Where the probe does not get its turn within `seconds`: whether any call ended meanwhile.
        Where it gets its turn and does not end within as long: False.

        Raises BusyError where the worker is closed, and the errors of the probe.
        """
        with self._changed:
            ended, future = self._ended, self._in_front(probe)
        if not wait([future], seconds).done and future.cancel():
            with self._changed:
                self._first = deque(one for one in self._first if one[0] is not future)
                return self._ended > ended
        # Where it has begun, it gets as long: the driver may never come back from it.
        return bool(wait([future], seconds).done) and future.result()

    def close(self) -> None:
        """Let the call at work finish, refuse those that wait, and end the thread."""
        with self._changed:
            self._closed = True
            refused = [task for lane in self._lanes.values() for task in lane.clear()]
            refused += self._first
            self._first.clear()
            self._changed.notify_all()
        for future, _ in refused:
            _refuse(future)
        self._thread.join()

    def _run(self, task: Callable[[], T], turn: Hashable, *, block: bool) -> T:
        timed = partial(self._figures.task, task, time.perf_counter_ns())
        lane = self._lanes[is_live()]
        with self._changed:
            alone = not (self._runs or self._waits() or self._closed or _interruptible())
            if alone:
                self._runs = True
            else:
                future = self._queued(lane, timed, turn, block)
        if alone:
            began = self._clock()
            try:
                return timed()
            finally:
                self._finished(lane, began)
        try:
            return future.result()
        finally:  # else its error's traceback and this frame hold each other
            del future

    def _queued(self, lane: _Lane, task: Callable[[], T], turn: Hashable, block: bool) -> Future[T]:
        """A call in the queue; a refused one, where the queue is closed."""
        while block and lane.waiting >= self.size and not self._closed:
            self._changed.wait()
        future: Future[T] = Future()
        if self._closed:
            _refuse(future)
        elif lane.waiting >= self.size:
            raise BusyError(f"{waiting_requests(self.size)} already")
        else:
            # In the context of the caller: `device.watch` reports for whom the device works.
            run = partial(copy_context().run, task)
            if not lane.turns:  # it has no claim to time in which it did not wait
                lane.spent = max(one.spent for one in self._lanes.values())
            lane.put(turn, (future, run))
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
        return bool(self._first) or any(lane.turns for lane in self._lanes.values())

    def _work(self) -> None:
        while (taken := self._take()) is not None:
            lane, item = taken
            began = self._clock()
            _perform(*item)
            del item, taken  # so that nobody holds the answer while this thread waits
            self._finished(lane, began)

    def _take(self) -> tuple[_Lane | None, _Task] | None:
        """The next call, and the lane whose time it takes; None once the worker is closed."""
        with self._changed:
            while self._runs or not (self._waits() or self._closed):
                self._changed.wait()
            if self._closed:
                return None
            self._runs = True
            if self._first:
                return None, self._first.popleft()
            lanes = [lane for lane in self._lanes.values() if lane.turns]
            lane = min(lanes, key=lambda lane: lane.spent)  # the live one where both had as much
            self._changed.notify_all()
            return lane, lane.take()

    def _finished(self, lane: _Lane | None, began: float) -> None:
        with self._changed:
            self._runs = False
            if lane is not None:
                lane.took(self._clock() - began)
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
    if future.set_running_or_notify_cancel():
        future.set_exception(BusyError("the server is shutting down"))
