"""One job: how far it is, how it is cancelled, and how it ends."""

from __future__ import annotations

import logging
import re
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from rhytid.device import watch
from rhytid.device.figures import working_on
from rhytid.engine import call_context
from rhytid.engine.call_context import caller
from rhytid.engine.messages import ENDED_STATES, JobInfo
from rhytid.errors import CancelledError, LimitError, RhytidError, public_message
from rhytid.support import cancellation

_log = logging.getLogger(__name__)


class GaveWay(Exception):
    """A job stopped for one of higher priority; its work will run again from the start."""


class Job:
    """One piece of long work, as the thread that does it sees it.

    waits: tells whether a job of higher priority waits.  seconds: that its work may take; None:
    any.  note: stands before the detail of each step.  caller: the caller that asked for it.
    reason: why it failed, for callers in this process; `info` has the part of it that others may
    know.
    """

    def __init__(
        self,
        info: JobInfo,
        waits: Callable[[Job], bool] = lambda job: False,
        seconds: float | None = None,
        note: str = "",
    ) -> None:
        self._info, self._waits, self._seconds = replace(info, detail=note), waits, seconds
        self._note = note
        self.caller = caller.get()
        self._began: float | None = None
        self._lock = threading.Lock()
        self._cancelled = threading.Event()
        self._ended = threading.Event()
        self._at_end: list[Callable[[], None]] = []
        self.resumes = False
        self.reason = ""

    @property
    def info(self) -> JobInfo:
        """How far the job is."""
        with self._lock:
            return self._info

    def progress(self, share: float, stage: str, detail: str = "") -> None:
        """Report how far the job is; raises what `check` does."""
        self.check()
        share = min(max(share, self.info.progress), 1.0)
        self.update(progress=share, stage=stage, detail=self._noted(detail))

    def tell(self, detail: str) -> None:
        """Say what the present step waits for, unless the job has ended. From any thread."""
        with self._lock:
            if self._info.state == "running":
                self._info = replace(self._info, detail=self._noted(detail))

    def _noted(self, detail: str) -> str:
        return "; ".join(filter(None, (self._note, detail)))

    def check(self) -> None:
        """Raise CancelledError where the job was cancelled, LimitError where its work takes longer
        than it may."""
        if self._cancelled.is_set():
            raise CancelledError(self._was_cancelled)
        if self._is_late():
            raise LimitError(
                f"the {self._info.kind} was ended: it took longer than {self._seconds:g} s, which "
                "is as long as this server allows (RHYTID_BUILD_SECONDS)"
            )

    def _is_late(self) -> bool:
        if self._seconds is None or self._began is None:
            return False
        return time.monotonic() - self._began > self._seconds

    def _stops(self) -> bool:
        return self._cancelled.is_set() or self._is_late()

    def give_way(self) -> None:
        """Raise GaveWay where a job of higher priority, of another asset, waits: this job is queued
        again, and its work is called once more. For work that skips the parts that it has done
        already."""
        if self._waits(self):
            raise GaveWay

    def cancel(self, *, resumes: bool = False) -> None:
        """Ask the job to stop at its next step.  resumes: its work will be done later."""
        if not self._cancelled.is_set():
            self.resumes = resumes
            self._cancelled.set()

    def end_cancelled(self) -> None:
        """End a job that was cancelled before its work began."""
        self.update(state="cancelled", detail=self._was_cancelled)

    @property
    def _was_cancelled(self) -> str:
        return f"job {self._info.id} was cancelled"

    def update(self, **changes: Any) -> None:
        """Replace parts of the info."""
        with self._lock:
            self._info = replace(self._info, **changes)
        if self.ended:
            self._ended.set()
            self._call_back()

    def fail(self, error: BaseException) -> None:
        """End the job as failed; the log has the parts of the error that callers may not read."""
        public = public_message(error)
        # Text alone: the error would keep the memory of the work from being freed.
        self.reason = str(error) if isinstance(error, RhytidError) else public
        if not isinstance(error, RhytidError):
            _log.error("job %s failed", self._info.id, exc_info=error)
        elif self.reason != public:
            _log.error("job %s failed: %s", self._info.id, self.reason)
        self.update(state="failed", detail=public)

    def when_ended(self, call: Callable[[], None]) -> None:
        """Have `call` called once the job has ended, at once where it has ended already. It must
        not block; its errors are logged."""
        with self._lock:
            self._at_end.append(call)
        if self.ended:
            self._call_back()

    def _call_back(self) -> None:
        with self._lock:
            calls, self._at_end = self._at_end, []
        for call in calls:
            try:
                call()
            except Exception:  # noqa: BLE001, PERF203 the thread goes on, and so do the others
                _log.exception("what follows the end of job %s failed", self.info.id)

    def wait(self, seconds: float | None = None) -> bool:
        """Wait for the end of the job, for `seconds` at most. Returns whether it has ended."""
        return self._ended.wait(seconds)

    @property
    def ended(self) -> bool:
        """Whether the job is done, failed or cancelled."""
        return self.info.state in ENDED_STATES

    def run(self, work: Callable[[Job], None]) -> bool:
        """Do the work of the job, and end it. Returns whether it gave way and is to be queued
        again."""
        self._began = time.monotonic()
        caller.set(self.caller)  # so that jobs that this one starts are the same caller's
        try:
            self.update(state="running")
            self.progress(0.0, "starting")
            purpose = watch.Purpose(asset=asset_number(self.info.asset))
            with watch.used_for(purpose), working_on("job"), self._stopping():
                work(self)
        except GaveWay:
            self.update(state="queued")
            return True
        except CancelledError as error:
            self.update(state="cancelled", detail=str(error))
        except BaseException as error:  # noqa: BLE001 the thread goes on with the next job
            self.fail(error)
        else:
            self.update(state="done", progress=1.0, stage="done", detail="")
        return False

    @contextmanager
    def _stopping(self) -> Iterator[None]:
        """Have everything that this thread does in the block ask whether the job goes on."""
        with cancellation.scope(self.check), call_context.abandoned_when(self._stops):
            yield


def asset_number(asset: str) -> int:
    """The number of an asset in `device.watch`: its id, 16 hexadecimal digits, as a number."""
    return int(asset, 16) if re.fullmatch("[0-9a-f]{16}", asset) else 0
