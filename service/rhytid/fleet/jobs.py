"""Jobs of a fleet: ids that say which replica runs a job, and what follows when a job has ended."""

from __future__ import annotations

import hmac
import logging
import re
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from hashlib import blake2b

from rhytid.engine.messages import ENDED_STATES, AssetInfo, JobInfo
from rhytid.errors import NotFoundError, RhytidError

_ID = re.compile(
    r"([0-9a-f]{1,64})-([a-z]{1,32})-([0-9a-f]{16})-([0-9A-Za-z]{1,64})-([0-9a-f]{16})", re.ASCII
)
# Seconds between two looks at the jobs, and that what follows one may take.
LOOK, SETTLED = 0.1, 30.0
_log = logging.getLogger(__name__)


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


@dataclass(frozen=True)
class _Watched:
    job: str
    then: Callable[[JobInfo | None], None]


class JobWatch:
    """Looks at jobs until they end; nobody else might ask for them.

    info: tells how far a job is, and raises NotFoundError where it is not known any more.
    """

    def __init__(self, info: Callable[[str], JobInfo]) -> None:
        self._info = info
        self._changed = threading.Condition()
        self._watched: list[_Watched] = []
        self._closing = False
        self._thread = threading.Thread(target=self._run, name="rhytid-jobs", daemon=True)
        self._thread.start()

    def watch(self, job: str, then: Callable[[JobInfo | None], None]) -> None:
        """Call `then` with a job once it has ended; with None where nobody knows it."""
        with self._changed:
            self._watched.append(_Watched(job, then))
            self._changed.notify_all()

    def settle(self, job: str) -> None:
        """Wait until what follows a job that has ended is done."""
        with self._changed:
            self._changed.wait_for(
                lambda: self._closing or all(one.job != job for one in self._watched), SETTLED
            )

    def close(self) -> None:
        """Watch no more."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        self._thread.join()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._watched or self._closing)
                if self._closing:
                    return
                watched = list(self._watched)
            ended = [one for one in watched if self._has_ended(one)]
            with self._changed:
                self._watched = [one for one in self._watched if one not in ended]
                self._changed.notify_all()
                self._changed.wait_for(lambda: self._closing, LOOK)

    def _has_ended(self, one: _Watched) -> bool:
        try:
            found: JobInfo | None = self._info(one.job)
        except NotFoundError:
            found = None
        except RhytidError as error:  # such as of a process that restarts
            _log.warning("job %s is asked for again: %s", one.job, error)
            return False
        if found is not None and found.state not in ENDED_STATES:
            return False
        try:
            one.then(found)
        except Exception:  # noqa: BLE001 the other jobs are watched on
            _log.exception("what follows job %s failed", one.job)
        return True
