"""Ids of jobs that say which replica runs them, so that any ingress finds a job by its id alone."""

from __future__ import annotations

import hmac
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from hashlib import blake2b

from rhytid.engine.messages import AssetInfo, JobInfo
from rhytid.errors import NotFoundError

_ID = re.compile(
    r"([0-9a-f]{1,64})-([a-z]{1,32})-([0-9a-f]{16})-([0-9A-Za-z]{1,64})-([0-9a-f]{16})", re.ASCII
)


@dataclass(frozen=True)
class JobName:
    """A job.  own: its id in the engine of the replica."""

    own: str
    kind: str
    asset: str
    replica: str

    def unknown(self, id: str) -> JobInfo:
        """The job of that id, of which nobody knows any more how far it is."""
        return JobInfo(id, self.asset, self.kind, "running", 0.0, "", "")


class JobNames:
    """Makes ids of jobs, and reads them.

    An id ends with a seal, since what it says is believed when its replica has ended: nobody has a
    list of jobs then.  key: of the fleet, which seals are made with.
    """

    def __init__(self, key: bytes) -> None:
        self._key = key

    def id(self, name: JobName) -> str:
        """The id that callers see."""
        text = f"{name.own}-{name.kind}-{name.asset}-{name.replica}"
        return f"{text}-{self._seal(text)}"

    def read(self, id: str) -> JobName:
        """The job of an id; raises NotFoundError for what this fleet has not made."""
        found = _ID.fullmatch(id)
        if found is not None:
            *parts, seal = found.groups()
            if hmac.compare_digest(seal, self._seal("-".join(parts))):
                return JobName(*parts)
        raise NotFoundError(f"no job {id!r:.200}")

    def _seal(self, text: str) -> str:
        return blake2b(text.encode(), key=self._key, digest_size=8).hexdigest()


class ReplicaNames:
    """Names jobs of one replica.

    replica: its name.  info: tells of a job of its engine, and raises NotFoundError where it is not
    known any more.
    """

    def __init__(self, names: JobNames, replica: str, info: Callable[[str], JobInfo]) -> None:
        self._names, self._replica, self._info = names, replica, info

    def job(self, info: JobInfo) -> JobInfo:
        """A job as callers see it."""
        name = JobName(info.id, info.kind, info.asset, self._replica)
        return replace(info, id=self._names.id(name))

    def asset(self, info: AssetInfo) -> AssetInfo:
        """An asset as callers see it."""
        if info.job is None:
            return info
        try:
            return replace(info, job=self.job(self._info(info.job)).id)
        except NotFoundError:
            return replace(info, job=None)
