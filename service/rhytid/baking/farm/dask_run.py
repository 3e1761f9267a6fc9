"""A run on a Dask cluster: chunks to its workers, and what becomes of them back."""

from __future__ import annotations

import time
from collections import Counter, defaultdict, deque
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from queue import Empty
from typing import TYPE_CHECKING, Any

from rhytid.baking.farm.chunks import (
    Chunk,
    ChunkDone,
    Event,
    Failure,
    FrameDone,
    Unable,
    WorkerLost,
)
from rhytid.baking.farm.dask_cluster import Cluster, no_worker_error
from rhytid.baking.farm.dask_tasks import DaskTasks, Gone, Killed
from rhytid.errors import FarmError, RhytidError

if TYPE_CHECKING:
    from distributed import Future

    from rhytid.baking.farm.bake_session import WorkerJob

# Seconds without news after which the workers are looked at: while chunks are baked, and else.
_NEWS, _SOON = 2.0, 0.1
# How often in turn all workers may leave a chunk.
_LEFT = 3
# Seconds that a cluster may be without a worker, and between two looks at who is there (sooner
# where nobody is).
PATIENCE, _LOOK, _RETRY = 60.0, 2.0, 0.1


class DaskRun:
    """Has chunks baked by the workers of a cluster; used once, within `with`.

    As many chunks are given out as workers take: the others wait here, so that the death of a
    worker counts against the chunk alone that it was at.

    workers: those of the cluster.  used: addresses of those that baked a frame.
    """

    def __init__(self, cluster: Cluster, job: WorkerJob) -> None:
        self._cluster = cluster
        self._tasks = DaskTasks(cluster, job)
        self._waiting: deque[Chunk] = deque()
        self._running: dict[Future[Any], Assignment] = {}
        self._frames: defaultdict[str, set[str]] = defaultdict(set)
        # How often a chunk was left by all workers that might take it, with no frame added.
        self._left: Counter[str] = Counter()
        self.workers = Workers(cluster)
        self.used: set[str] = set()

    def __enter__(self) -> DaskRun:
        self._tasks.listen()
        return self

    def __exit__(self, *error: object) -> None:
        """Cancel what runs, and have the workers end this run. After an error nobody waits until
        they have, and those that are ours are killed."""
        failed = error[0] is not None
        if failed and self._cluster.kill():
            return
        self._tasks.drop([*self._running])
        self._tasks.end(self.workers.there(), failed=failed)

    def bake(self, chunks: Sequence[Chunk]) -> Iterator[Event]:
        """What happens until all chunks are baked, in the order in which it happens; each frame is
        told once, also where its chunk is repeated.

        Raises the error of the first chunk that cannot be baked, and FarmError where workers end
        again and again at one frame, or none is there.
        """
        self._waiting.extend(chunks)
        while self._waiting or self._running:
            if self.workers.due():
                yield from self.workers.look()
                self._take_back()
            self._give_out()
            with suppress(Empty):
                told = self._tasks.heard.get(timeout=_NEWS if self._running else _SOON)
                yield from self._frame(**told) if isinstance(told, dict) else self._ended(told)
        yield from self.workers.look()

    def _take_back(self) -> None:
        """Give chunks anew whose workers have all left: Dask would wait for their return."""
        able = self.workers.able().keys()
        for future, given in [*self._running.items()]:
            if given.to is not None and given.to.isdisjoint(able):
                del self._running[future]
                self._tasks.drop([future])
                self._left[given.chunk.text] += 1
                if self._frames_of(given.chunk) > given.before:
                    self._left[given.chunk.text] = 0
                if self._left[given.chunk.text] > _LEFT:
                    raise _deadly(given.chunk, ", ".join(sorted(given.to)))
                self._waiting.appendleft(given.chunk)

    def _frames_of(self, chunk: Chunk) -> int:
        return len(self._frames[chunk.text])

    def _give_out(self) -> None:
        """Submit what waits, as far as workers take it."""
        able = self.workers.able()
        to = frozenset(able) if self.workers.aside else None
        while self._waiting and len(self._running) < sum(able.values()):
            chunk = self._waiting.popleft()
            given = Assignment(chunk, self._frames_of(chunk), to)
            self._running[self._tasks.submit(chunk, to)] = given

    def _frame(self, chunk: str, frame: str, worker: str) -> Iterator[Event]:
        self.used.add(worker)
        if frame not in self._frames[chunk]:
            self._frames[chunk].add(frame)
            yield FrameDone(frame, worker)

    def _ended(self, future: Future[Any]) -> Iterator[Event]:
        given = self._running.pop(future, None)
        if given is None:  # it was taken back
            return
        chunk = given.chunk
        report = self._tasks.report(future, chunk)
        if isinstance(report, Failure):
            raise report.error
        # Frames that are there are not drawn again: it goes on as long as some are added.
        if isinstance(report, Killed) and self._frames_of(chunk) == given.before:
            raise _deadly(chunk, report.last) from report.error
        if isinstance(report, Killed | Gone | Unable):
            self._waiting.appendleft(chunk)
            if isinstance(report, Unable) and self.workers.put_aside(report):
                yield report
            return
        yield ChunkDone(chunk, report)


@dataclass(frozen=True)
class Assignment:
    """A chunk that is given out.

    before: its frames that were there by then.  to: the workers that may take it; None = any.
    """

    chunk: Chunk
    before: int
    to: frozenset[str] | None


def _deadly(chunk: Chunk, last: str) -> FarmError:
    return FarmError(f"frames {chunk.text}: several workers ended at them, the last was {last}")


class Workers:
    """The workers of a cluster by the last look: which are there, and which can bake.

    seen: addresses of all that were there.  lost: of those that left.  aside: why those that
    cannot bake are given no more chunks.
    """

    def __init__(self, cluster: Cluster, patience: float = PATIENCE) -> None:
        self._cluster, self._patience = cluster, patience
        self._slots: dict[str, int] = {}
        self._last_able, self._looked = time.monotonic(), 0.0
        self.seen: set[str] = set()
        self.lost: set[str] = set()
        self.aside: dict[str, RhytidError] = {}

    def due(self) -> bool:
        """Whether it is time for another look."""
        pause = _LOOK if any(self._slots.values()) else _RETRY
        return time.monotonic() - self._looked >= pause

    def look(self) -> Iterator[WorkerLost]:
        """See who is there, and tell who has left. Raises FarmError where nobody has been there for
        too long, and the error of the last worker where none can bake."""
        now = time.monotonic()
        self._looked, self._slots = now, self._cluster.slots()
        there = set(self.there())
        lost, self.seen = self.seen - there, self.seen | there
        yield from map(WorkerLost, lost - self.lost)
        self.lost |= lost
        if there - self.aside.keys():
            self._last_able = now
        elif now - self._last_able > self._patience or (self._slots and not self.seen):
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
            time.sleep(_RETRY)
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
