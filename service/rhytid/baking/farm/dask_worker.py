"""The part of a bake that runs in the workers of a Dask cluster.

Nothing is registered at the scheduler. A client that is killed leaves one session per worker, which
closes itself.
"""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from distributed import Worker, get_worker

from rhytid.baking.farm.chunks import (
    FINAL,
    UNABLE,
    Chunk,
    ChunkFailed,
    WorkerUnable,
    of_worker,
)  # fmt: skip
from rhytid.errors import CancelledError

if TYPE_CHECKING:
    from rhytid.baking.farm.bake_session import BakeSession

# Seconds without a chunk after which a session is closed; the client may have died.
IDLE = 600.0


class HeldSession:
    """The session of one run on one worker, opened for its first chunk.

    name: of the run, and of the topic of its events.  idle: seconds without a chunk after which the
    session is closed; the next chunk opens another.
    """

    def __init__(self, name: str, worker: Worker, idle: float = IDLE) -> None:
        self._name, self._worker, self._idle = name, worker, idle
        self._session: BakeSession | None = None
        self._unable: WorkerUnable | None = None
        self._lock, self._stopped = threading.Lock(), threading.Event()
        self._watcher: threading.Timer | None = None

    def bake(self, job: bytes, chunk: Chunk) -> Any:
        """Bake a chunk. Returns its report, ChunkFailed or WorkerUnable.

        job: a packed WorkerJob. Other errors close the session and are raised with the name of the
        worker, so that Dask tries the chunk again.
        """
        with self._lock:
            self._rest()
            try:
                session = self._opened(job)
                if isinstance(session, WorkerUnable):
                    return session
                return session.bake(chunk, partial(self._done, chunk))
            except UNABLE as error:
                return self._exclude(error)
            except FINAL as error:
                return ChunkFailed(error)
            except Exception as error:
                self._drop()
                raise of_worker(error, self._worker.address) from error
            except BaseException:
                self._drop()
                raise
            finally:
                self._watch()

    def stop(self) -> None:
        """Have the running chunk end after the present frame, and begin no other."""
        self._stopped.set()

    def close(self) -> None:
        """Close the session, once the chunk at work has ended."""
        with self._lock:
            self._rest()
            self._drop()

    def _opened(self, job: bytes) -> BakeSession | WorkerUnable:
        """The session, or why there can be none. A failure is remembered."""
        if self._stopped.is_set():
            raise CancelledError("the bake has ended")
        if self._session is None and self._unable is None:
            try:
                # Imported here: where a package is missing, this worker alone cannot bake.
                from rhytid.baking.farm.bake_session import unpacked

                folder = Path(self._worker.local_directory) / self._name
                self._session = unpacked(job).session(folder)
            except Exception as error:  # noqa: BLE001 what it lacks may show in any way
                return self._exclude(error)
        found = self._unable or self._session
        assert found is not None
        return found

    def _exclude(self, error: Exception) -> WorkerUnable:
        self._drop()
        address = self._worker.address
        self._unable = WorkerUnable(address, of_worker(error, address))
        return self._unable

    def _done(self, chunk: Chunk, label: str, worked: bool) -> None:
        told = {"chunk": chunk.text, "frame": label, "worked": worked}
        self._worker.log_event(self._name, told)
        if self._stopped.is_set():
            raise CancelledError("the bake has ended")

    def _watch(self) -> None:
        """Start the timer that closes the session. There is one at a time."""
        self._watcher = threading.Timer(self._idle, self._alone)
        self._watcher.daemon = True
        self._watcher.start()

    def _rest(self) -> None:
        """Stop the timer."""
        if self._watcher is not None:
            self._watcher.cancel()
            self._watcher = None

    def _alone(self) -> None:
        """Close the session, unless a chunk has come meanwhile."""
        with self._lock:
            if self._watcher is threading.current_thread():
                self._drop()

    def _drop(self) -> None:
        session, self._session = self._session, None
        if session is not None:
            session.close()


# By the run and the worker: several workers may be in one process.
_held: dict[tuple[str, str], HeldSession] = {}
# Runs whose chunks may still arrive, the latest.
_over: deque[str] = deque(maxlen=1000)
_guard = threading.Lock()


def bake_chunk(name: str, job: bytes, chunk: Chunk) -> Any:
    """The task of one chunk: bakes it with the session of the run on this worker."""
    worker = get_worker()
    with _guard:
        if name in _over:
            raise CancelledError("the bake has ended")
        held = _held.setdefault((name, worker.address), HeldSession(name, worker))
    return held.bake(job, chunk)


async def end_run(name: str, dask_worker: Worker) -> None:
    """End a run on a worker: its session closes after the present frame. The event loop of the
    worker does not block meanwhile. Dask passes the worker by the name `dask_worker`."""
    with _guard:
        _over.append(name)
        held = _held.pop((name, dask_worker.address), None)
    if held is not None:
        held.stop()
        await asyncio.to_thread(held.close)
