"""What follows when a job of this replica has ended."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass

from rhytid.engine.messages import ENDED_STATES, JobInfo
from rhytid.errors import NotFoundError, RhytidError

# Seconds between two looks at the jobs, and that what follows one may take.
LOOK, SETTLED = 0.1, 30.0
_log = logging.getLogger(__name__)


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
