"""What the server counts of frames that came with uploads, while the process still stores them."""

from __future__ import annotations

import threading

from rhytid.engine.byte_budget import ByteBudget, Hold


class UploadHolds:
    """The bytes of frames that came with uploads, until the job that stores them has ended."""

    def __init__(self, memory: ByteBudget) -> None:
        self._memory = memory
        self._lock = threading.Lock()
        self._holds: dict[int, Hold] = {}
        self._sent: dict[int, object] = {}

    def take(self, number: int, nbytes: int, counted: Hold | None) -> None:
        """Hold so many bytes for the call of that number, as far as `counted` has any out of it.
        Raises HostBusyError and HostMemoryError."""
        hold = self._memory.hold("jobs") if counted is None else counted.split("jobs", nbytes)
        try:
            hold.grow(nbytes - hold.nbytes)
        except BaseException:
            hold.release()
            raise
        with self._lock:
            self._holds[number] = hold

    def sent(self, number: int, process: object) -> None:
        """The frames went to a process."""
        with self._lock:
            self._sent[number] = process

    def release(self, number: int) -> None:
        """The job has ended."""
        with self._lock:
            self._sent.pop(number, None)
            hold = self._holds.pop(number, None)
        if hold is not None:
            hold.release()

    def release_of(self, process: object) -> None:
        """A process has ended, and with it all of its jobs."""
        with self._lock:
            numbers = [number for number, to in self._sent.items() if to is process]
        for number in numbers:
            self.release(number)
