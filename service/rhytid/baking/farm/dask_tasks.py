"""Chunks as tasks of a Dask scheduler, and what becomes of them."""

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
class Killed:
    """Several workers ended at a chunk, in turn.

    last: the address of the last one.  error: what Dask says of it.
    """

    last: str
    error: Exception


@dataclass(frozen=True)
class Gone:
    """A chunk was baked, but its report went with the worker."""


class DaskTasks:
    """The tasks of one run.

    heard: what workers tell of frames, and the tasks that have ended, in the order in which it
    happens.
    """

    def __init__(self, cluster: Cluster, job: WorkerJob) -> None:
        self._cluster, self._job = cluster, packed(job)
        self._name = f"rhytid-bake-{uuid4().hex[:12]}"
        self.heard: SimpleQueue[dict[str, str] | Future[Any]] = SimpleQueue()

    def listen(self) -> None:
        """Begin to hear what workers tell."""
        self._cluster.client.subscribe_topic(self._name, self._hear)

    def submit(self, chunk: Chunk, to: Iterable[str] | None) -> Future[Any]:
        """Give out a chunk.  to: addresses of the workers that may take it; None = any."""
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
        future.add_done_callback(self.heard.put)
        return future

    def drop(self, futures: Sequence[Future[Any]]) -> None:
        """Take chunks back."""
        if futures:
            self._cluster.client.cancel(futures, force=True)

    def report(self, future: Future[Any], chunk: Chunk) -> Any:
        """What a task that has ended returned, Killed or Gone. Raises FarmError where the cluster
        does not work, and the error that the last try at the chunk raised."""
        from distributed import CancelledError, KilledWorker, TimeoutError

        try:
            return future.result(timeout=_FETCH)
        except KilledWorker as error:
            return Killed(error.last_worker.address, error)
        except TimeoutError:
            self.drop([future])
            return Gone()
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
        """Have these workers close their sessions. After an error nobody waits until they have."""
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

    def _hear(self, event: tuple[float, dict[str, str]]) -> None:
        """What a worker tells, to which Dask adds its address; on a thread of the client."""
        self.heard.put(event[1])
