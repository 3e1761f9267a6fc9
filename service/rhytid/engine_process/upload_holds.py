"""What the server counts of frames that came with uploads, while the process still stores them."""

from __future__ import annotations

import itertools
import threading

from rhytid.engine.byte_budget import ByteBudget, Hold


class UploadHolds:
    """The bytes of frames that came with uploads, until the job that stores them has ended."""

    def __init__(self, memory: ByteBudget) -> None:
        self._memory = memory
        self._lock = threading.Lock()
        self._tokens = itertools.count(1)
        self._holds: dict[int, Hold] = {}
        self._sent: dict[int, object] = {}

    def take(self, nbytes: int, counted: Hold | None) -> int:
        """Hold so many bytes, as far as `counted` has any out of it; the token of the hold. Raises
        HostBusyError and HostMemoryError."""
        hold = self._memory.hold("jobs") if counted is None else counted.split("jobs", nbytes)
        try:
            hold.grow(nbytes - hold.nbytes)
        except BaseException:
            hold.release()
            raise
        with self._lock:
            token = next(self._tokens)
            self._holds[token] = hold
        return token

    def sent(self, token: int, process: object) -> None:
        """The frames went to a process."""
        with self._lock:
            self._sent[token] = process

    def release(self, token: int) -> None:
        """The job has ended."""
        with self._lock:
            self._sent.pop(token, None)
            hold = self._holds.pop(token, None)
        if hold is not None:
            hold.release()

    def release_of(self, process: object) -> None:
        """A process has ended, and with it all of its jobs."""
        with self._lock:
            tokens = [token for token, to in self._sent.items() if to is process]
        for token in tokens:
            self.release(token)
