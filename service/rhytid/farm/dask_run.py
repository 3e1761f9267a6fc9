"""A run on a Dask cluster: chunks to its workers, what becomes of them back."""

from __future__ import annotations

from collections import Counter, defaultdict, deque
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from queue import Empty
from typing import TYPE_CHECKING, Any

from rhytid.errors import FarmError
from rhytid.farm.chunks import Chunk, ChunkDone, Event, Failure, FrameDone, SessionMaker, Unable
from rhytid.farm.dask_cluster import Cluster
from rhytid.farm.dask_tasks import DaskTasks, Gone, Killed
from rhytid.farm.roster import Roster

if TYPE_CHECKING:
    from distributed import Future

# Seconds without news after which the workers are looked at: while chunks are baked, and else.
_NEWS, _SOON = 2.0, 0.1
# How often in turn all workers may leave a chunk.
_LEFT = 3


@dataclass(frozen=True)
class Given:
    """A chunk that is given out.

    before: its frames that were there by then.  to: the workers that may take it; None = any.
    """

    chunk: Chunk
    before: int
    to: frozenset[str] | None


class DaskRun:
    """Has chunks baked by the workers of a cluster; used once, within `with`.

    As many chunks are given out as workers take: the others wait here, so that the death of a
    worker counts against the chunk alone that it was at.

    roster: the workers.  took: addresses of those that baked a frame.
    """

    def __init__(self, cluster: Cluster, make: SessionMaker) -> None:
        self._cluster = cluster
        self._tasks = DaskTasks(cluster, make)
        self._waiting: deque[Chunk] = deque()
        self._running: dict[Future[Any], Given] = {}
        self._frames: defaultdict[str, set[str]] = defaultdict(set)
        # How often a chunk was left by all workers that might take it, with no frame added.
        self._left: Counter[str] = Counter()
        self.roster = Roster(cluster)
        self.took: set[str] = set()

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
        self._tasks.end(self.roster.there(), failed=failed)

    def bake(self, chunks: Sequence[Chunk]) -> Iterator[Event]:
        """What happens until all chunks are baked, in the order in which it happens; each frame is
        told once, also where its chunk is repeated.

        Raises the error of the first chunk that cannot be baked, and FarmError where workers end
        again and again at one frame, or none is there.
        """
        self._waiting.extend(chunks)
        while self._waiting or self._running:
            if self.roster.due():
                yield from self.roster.look()
                self._take_back()
            self._give_out()
            with suppress(Empty):
                told = self._tasks.heard.get(timeout=_NEWS if self._running else _SOON)
                yield from self._frame(**told) if isinstance(told, dict) else self._ended(told)
        yield from self.roster.look()

    def _take_back(self) -> None:
        """Give chunks anew whose workers have all left: Dask would wait for their return."""
        able = self.roster.able().keys()
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
        able = self.roster.able()
        to = frozenset(able) if self.roster.aside else None
        while self._waiting and len(self._running) < sum(able.values()):
            chunk = self._waiting.popleft()
            given = Given(chunk, self._frames_of(chunk), to)
            self._running[self._tasks.submit(chunk, to)] = given

    def _frame(self, chunk: str, frame: str, worker: str) -> Iterator[Event]:
        self.took.add(worker)
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
            if isinstance(report, Unable) and self.roster.put_aside(report):
                yield report
            return
        yield ChunkDone(chunk, report)


def _deadly(chunk: Chunk, last: str) -> FarmError:
    return FarmError(f"frames {chunk.text}: several workers ended at them, the last was {last}")
