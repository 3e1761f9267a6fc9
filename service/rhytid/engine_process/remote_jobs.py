"""Jobs of an engine in another process."""

from __future__ import annotations

from contextlib import suppress

from rhytid.engine.messages import AssetInfo, JobInfo
from rhytid.engine_process.job_ledger import JobLedger, resumed
from rhytid.engine_process.requests import Request
from rhytid.engine_process.supervisors import Supervisors
from rhytid.errors import NotFoundError


class RemoteJobs:
    """The calls of `Jobs` that a server makes."""

    def __init__(self, supervisor: Supervisors, ledger: JobLedger) -> None:
        self._supervisor, self._ledger = supervisor, ledger

    def info(self, id: str) -> JobInfo:
        """How far a job is; raises NotFoundError. Of a process that has ended a build goes on under
        the same id, other jobs have failed."""
        lost = self._ledger.lost(id)
        if lost is not None:
            return resumed(lost, self._asset, self._now)
        try:
            return self._ledger.keep(self._now(id))
        except NotFoundError:
            lost = self._ledger.lost(id)  # the process may have ended since
            if lost is None:
                raise
            return resumed(lost, self._asset, self._now)

    def cancel(self, id: str) -> JobInfo:
        """Ask a job to stop at its next step; raises NotFoundError."""
        lost = self._ledger.lost(id)
        if lost is None:
            return self._cancelled(id)
        now = resumed(lost, self._asset, self._now)
        job = self._asset(lost.asset).job if now.state in ("queued", "running") else None
        if job is None:
            return now
        return JobInfo(**{**vars(self._cancelled(job)), "id": id})

    def keep(self, info: JobInfo) -> JobInfo:
        """Remember a job that a caller is told of; the job itself."""
        return self._ledger.keep(info)

    def note(self, id: str) -> None:
        """Remember a job, of which a caller is told the id."""
        if not self._ledger.knows(id):
            with suppress(NotFoundError):
                self._ledger.keep(self._now(id))

    def _now(self, id: str) -> JobInfo:
        found: JobInfo = self._supervisor.call(Request("jobs.info", (id,)))
        return found

    def _cancelled(self, id: str) -> JobInfo:
        found: JobInfo = self._supervisor.call(Request("jobs.cancel", (id,)))
        return found

    def _asset(self, asset: str) -> AssetInfo:
        found: AssetInfo = self._supervisor.call(Request("assets.info", (asset,)))
        return found
