"""Ids of jobs that say which replica runs them, so that any ingress finds a job by its id alone."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import TypeVar

from rhytid.engine.messages import AssetInfo, JobInfo
from rhytid.errors import NotFoundError

_ID = re.compile(r"([0-9a-f]+)-([a-z]+)-([0-9a-f]{16})-([0-9A-Za-z]+)", re.ASCII)
T = TypeVar("T")


@dataclass(frozen=True)
class JobName:
    """A job.  own: its id in the engine of the replica."""

    own: str
    kind: str
    asset: str
    replica: str

    @classmethod
    def of(cls, info: JobInfo, replica: str) -> JobName:
        """The name of a job of a replica."""
        return cls(info.id, info.kind, info.asset, replica)

    @classmethod
    def read(cls, text: str) -> JobName:
        """A name that was an id; raises NotFoundError where it is none."""
        found = _ID.fullmatch(text)
        if found is None:
            raise NotFoundError(f"no job {text}")
        return cls(*found.groups())

    def __str__(self) -> str:
        return f"{self.own}-{self.kind}-{self.asset}-{self.replica}"

    def unknown(self) -> JobInfo:
        """The job, of which nobody knows any more how far it is."""
        return JobInfo(str(self), self.asset, self.kind, "running", 0.0, "", "")


def named_job(info: JobInfo, replica: str) -> JobInfo:
    """A job of a replica as callers see it."""
    return replace(info, id=str(JobName.of(info, replica)))


def named_asset(info: AssetInfo, job: JobInfo | None, replica: str) -> AssetInfo:
    """An asset as callers see it.  job: the one that it names."""
    return replace(info, job=None if job is None else str(JobName.of(job, replica)))
