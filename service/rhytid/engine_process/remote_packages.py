"""Skin packages of an engine in another process."""

from __future__ import annotations

from rhytid.engine.messages import JobInfo, Package
from rhytid.engine_process.caller import Caller
from rhytid.engine_process.remote_jobs import RemoteJobs
from rhytid.engine_process.requests import Request


class RemotePackages:
    """The calls of `PackageService`."""

    def __init__(self, supervisor: Caller, jobs: RemoteJobs) -> None:
        self._supervisor, self._jobs = supervisor, jobs

    def of(
        self, asset: str, levels: int = 1, key: str | None = None, begin: bool = True
    ) -> Package | JobInfo | None:
        """As `PackageService.of`."""
        request = Request("packages.of", (asset, levels, key, begin))
        found: Package | JobInfo | None = self._supervisor.call(request)
        return self._jobs.keep(found) if isinstance(found, JobInfo) else found
