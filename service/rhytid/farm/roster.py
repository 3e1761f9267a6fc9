"""The workers of a cluster: which of them are there, and which can bake."""

from __future__ import annotations

import time
from collections.abc import Iterator

from rhytid.errors import RhytidError
from rhytid.farm.chunks import Unable, WorkerLost
from rhytid.farm.dask_cluster import Cluster, no_worker_error

# Seconds that a cluster may be without a worker, and between two looks at who is there (sooner
# where nobody is).
PATIENCE, _LOOK, _SOON = 60.0, 2.0, 0.1


class Roster:
    """Who is there, by the last look.

    workers: addresses of all that were there.  lost: of those that left.  aside: why those that
    cannot bake are given no more chunks.
    """

    def __init__(self, cluster: Cluster, patience: float = PATIENCE) -> None:
        self._cluster, self._patience = cluster, patience
        self._slots: dict[str, int] = {}
        self._seen, self._looked = time.monotonic(), 0.0
        self.workers: set[str] = set()
        self.lost: set[str] = set()
        self.aside: dict[str, RhytidError] = {}

    def due(self) -> bool:
        """Whether it is time for another look."""
        pause = _LOOK if any(self._slots.values()) else _SOON
        return time.monotonic() - self._looked >= pause

    def look(self) -> Iterator[WorkerLost]:
        """See who is there, and tell who has left. Raises FarmError where nobody has been there for
        too long, and the error of the last worker where none can bake."""
        now = time.monotonic()
        self._looked, self._slots = now, self._cluster.slots()
        there = set(self.there())
        lost, self.workers = self.workers - there, self.workers | there
        yield from map(WorkerLost, lost - self.lost)
        self.lost |= lost
        if there - self.aside.keys():
            self._seen = now
        elif now - self._seen > self._patience or (self._slots and not self.workers):
            raise self._none_left()

    def there(self) -> list[str]:
        """The addresses of those that take chunks, whether they can bake or not."""
        return [address for address, slots in self._slots.items() if slots]

    def able(self) -> dict[str, int]:
        """How many chunks those that can bake take at once. Raises the error of one that cannot
        where none is left, and none has gone that may return."""
        able = {one: self._slots[one] for one in self.there() if one not in self.aside}
        if self.aside and not able and not self.lost - self.aside.keys():
            raise self._none_left()
        return able

    def slots(self) -> int:
        """How many chunks the cluster takes at once; waits until there is a worker. Raises
        FarmError where none comes."""
        while not sum(self._slots.values()):
            for _ in self.look():
                pass
            time.sleep(_SOON)
        return sum(self._slots.values())

    def put_aside(self, unable: Unable) -> bool:
        """Give a worker no more chunks; whether it had any until now."""
        if unable.worker in self.aside:
            return False
        self.aside[unable.worker] = unable.error
        return True

    def _none_left(self) -> RhytidError:
        """Why the last worker cannot bake, or that there is none."""
        reasons = [*self.aside.values()]
        return reasons[-1] if reasons else no_worker_error(self._cluster.where, len(self._slots))
