"""Long work in the background: a bounded queue by priority, and the threads that take jobs."""

from __future__ import annotations

import itertools
import secrets
import threading
from collections import Counter, OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from typing_extensions import override

from rhytid.device.figures import JOB_KINDS, Figures
from rhytid.domain.wording import plural
from rhytid.engine import operations
from rhytid.engine.job import Job
from rhytid.engine.messages import STARTED_AGAIN, JobInfo
from rhytid.errors import BusyError, NotFoundError

# Kinds that wait for a shared store, and keep neither the device nor other jobs of their asset.
TRANSFERS = ("fetch", "push")
# A new job of these kinds replaces those of the same asset that still wait.
_SUPERSEDED = ("calibration", "bins", "push")
_REMEMBERED = 1000


@dataclass(frozen=True, eq=False)
class Queued:
    """A job that waits, and its work.  small: whether the work is short."""

    job: Job
    work: Callable[[Job], None]
    small: bool

    @property
    def asset(self) -> str:
        """The id of its asset."""
        return self.job.info.asset

    @property
    def kind(self) -> str:
        """Its kind, one of `JOB_KINDS`."""
        return self.job.info.kind

    @property
    def transfers(self) -> bool:
        """Whether it transfers an asset from or to a shared store."""
        return self.kind in TRANSFERS

    @property
    def caller(self) -> str:
        """The caller that asked for it."""
        return self.job.caller

    @property
    def turn(self) -> tuple[str, bool]:
        """Its turn: jobs of the same turn run one after the other."""
        return self.asset, self.transfers


@dataclass(frozen=True, eq=False)
class Lane:
    """A thread, and the jobs that it takes.  transfers: whether they wait for a shared store.
    spare: whether it works only while one caller has all other lanes that do not transfer, and for
    other callers."""

    name: str
    takes: Callable[[Queued], bool]
    spare: bool = False
    transfers: bool = False


LARGE = Lane("rhytid-jobs", lambda queued: not queued.transfers)
LANES = (
    LARGE,
    Lane("rhytid-small-jobs", lambda queued: queued.small and not queued.transfers),
    Lane("rhytid-spare-jobs", lambda queued: not queued.transfers, spare=True),
    Lane("rhytid-transfers", lambda queued: queued.transfers, transfers=True),
    Lane("rhytid-fetches", lambda queued: queued.kind == "fetch", transfers=True),
)
# How many threads take jobs that do not transfer, without the spare one.
_USUAL = len(LANES) - len([lane for lane in LANES if lane.spare or lane.transfers])


class Jobs(operations.Jobs):
    """Runs jobs by the priority of their kind. Of one kind, jobs of callers with fewer jobs at work
    come first, then those of callers that were served longest ago, then those that were queued
    first.

    Two threads take jobs from the queue, one of them small jobs only, so that these never wait for
    a large job of another asset. While both work for one caller, a third thread works for others.
    Jobs of one asset run one after the other. Two more threads take transfers of a shared store,
    one of them fetches only; these run beside other jobs of their asset. A job that gives way is
    queued again, behind those of higher priority.

    most: jobs that may wait.  figures: counts them.  build_seconds: that a build may take; None:
    any.
    """

    def __init__(
        self, most: int, figures: Figures | None = None, build_seconds: float | None = None
    ) -> None:
        self._most, self._build_seconds = most, build_seconds
        self._figures = figures or Figures()
        self._jobs: OrderedDict[str, Job] = OrderedDict()
        self._queue: list[Queued] = []
        # The jobs at work by turn, and the lanes that do them.
        self._at_work: dict[tuple[str, bool], tuple[Lane, Queued]] = {}
        # When callers were last given a thread, as a number that grows.
        self._served: dict[str, int] = {}
        self._turns = itertools.count(1)
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
        again: str = "",
    ) -> Job:
        """Queue `work`, which reports through the job that it is given.  again: the id of a job of
        a process that has ended, whose work this is; the new job has it, too, and says so.

        A calibration, bins or a push that still waits for the same asset is cancelled: the new job
        takes its place. Raises BusyError where too many jobs wait, unless `always`.
        """
        seconds = self._build_seconds if kind == "build" else None
        info = JobInfo(again or secrets.token_hex(8), asset, kind, "queued", 0.0, "queued", "")
        job = Job(info, self._waits, seconds, STARTED_AGAIN if again else "")
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
        """A job by its id; raises NotFoundError."""
        with self._changed:
            if id not in self._jobs:
                raise NotFoundError(f"no job {id!r}")
            return self._jobs[id]

    @override
    def info(self, id: str) -> JobInfo:
        return self.get(id).info

    @override
    def cancel(self, id: str) -> JobInfo:
        job = self.get(id)
        self._cancel([job], resumes=False)
        return job.info

    def cancel_all(self, asset: str, *, resumes: bool = False) -> None:
        """Ask every job of an asset to stop."""
        self._cancel(self.of(asset), resumes)

    def of(self, asset: str) -> list[Job]:
        """The jobs of an asset that are known."""
        return [job for job in self._known() if job.info.asset == asset]

    def builds(self) -> list[Job]:
        """The builds that have not ended."""
        return [job for job in self._known() if job.info.kind == "build" and not job.ended]

    def close(self) -> None:
        """Cancel all jobs and wait for their end."""
        self._cancel(self._known(), resumes=True)
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        for thread in self._threads:
            thread.join()

    def _cancel(self, jobs: list[Job], resumes: bool) -> None:
        for job in jobs:
            job.cancel(resumes=resumes)
            with self._changed:
                waiting = [queued for queued in self._queue if queued.job is job]
                self._queue = [queued for queued in self._queue if queued.job is not job]
                self._note()
            if waiting:
                job.end_cancelled()

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
        keep other jobs out."""
        if kind in TRANSFERS:
            return sum(queued.kind == kind for queued in self._queue)
        return sum(not queued.transfers for queued in self._queue)

    def _put(self, queued: Queued) -> None:
        self._queue.append(queued)
        self._queue.sort(key=lambda queued: _rank(queued.job))

    def _waits(self, job: Job) -> bool:
        """Whether a job waits that the thread of this one would do first."""
        with self._changed:
            lane, _ = self._at_work.get((job.info.asset, False), (LARGE, None))
            return any(
                _rank(queued.job) < _rank(job) and self._may(queued, lane) for queued in self._queue
            )

    def _may(self, queued: Queued, lane: Lane) -> bool:
        """Whether the thread of a lane may do a job now."""
        if queued.turn in self._at_work or not lane.takes(queued):
            return False
        return not lane.spare or self._held_by_another(queued.caller)

    def _held_by_another(self, caller: str) -> bool:
        """Whether another caller alone keeps all lanes that others could use, the spare one not
        counted."""
        callers = [
            queued.caller
            for lane, queued in self._at_work.values()
            if not (lane.spare or queued.transfers)
        ]
        return len(callers) == _USUAL and len(set(callers)) == 1 and callers[0] != caller

    def _next(self, lane: Lane) -> Queued | None:
        """The job that the thread of a lane is to do now."""
        working = Counter(queued.caller for _, queued in self._at_work.values())

        def order(queued: Queued) -> tuple[int, int, int]:
            caller = queued.caller
            return _rank(queued.job), working[caller], self._served.get(caller, 0)

        return min((q for q in self._queue if self._may(q, lane)), key=order, default=None)

    def _forget(self) -> None:
        ended = [id for id, job in self._jobs.items() if job.ended]
        for id in ended[: max(len(self._jobs) - _REMEMBERED, 0)]:
            del self._jobs[id]

    def _note(self) -> None:
        """Count how many jobs of each kind wait and run."""
        queued = Counter(one.job.info.kind for one in self._queue)
        for kind in JOB_KINDS:
            self._figures.set(queued[kind], "jobs", kind, "queued")
            self._figures.set(self._running[kind], "jobs", kind, "running")

    def _note_served(self, caller: str) -> None:
        """Keep the turns of callers that have jobs in the queue or at work."""
        self._served[caller] = next(self._turns)
        known = {one.caller for one in self._queue} | {q.caller for _, q in self._at_work.values()}
        self._served = {name: turn for name, turn in self._served.items() if name in known}

    def _count_end(self, job: Job) -> None:
        self._figures.count("ended", job.info.kind, job.info.state)

    def _run_all(self, lane: Lane) -> None:
        while (queued := self._take(lane)) is not None:
            again = False
            try:
                again = queued.job.run(queued.work)
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
                queued = self._next(lane)
                if queued is not None:
                    self._queue.remove(queued)
                    self._at_work[queued.turn] = lane, queued
                    self._note_served(queued.caller)
                    self._running[queued.job.info.kind] += 1
                    self._note()
                    # The spare lane may now take a job that waits.
                    self._changed.notify_all()
                    return queued
                if self._closed and (lane.spare or not any(map(lane.takes, self._queue))):
                    return None
                self._changed.wait()


def _rank(job: Job) -> int:
    return JOB_KINDS.index(job.info.kind)  # the highest first
