"""How many unfinished jobs each caller may have."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rhytid.api.access import Caller
from rhytid.engine.messages import ENDED_STATES, JobInfo
from rhytid.errors import NotFoundError, QuotaError

# Places that are kept before those of ended jobs are looked for.
REMEMBERED = 1000


class JobShare:
    """A place for one job, until it has ended; several that name the same job are one."""

    def __init__(self, caller: str) -> None:
        self.caller = caller
        self.job: str | None = None

    def take(self, job: str | None) -> None:
        """The job that stands in it; None = none was needed."""
        self.job = job


class JobShares:
    """Counts unfinished jobs by who asked for them. Safe from any thread.

    info: how far a job is; raises NotFoundError for one that is not known any more.
    """

    def __init__(self, info: Callable[[str], JobInfo]) -> None:
        self._info = info
        self._lock = threading.Lock()
        self._shares: list[JobShare] = []

    @contextmanager
    def one(self, caller: Caller) -> Iterator[JobShare]:
        """A place for a job; it is free again after the block where that named none.

        Raises QuotaError where the caller has as many unfinished jobs as it may.
        """
        share = JobShare(caller.name)
        with self._lock:
            full = self._count(caller) >= caller.jobs or len(self._shares) >= REMEMBERED
            kept = self._shares[:] if full else []
        # Not under the lock: the device's process may let it wait.
        ended = {one for one in kept if not self._is_held(one)}
        with self._lock:
            self._shares = [one for one in self._shares if one not in ended]
            if (held := self._count(caller)) >= caller.jobs:
                raise QuotaError(f"{caller.name} has {held} unfinished jobs: at most {caller.jobs}")
            self._shares.append(share)
        try:
            yield share
        finally:
            with self._lock:
                others = [one for one in self._shares if one is not share]
                if share.job is None or any(_same(share, one) for one in others):
                    self._shares = others

    def _count(self, caller: Caller) -> int:
        return sum(share.caller == caller.name for share in self._shares)

    def _is_held(self, share: JobShare) -> bool:
        if share.job is None:  # its request is on its way
            return True
        try:
            return self._info(share.job).state not in ENDED_STATES
        except NotFoundError:
            return False


def _same(one: JobShare, other: JobShare) -> bool:
    return (one.caller, one.job) == (other.caller, other.job)
