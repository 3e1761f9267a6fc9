"""Jobs of an engine in another process."""

from __future__ import annotations

from functools import partial

from rhytid.engine.messages import AssetInfo, JobInfo
from rhytid.engine_process.caller import Caller
from rhytid.engine_process.job_ledger import JobLedger, resumed
from rhytid.engine_process.requests import Request
from rhytid.errors import NotFoundError


class RemoteJobs:
    """The calls of `Jobs` that a server makes."""

    def __init__(self, supervisor: Caller, ledger: JobLedger) -> None:
        self._supervisor, self._ledger = supervisor, ledger

    def info(self, id: str) -> JobInfo:
        """How far a job is; raises NotFoundError. Of a process that has ended a build goes on under
        the same id, other jobs have failed."""
        lost = self._ledger.lost(id)
        if lost is not None:
            return self._resumed(lost)
        try:
            return self._ledger.keep(self._now(id))
        except NotFoundError:
            known = self._ledger.find(id)  # the process may have ended, since or before
            if known is None:
                raise
            return self._resumed(known)

    def cancel(self, id: str) -> JobInfo:
        """Ask a job to stop at its next step; raises NotFoundError."""
        lost = self._ledger.lost(id)
        if lost is None:
            return self._cancelled(id)
        now = self._resumed(lost)
        job = self._asset(lost.asset).job if now.state in ("queued", "running") else None
        if job is None:
            return now
        return JobInfo(**{**vars(self._cancelled(job, lost.asset)), "id": id})

    def keep(self, info: JobInfo) -> JobInfo:
        """Remember a job whose id a caller gets; the job itself."""
        return self._ledger.keep(info)

    def note(self, id: str, asset: str) -> None:
        """Remember the build of an asset, whose id a caller gets. The process is not asked: the
        build may have ended it by now, or may keep it from answering."""
        if self._ledger.find(id) is None:
            self._ledger.keep(JobInfo(id, asset, "build", "queued", 0.0, "", ""))

    def _now(self, id: str, asset: str = "") -> JobInfo:
        of = asset or self._ledger.asset(id)
        found: JobInfo = self._supervisor.call(Request("jobs.info", (id,), of=of))
        return found

    def _cancelled(self, id: str, asset: str = "") -> JobInfo:
        of = asset or self._ledger.asset(id)
        found: JobInfo = self._supervisor.call(Request("jobs.cancel", (id,), of=of))
        return found

    def _resumed(self, lost: JobInfo) -> JobInfo:
        return resumed(lost, self._asset, partial(self._now, asset=lost.asset))

    def _asset(self, asset: str) -> AssetInfo:
        found: AssetInfo = self._supervisor.call(Request("assets.info", (asset,)))
        return found
