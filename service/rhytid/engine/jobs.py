"""Long work in the background: a bounded queue by priority; jobs report progress and can be
cancelled."""

from __future__ import annotations

import logging
import re
import secrets
import threading
from collections import Counter, OrderedDict
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from rhytid.device import watch
from rhytid.device.figures import JOB_KINDS, Figures, working_on
from rhytid.domain.wording import plural
from rhytid.engine.job_lanes import LANES, LARGE, TRANSFERS, Lane, Queued
from rhytid.engine.messages import ENDED_STATES, JobInfo
from rhytid.errors import BusyError, CancelledError, NotFoundError, RhytidError, public_message

# Kinds of jobs by priority, highest first.
KINDS = JOB_KINDS
# A new job of these kinds replaces those of the same asset that still wait.
_SUPERSEDED = ("calibration", "bins", "push")
_REMEMBERED = 1000
_log = logging.getLogger(__name__)


class GaveWay(Exception):
    """A job stopped for one of higher priority; its work runs again from the start."""


class Job:
    """One piece of long work, as seen by the thread that does it.

    waits: whether a job of higher priority waits.  reason: why it failed, for callers in this
    process; `info` has what others may know.
    """

    def __init__(self, info: JobInfo, waits: Callable[[Job], bool] = lambda job: False) -> None:
        self._info, self._waits = info, waits
        self._lock = threading.Lock()
        self._cancelled = threading.Event()
        self._ended = threading.Event()
        self._at_end: list[Callable[[], None]] = []
        self.resumes = False
        self.reason = ""

    @property
    def info(self) -> JobInfo:
        """How far it is."""
        with self._lock:
            return self._info

    def progress(self, share: float, stage: str, detail: str = "") -> None:
        """Report how far the job is; raises CancelledError if it was cancelled."""
        if self._cancelled.is_set():
            raise CancelledError(f"job {self._info.id} was cancelled")
        share = min(max(share, self.info.progress), 1.0)
        self.update(progress=share, stage=stage, detail=detail)

    def give_way(self) -> None:
        """Raise GaveWay if a job of higher priority, of another asset, waits: this one is queued
        again, and its work is called once more. For work that skips what it has done already."""
        if self._waits(self):
            raise GaveWay

    def cancel(self, *, resumes: bool = False) -> None:
        """Ask the job to stop at its next step.  resumes: its work will be done later."""
        if not self._cancelled.is_set():
            self.resumes = resumes
            self._cancelled.set()

    def update(self, **changes: Any) -> None:
        """Replace parts of the info."""
        with self._lock:
            self._info = replace(self._info, **changes)
        if self.ended:
            self._ended.set()
            self._call_back()

    def fail(self, error: BaseException) -> None:
        """End as failed; the log has what callers do not read."""
        public = public_message(error)
        # Text alone: the error would keep what the work held in memory.
        self.reason = str(error) if isinstance(error, RhytidError) else public
        if not isinstance(error, RhytidError):
            _log.error("job %s failed", self._info.id, exc_info=error)
        elif self.reason != public:
            _log.error("job %s failed: %s", self._info.id, self.reason)
        self.update(state="failed", detail=public)

    def when_ended(self, call: Callable[[], None]) -> None:
        """Have `call` called once the job has ended, at once where it has; it must not block."""
        with self._lock:
            self._at_end.append(call)
        if self.ended:
            self._call_back()

    def _call_back(self) -> None:
        with self._lock:
            calls, self._at_end = self._at_end, []
        for call in calls:
            call()

    def wait(self, seconds: float | None = None) -> bool:
        """Whether the job has ended, at the latest after so many seconds."""
        return self._ended.wait(seconds)

    @property
    def ended(self) -> bool:
        """Whether the job is done, failed or cancelled."""
        return self.info.state in ENDED_STATES


class Jobs:
    """Runs jobs by the priority of their kind, then in the order in which they came.

    Two threads take jobs from the queue, one of them small jobs only, so that these never wait for
    a large job of another asset. Jobs of one asset run one after the other. Two more threads take
    what waits for a shared store, one of them fetches only; these run beside other jobs of their
    asset. A job that gives way is queued again, behind those of higher priority.  most: jobs that
    may wait.  figures: counts them.
    """

    def __init__(self, most: int, figures: Figures | None = None) -> None:
        self._most = most
        self._figures = figures or Figures()
        self._jobs: OrderedDict[str, Job] = OrderedDict()
        self._queue: list[Queued] = []
        # What is at work, and where.
        self._at_work: dict[tuple[str, bool], Lane] = {}
        self._running: Counter[str] = Counter()
        self._closed = False
        self._changed = threading.Condition()
        self._threads = [
            threading.Thread(target=self._run_all, args=(lane,), name=lane.name, daemon=True)
            for lane in LANES
        ]
        for thread in self._threads:
            thread.start()

    def start(
        self,
        kind: str,
        asset: str,
        work: Callable[[Job], None],
        *,
        small: bool = False,
        always: bool = False,
    ) -> Job:
        """Queue `work`; it reports through the job that it is given.

        A calibration, or bins, that still wait for the same asset are cancelled: this comes in
        their place. Raises BusyError where too many jobs wait, unless `always`.
        """
        job = Job(
            JobInfo(secrets.token_hex(8), asset, kind, "queued", 0.0, "queued", ""), self._waits
        )
        with self._changed:
            if kind in _SUPERSEDED:
                self._supersede(kind, asset)
            if self._beside(kind) >= self._most and not always:
                raise BusyError(
                    f"{plural(self._most, 'job waits', 'jobs wait')} already (RHYTID_JOBS)"
                )
            job.when_ended(partial(self._count_end, job))
            self._jobs[job.info.id] = job
            self._put(Queued(job, work, small))
            self._forget()
            self._note()
            self._changed.notify_all()
        return job

    def get(self, id: str) -> Job:
        """The job of that id; raises NotFoundError."""
        with self._changed:
            if id not in self._jobs:
                raise NotFoundError(f"no job {id!r}")
            return self._jobs[id]

    def info(self, id: str) -> JobInfo:
        """How far a job is; raises NotFoundError."""
        return self.get(id).info

    def cancel(self, id: str) -> JobInfo:
        """Ask a job to stop at its next step; raises NotFoundError."""
        job = self.get(id)
        job.cancel()
        return job.info

    def cancel_all(self, asset: str, *, resumes: bool = False) -> None:
        """Ask every job of an asset to stop."""
        self._cancel(self.of(asset), resumes)

    def of(self, asset: str) -> list[Job]:
        """The jobs of an asset that are known."""
        return [job for job in self._known() if job.info.asset == asset]

    def close(self) -> None:
        """Cancel what is left and wait for its end."""
        self._cancel(self._known(), resumes=True)
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        for thread in self._threads:
            thread.join()

    def _cancel(self, jobs: list[Job], resumes: bool) -> None:
        for job in jobs:
            job.cancel(resumes=resumes)

    def _known(self) -> list[Job]:
        with self._changed:
            return list(self._jobs.values())

    def _supersede(self, kind: str, asset: str) -> None:
        old = [q for q in self._queue if (q.job.info.kind, q.asset) == (kind, asset)]
        for queued in old:
            self._queue.remove(queued)
            queued.job.update(state="cancelled", detail="a newer job does the same")

    def _beside(self, kind: str) -> int:
        """How many jobs wait that count with those of a kind: a shared store that is away must not
        keep others out."""
        if kind in TRANSFERS:
            return sum(queued.kind == kind for queued in self._queue)
        return sum(not queued.transfers for queued in self._queue)

    def _put(self, queued: Queued) -> None:
        self._queue.append(queued)
        self._queue.sort(key=lambda queued: _rank(queued.job))

    def _waits(self, job: Job) -> bool:
        """Whether a job waits that the thread of this one would do first."""
        with self._changed:
            lane = self._at_work.get((job.info.asset, False), LARGE)
            return any(
                _rank(queued.job) < _rank(job) and self._may(queued, lane) for queued in self._queue
            )

    def _may(self, queued: Queued, lane: Lane) -> bool:
        """Whether the thread of a lane may do a job now."""
        return queued.turn not in self._at_work and lane.takes(queued)

    def _forget(self) -> None:
        ended = [id for id, job in self._jobs.items() if job.ended]
        for id in ended[: max(len(self._jobs) - _REMEMBERED, 0)]:
            del self._jobs[id]

    def _note(self) -> None:
        """Tell how many jobs of each kind wait and run."""
        queued = Counter(one.job.info.kind for one in self._queue)
        for kind in KINDS:
            self._figures.set(queued[kind], "jobs", kind, "queued")
            self._figures.set(self._running[kind], "jobs", kind, "running")

    def _count_end(self, job: Job) -> None:
        self._figures.count("ended", job.info.kind, job.info.state)

    def _run_all(self, lane: Lane) -> None:
        while (queued := self._take(lane)) is not None:
            again = False
            try:
                again = _run(queued)
            finally:
                with self._changed:
                    del self._at_work[queued.turn]
                    if again:
                        self._put(queued)
                    self._running[queued.job.info.kind] -= 1
                    self._note()
                    self._changed.notify_all()
            del queued  # lets go of the work's data while this thread waits

    def _take(self, lane: Lane) -> Queued | None:
        """The next job of this thread; None once the queue is closed and has none for it."""
        with self._changed:
            while True:
                queued = next((q for q in self._queue if self._may(q, lane)), None)
                if queued is not None:
                    self._queue.remove(queued)
                    self._at_work[queued.turn] = lane
                    self._running[queued.job.info.kind] += 1
                    self._note()
                    return queued
                if self._closed and not any(map(lane.takes, self._queue)):
                    return None
                self._changed.wait()


def _rank(job: Job) -> int:
    return KINDS.index(job.info.kind)


def asset_number(asset: str) -> int:
    """What `device.watch` calls an asset: its id, 16 hexadecimal digits, as a number."""
    return int(asset, 16) if re.fullmatch("[0-9a-f]{16}", asset) else 0


def _run(queued: Queued) -> bool:
    """Do the work of a job; whether it is to be queued again."""
    job = queued.job
    try:
        job.update(state="running")
        job.progress(0.0, "starting")
        purpose = watch.Purpose(asset=asset_number(queued.asset))
        with watch.used_for(purpose), working_on("job"):
            queued.work(job)
    except GaveWay:
        job.update(state="queued")
        return True
    except CancelledError as error:
        job.update(state="cancelled", detail=str(error))
    except BaseException as error:  # noqa: BLE001 the thread goes on with the next job
        job.fail(error)
    else:
        job.update(state="done", progress=1.0, stage="done", detail="")
    return False
