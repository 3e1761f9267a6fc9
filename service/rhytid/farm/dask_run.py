"""A run on a Dask cluster: chunks to its workers, what becomes of them back."""

from __future__ import annotations

import threading
import time
from collections import Counter, defaultdict, deque
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any
from uuid import uuid4

from rhytid import __version__
from rhytid.errors import FarmError, RhytidError
from rhytid.farm.chunks import (
    Chunk,
    ChunkDone,
    Event,
    Failure,
    FrameDone,
    SessionMaker,
    Unable,
    WorkerLost,
    packed,
)
from rhytid.farm.dask_cluster import RESOURCE, Cluster, no_worker_error

if TYPE_CHECKING:
    from distributed import Future

# How often a chunk is tried again after an error that may pass.
RETRIES = 2
# Seconds that a cluster may be without a worker, between two looks at who is there (sooner
# where nobody is), that workers have to close what they hold, and to hear of an end by an error.
PATIENCE, _LOOK, _SOON, _FAREWELL, _SENT = 60.0, 2.0, 0.1, 5.0, 0.5
# Seconds in which a report has to come, and how often in turn all workers may leave a chunk.
_FETCH, _LEFT = 30.0, 3
# Of what Dask says where a module is missing at the scheduler.
_UNREADABLE = "deserialization of the task graph"
_NEEDED = f"scheduler and workers need rhytid {__version__} with the extra dask"


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

    workers: addresses of all that were there.  took: of those that baked a frame.  lost: of those
    that left.  aside: why those that cannot bake are given no more chunks.
    """

    def __init__(self, cluster: Cluster, make: SessionMaker, patience: float = PATIENCE) -> None:
        self._cluster, self._patience = cluster, patience
        self._maker = packed(make)
        self._name = f"rhytid-bake-{uuid4().hex[:12]}"
        self._heard: SimpleQueue[dict[str, str] | Future[Any]] = SimpleQueue()
        self._waiting: deque[Chunk] = deque()
        self._running: dict[Future[Any], Given] = {}
        self._frames: defaultdict[str, set[str]] = defaultdict(set)
        self._slots: dict[str, int] = {}
        self._seen = self._looked = 0.0
        self.workers: set[str] = set()
        self.took: set[str] = set()
        self.lost: set[str] = set()
        self.aside: dict[str, RhytidError] = {}
        # How often a chunk was left by all workers that might take it, with no frame added.
        self._left: Counter[str] = Counter()

    def __enter__(self) -> DaskRun:
        self._cluster.client.subscribe_topic(self._name, self._hear)
        self._seen = time.monotonic()
        return self

    def __exit__(self, *error: object) -> None:
        """Cancel what runs, and have the workers end this run. After an error nobody waits until
        they have, and those that are ours are killed."""
        failed = error[0] is not None
        if failed and self._cluster.kill():
            return
        client = self._cluster.client
        if self._running:
            client.cancel([*self._running], force=True)
        client.unsubscribe_topic(self._name)
        # The cluster may be gone: then there is no answer.
        farewell = threading.Thread(target=self._end, args=(not failed,), daemon=True)
        farewell.start()
        farewell.join(_SENT if failed else _FAREWELL)

    def bake(self, chunks: Sequence[Chunk]) -> Iterator[Event]:
        """What happens until all chunks are baked, in the order in which it happens; each frame is
        told once, also where its chunk is repeated.

        Raises the error of the first chunk that cannot be baked, and FarmError where workers end
        again and again at one frame, or none is there.
        """
        self._waiting.extend(chunks)
        while self._waiting or self._running:
            yield from self._look()
            self._give_out()
            with suppress(Empty):
                told = self._heard.get(timeout=_LOOK if self._running else _SOON)
                yield from self._frame(**told) if isinstance(told, dict) else self._ended(told)
        self._looked = 0.0
        yield from self._look()

    def slots(self) -> int:
        """How many chunks the cluster takes at once; waits until there is a worker. Raises
        FarmError where none comes."""
        while not sum(self._slots.values()):
            for _ in self._look():
                pass
            time.sleep(_SOON)
        return sum(self._slots.values())

    def _look(self) -> Iterator[Event]:
        """See which workers are there, every now and then."""
        now = time.monotonic()
        if now - self._looked < (_LOOK if any(self._slots.values()) else _SOON):
            return
        self._looked, self._slots = now, self._cluster.slots()
        able = {address for address, slots in self._slots.items() if slots}
        lost, self.workers = self.workers - able, self.workers | able
        yield from map(WorkerLost, lost - self.lost)
        self.lost |= lost
        if able - self.aside.keys():
            self._seen = now
        elif now - self._seen > self._patience or (self._slots and not self.workers):
            raise self._none_left()
        self._take_back()

    def _able(self) -> dict[str, int]:
        """What the workers that can bake take at once. Raises the error of one that cannot where
        none is left, and none has gone that may return."""
        able = {one: n for one, n in self._slots.items() if n and one not in self.aside}
        if self.aside and not able and not self.lost - self.aside.keys():
            raise self._none_left()
        return able

    def _none_left(self) -> RhytidError:
        """Why the last worker cannot bake, or that there is none."""
        reasons = [*self.aside.values()]
        return reasons[-1] if reasons else no_worker_error(self._cluster.where, len(self._slots))

    def _take_back(self) -> None:
        """Give chunks anew whose workers have all left: Dask would wait for their return."""
        able = self._able().keys()
        for future, given in [*self._running.items()]:
            if given.to is not None and given.to.isdisjoint(able):
                del self._running[future]
                self._cluster.client.cancel([future], force=True)
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
        able = self._able()
        to = frozenset(able) if self.aside else None
        while self._waiting and len(self._running) < sum(able.values()):
            chunk = self._waiting.popleft()
            future = self._submitted(chunk, to)
            self._running[future] = Given(chunk, self._frames_of(chunk), to)
            future.add_done_callback(self._heard.put)

    def _submitted(self, chunk: Chunk, to: frozenset[str] | None) -> Future[Any]:
        from rhytid.farm.dask_worker import bake_chunk

        return self._cluster.client.submit(
            bake_chunk,
            self._name,
            self._maker,
            chunk,
            key=f"{self._name}-{uuid4().hex[:12]}",
            pure=False,
            retries=RETRIES,
            resources={RESOURCE: 1},
            workers=None if to is None else [*to],
        )

    def _hear(self, event: tuple[float, dict[str, str]]) -> None:
        """What a worker tells, to which Dask adds its address; on a thread of the client."""
        self._heard.put(event[1])

    def _frame(self, chunk: str, frame: str, worker: str) -> Iterator[Event]:
        self.took.add(worker)
        if frame not in self._frames[chunk]:
            self._frames[chunk].add(frame)
            yield FrameDone(frame, worker)

    def _ended(self, future: Future[Any]) -> Iterator[Event]:
        from distributed import CancelledError, KilledWorker, TimeoutError

        given = self._running.pop(future, None)
        if given is None:  # it was taken back
            return
        chunk = given.chunk
        try:
            report = future.result(timeout=_FETCH)
        except KilledWorker as error:
            # Frames that are there are not drawn again: it goes on as long as some are added.
            if self._frames_of(chunk) == given.before:
                raise _deadly(chunk, error.last_worker.address) from error
            self._waiting.appendleft(chunk)
            return
        except CancelledError as error:
            where = self._cluster.where
            message = f"the scheduler {where} has ended, or has dropped frames {chunk.text}"
            raise FarmError(message) from error
        except TimeoutError:  # its worker is gone: the files are there, so this is quick
            self._cluster.client.cancel([future], force=True)
            self._waiting.appendleft(chunk)
            return
        except RhytidError:
            raise
        except Exception as error:  # of Dask, about a process without what a task needs
            where = f"the scheduler {self._cluster.where}"
            where = where if _UNREADABLE in str(error) else f"a worker of {self._cluster.where}"
            message = f"{where} cannot read a task, {type(error).__name__}: {error}: {_NEEDED}"
            raise FarmError(message) from error
        if isinstance(report, Unable):
            self._waiting.appendleft(chunk)
            if report.worker not in self.aside:
                self.aside[report.worker] = report.error
                yield report
            return
        if isinstance(report, Failure):
            raise report.error
        yield ChunkDone(chunk, report)

    def _end(self, wait: bool) -> None:
        """Have the workers that took chunks close their sessions."""
        from rhytid.farm.dask_worker import end_run

        there = [address for address, slots in self._slots.items() if slots]
        with suppress(Exception):  # the cluster may be gone
            self._cluster.client.run(
                end_run, self._name, workers=there, wait=wait, on_error="ignore"
            )


def _deadly(chunk: Chunk, last: str) -> FarmError:
    return FarmError(f"frames {chunk.text}: several workers ended at them, the last was {last}")
