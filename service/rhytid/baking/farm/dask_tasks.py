"""Chunks as tasks of a Dask scheduler."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any
from uuid import uuid4

from rhytid import __version__
from rhytid.baking.farm.bake_session import WorkerJob, packed
from rhytid.baking.farm.chunks import Chunk
from rhytid.baking.farm.dask_cluster import RESOURCE, Cluster
from rhytid.errors import FarmError, RhytidError

if TYPE_CHECKING:
    from distributed import Future

# How often a chunk is tried again after an error that may pass.
RETRIES = 2
# Seconds that workers have to close what they hold, and to hear of an end by an error.
_FAREWELL, _SENT = 5.0, 0.5
# Seconds in which a report has to come.
_FETCH = 30.0
# Of what Dask says where a module is missing at the scheduler.
_UNREADABLE = "deserialization of the task graph"
_NEEDED = f"scheduler and workers need rhytid {__version__} with the extra dask"


@dataclass(frozen=True)
class ChunkKilled:
    """Several workers in turn ended at a chunk.

    last: address of the last one.  error: as Dask reports it.
    """

    last: str
    error: Exception


@dataclass(frozen=True)
class ReportLost:
    """A chunk was baked, but its report was lost with the worker."""


class DaskTasks:
    """The tasks of one run.

    events: frames that workers report, and tasks that have ended, in this order of time.
    """

    def __init__(self, cluster: Cluster, job: WorkerJob) -> None:
        self._cluster, self._job = cluster, packed(job)
        self._name = f"rhytid-bake-{uuid4().hex[:12]}"
        self.events: SimpleQueue[dict[str, Any] | Future[Any]] = SimpleQueue()

    def listen(self) -> None:
        """Begin to receive events of workers."""
        self._cluster.client.subscribe_topic(self._name, self._hear)

    def submit(self, chunk: Chunk, to: Iterable[str] | None) -> Future[Any]:
        """Submit a chunk.  to: addresses of the workers that may take it; None for any."""
        from rhytid.baking.farm.dask_worker import bake_chunk

        future = self._cluster.client.submit(
            bake_chunk,
            self._name,
            self._job,
            chunk,
            key=f"{self._name}-{uuid4().hex[:12]}",
            pure=False,
            retries=RETRIES,
            resources={RESOURCE: 1},
            workers=None if to is None else [*to],
        )
        future.add_done_callback(self.events.put)
        return future

    def drop(self, futures: Sequence[Future[Any]]) -> None:
        """Cancel tasks."""
        if futures:
            self._cluster.client.cancel(futures, force=True)

    def report(self, future: Future[Any], chunk: Chunk) -> Any:
        """The result of a task that has ended, ChunkKilled or ReportLost. Raises FarmError where
        the cluster does not work, and the error of the last try where the chunk failed."""
        from distributed import CancelledError, KilledWorker, TimeoutError

        try:
            return future.result(timeout=_FETCH)
        except KilledWorker as error:
            return ChunkKilled(error.last_worker.address, error)
        except TimeoutError:
            self.drop([future])
            return ReportLost()
        except CancelledError as error:
            where = self._cluster.where
            message = f"the scheduler {where} has ended, or has dropped frames {chunk.text}"
            raise FarmError(message) from error
        except RhytidError:
            raise
        except Exception as error:  # of Dask, about a process without what a task needs
            where = f"the scheduler {self._cluster.where}"
            where = where if _UNREADABLE in str(error) else f"a worker of {self._cluster.where}"
            message = f"{where} cannot read a task, {type(error).__name__}: {error}: {_NEEDED}"
            raise FarmError(message) from error

    def end(self, workers: Sequence[str], *, failed: bool) -> None:
        """Close the sessions of these workers. After an error there is no wait until they are
        closed."""
        self._cluster.client.unsubscribe_topic(self._name)
        # The cluster may be gone: then there is no answer.
        farewell = threading.Thread(target=self._end, args=(workers, not failed), daemon=True)
        farewell.start()
        farewell.join(_SENT if failed else _FAREWELL)

    def _end(self, workers: Sequence[str], wait: bool) -> None:
        from rhytid.baking.farm.dask_worker import end_run

        with suppress(Exception):  # the cluster may be gone
            self._cluster.client.run(
                end_run, self._name, workers=workers, wait=wait, on_error="ignore"
            )

    def _hear(self, event: tuple[float, dict[str, Any]]) -> None:
        """Receive an event of a worker, to which Dask adds its address. Runs on a thread of the
        client."""
        self.events.put(event[1])
