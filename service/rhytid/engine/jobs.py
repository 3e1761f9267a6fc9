"""Long work in the background: a bounded queue by priority, and the threads that take jobs."""

from __future__ import annotations

import secrets
import threading
from collections import Counter, OrderedDict
from collections.abc import Callable
from functools import partial

from rhytid.device.figures import JOB_KINDS, Figures
from rhytid.domain.wording import plural
from rhytid.engine.job import Job
from rhytid.engine.job_lanes import LANES, LARGE, TRANSFERS, Lane, Queued
from rhytid.engine.messages import JobInfo
from rhytid.errors import BusyError, NotFoundError

# Kinds of jobs by priority, highest first.
KINDS = JOB_KINDS
# A new job of these kinds replaces those of the same asset that still wait.
_SUPERSEDED = ("calibration", "bins", "push")
_REMEMBERED = 1000


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

        A calibration, bins or a push that still waits for the same asset is cancelled: this comes
        in its place. Raises BusyError where too many jobs wait, unless `always`.
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
