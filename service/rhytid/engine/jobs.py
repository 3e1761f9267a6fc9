"""Long work: one job at a time, with progress, that can be cancelled."""

from __future__ import annotations

import logging
import secrets
import threading
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

from rhytid.engine.messages import ENDED_STATES, JobInfo
from rhytid.errors import CancelledError, NotFoundError, RhytidError

_log = logging.getLogger(__name__)
_REMEMBERED = 1000


class Job:
    """One piece of long work, as the thread that does it sees it."""

    def __init__(self, info: JobInfo) -> None:
        self._info = info
        self._lock = threading.Lock()
        self._cancelled = threading.Event()
        self.resumes = False

    @property
    def info(self) -> JobInfo:
        """How far it is."""
        with self._lock:
            return self._info

    def progress(self, share: float, stage: str, detail: str = "") -> None:
        """Say how far the job is; raises CancelledError where it is no longer wanted."""
        if self._cancelled.is_set():
            raise CancelledError(f"job {self._info.id} was cancelled")
        share = min(max(share, self.info.progress), 1.0)
        self.update(progress=share, stage=stage, detail=detail)

    def cancel(self, *, resumes: bool = False) -> None:
        """Ask the job to stop at its next step; `resumes` when its work shall be done later."""
        if not self._cancelled.is_set():
            self.resumes = resumes
            self._cancelled.set()

    def update(self, **changes: Any) -> None:
        """Replace parts of the info."""
        with self._lock:
            self._info = replace(self._info, **changes)

    @property
    def ended(self) -> bool:
        """Whether nothing more will happen."""
        return self.info.state in ENDED_STATES


class Jobs:
    """Runs jobs in the order in which they came and remembers how the last ones ended."""

    def __init__(self) -> None:
        self._jobs: OrderedDict[str, Job] = OrderedDict()
        self._lock = threading.Lock()
        self._runner = ThreadPoolExecutor(1, thread_name_prefix="rhytid-jobs")

    def start(self, kind: str, asset: str, work: Callable[[Job], None]) -> Job:
        """Queue `work`; it reports through the job that it is given."""
        job = Job(JobInfo(secrets.token_hex(8), asset, kind, "queued", 0.0, "queued", ""))
        with self._lock:
            self._jobs[job.info.id] = job
            self._forget()
        self._runner.submit(_run, job, work)
        return job

    def get(self, id: str) -> Job:
        """The job of that id; raises NotFoundError."""
        with self._lock:
            if id not in self._jobs:
                raise NotFoundError(f"no job {id!r}")
            return self._jobs[id]

    def cancel_of(self, asset: str) -> None:
        """Cancel every job of an asset."""
        with self._lock:
            jobs = list(self._jobs.values())
        for job in jobs:
            if job.info.asset == asset:
                job.cancel()

    def close(self) -> None:
        """Cancel what is left and wait for its end."""
        with self._lock:
            jobs = list(self._jobs.values())
        for job in jobs:
            job.cancel(resumes=True)
        self._runner.shutdown()

    def _forget(self) -> None:
        ended = [id for id, job in self._jobs.items() if job.ended]
        for id in ended[: max(len(self._jobs) - _REMEMBERED, 0)]:
            del self._jobs[id]


def _run(job: Job, work: Callable[[Job], None]) -> None:
    job.update(state="running")
    try:
        job.progress(0.0, "starting")
        work(job)
    except CancelledError as error:
        job.update(state="cancelled", detail=str(error))
    except RhytidError as error:
        job.update(state="failed", detail=str(error))
    except BaseException as error:
        _log.exception("job %s failed", job.info.id)
        job.update(state="failed", detail=f"internal error: {type(error).__name__}")
        raise
    else:
        job.update(state="done", progress=1.0, stage="done", detail="")
