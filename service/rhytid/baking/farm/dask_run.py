"""One run on a Dask cluster: which worker gets which chunk, and what has become of it."""

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
    ChunkFailed,
    Event,
    FrameDone,
    WorkerLost,
    WorkerUnable,
)
from rhytid.baking.farm.dask_cluster import Cluster, no_worker_error
from rhytid.baking.farm.dask_tasks import ChunkKilled, DaskTasks, ReportLost
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
    """Has the workers of a cluster bake chunks. Used once, within `with`.

    Only as many chunks are submitted as workers take at once. The others wait here: Dask counts the
    death of a worker against all of its tasks.

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
        """Cancel running tasks, and close the sessions of workers. After an error there is no wait
        for that, and workers of this process are killed."""
        failed = error[0] is not None
        if failed and self._cluster.kill():
            return
        self._tasks.drop([*self._running])
        self._tasks.end(self.workers.present(), failed=failed)

    def bake(self, chunks: Sequence[Chunk]) -> Iterator[Event]:
        """Yield events until all chunks are baked, each frame once, also where its chunk is
        repeated.

        Raises the error of the first chunk that cannot be baked, and FarmError where workers end
        again and again at one frame, or where there is no worker.
        """
        self._waiting.extend(chunks)
        while self._waiting or self._running:
            if self.workers.due():
                yield from self.workers.update()
                self._reassign()
            self._submit_waiting()
            with suppress(Empty):
                event = self._tasks.events.get(timeout=_NEWS if self._running else _SOON)
                yield from self._frame(**event) if isinstance(event, dict) else self._ended(event)
        yield from self.workers.update()

    def _reassign(self) -> None:
        """Take back chunks whose workers have all left. Dask would wait for them to return."""
        able = self.workers.available().keys()
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

    def _submit_waiting(self) -> None:
        """Submit waiting chunks, as many as workers take."""
        able = self.workers.available()
        to = frozenset(able) if self.workers.excluded else None
        while self._waiting and len(self._running) < sum(able.values()):
            chunk = self._waiting.popleft()
            given = Assignment(chunk, self._frames_of(chunk), to)
            self._running[self._tasks.submit(chunk, to)] = given

    def _frame(self, chunk: str, frame: str, worker: str, worked: bool = True) -> Iterator[Event]:
        self.used.add(worker)
        if frame not in self._frames[chunk]:
            self._frames[chunk].add(frame)
            yield FrameDone(frame, worker, worked)

    def _ended(self, future: Future[Any]) -> Iterator[Event]:
        given = self._running.pop(future, None)
        if given is None:  # it was taken back
            return
        chunk = given.chunk
        report = self._tasks.report(future, chunk)
        if isinstance(report, ChunkFailed):
            raise report.error
        # Frames that are there are not drawn again: it goes on as long as some are added.
        if isinstance(report, ChunkKilled) and self._frames_of(chunk) == given.before:
            raise _deadly(chunk, report.last) from report.error
        if isinstance(report, ChunkKilled | ReportLost | WorkerUnable):
            self._waiting.appendleft(chunk)
            if isinstance(report, WorkerUnable) and self.workers.exclude(report):
                yield report
            return
        yield ChunkDone(chunk, report)


@dataclass(frozen=True)
class Assignment:
    """A chunk that is submitted.

    before: number of its frames that were done by then.  to: addresses of the workers that may take
    it; None for any.
    """

    chunk: Chunk
    before: int
    to: frozenset[str] | None


def _deadly(chunk: Chunk, last: str) -> FarmError:
    return FarmError(f"frames {chunk.text}: several workers ended at them, the last was {last}")


class Workers:
    """The workers of a cluster, as of the last update.

    seen: addresses of all that there ever were.  lost: addresses of those that left.  excluded:
    errors of those that cannot bake, by address.
    """

    def __init__(self, cluster: Cluster, patience: float = PATIENCE) -> None:
        self._cluster, self._patience = cluster, patience
        self._slots: dict[str, int] = {}
        self._last_able, self._looked = time.monotonic(), 0.0
        self.seen: set[str] = set()
        self.lost: set[str] = set()
        self.excluded: dict[str, RhytidError] = {}

    def due(self) -> bool:
        """Whether it is time for an update."""
        pause = _LOOK if any(self._slots.values()) else _RETRY
        return time.monotonic() - self._looked >= pause

    def update(self) -> Iterator[WorkerLost]:
        """Ask the cluster which workers there are, and yield those that have left. Raises FarmError
        where there has been none for too long, and the error of the last one where none can
        bake."""
        now = time.monotonic()
        self._looked, self._slots = now, self._cluster.slots()
        there = set(self.present())
        lost, self.seen = self.seen - there, self.seen | there
        yield from map(WorkerLost, lost - self.lost)
        self.lost |= lost
        if there - self.excluded.keys():
            self._last_able = now
        elif now - self._last_able > self._patience or (self._slots and not self.seen):
            raise self._none_left()

    def present(self) -> list[str]:
        """Addresses of workers that take chunks, whether they can bake or not."""
        return [address for address, slots in self._slots.items() if slots]

    def available(self) -> dict[str, int]:
        """How many chunks each worker takes at once, of those that can bake. Raises the error of an
        excluded one where no other is left that may return."""
        able = {one: self._slots[one] for one in self.present() if one not in self.excluded}
        if self.excluded and not able and not self.lost - self.excluded.keys():
            raise self._none_left()
        return able

    def slots(self) -> int:
        """How many chunks the cluster takes at once. Waits until there is a worker; raises
        FarmError where none comes."""
        while not sum(self._slots.values()):
            for _ in self.update():
                pass
            time.sleep(_RETRY)
        return sum(self._slots.values())

    def exclude(self, unable: WorkerUnable) -> bool:
        """Give a worker no more chunks; return whether it was not excluded yet."""
        if unable.worker in self.excluded:
            return False
        self.excluded[unable.worker] = unable.error
        return True

    def _none_left(self) -> RhytidError:
        """The error of the last excluded worker, or that there is no worker."""
        reasons = [*self.excluded.values()]
        return reasons[-1] if reasons else no_worker_error(self._cluster.where, len(self._slots))
