"""The server's side of lines to the process of the device: each carries one call at a time."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from rhytid.engine import call_context
from rhytid.processes.packing import Bytes, Packed, mapped, shared_file, unpack
from rhytid.processes.wire import Message, close_all, readable, receive, send

# Bytes of room for answers that idle lines keep in all.
MOST_IDLE = 64 << 20
# Bytes of a call's arrays, at most, that are sent in the memory of its line: the other side copies
# them.
_IN_ROOM = 1 << 20
# Seconds between two looks whether somebody still waits for an answer.
_LOOK = 0.2


class LineBroken(Exception):
    """The process has ended, or was ended, before it answered."""


class Line:
    """A connection, and the shared memory that its answers are written to, and small arrays of
    calls before them: fresh memory takes longer than what is written to it."""

    def __init__(self, near: Connection) -> None:
        self._line = near
        self._room: Bytes | None = None

    @property
    def room(self) -> int:
        """Bytes of shared memory for answers."""
        return 0 if self._room is None else len(self._room)

    def ask(self, request: Packed, seconds: float | None) -> tuple[Any, Any]:
        """The answer, and what holds the shared memory that it lies in, None where it lies in none.

        seconds: to wait for it.

        Raises LineBroken, TimeoutError, and CancelledError where nobody waits for the answer.
        """
        try:
            self._send(request)
            self._wait(seconds)
            answer = receive(self._line)
            if answer is not None and answer.room:
                self._offer(answer.room)
                answer = receive(self._line)
        except ConnectionError as exc:
            raise LineBroken from exc
        if answer is None:
            raise LineBroken
        raw = None
        if self._room is not None and answer.places:
            # Over a memoryview: arrays of the answer hold the first array that has none below it.
            raw = np.frombuffer(self._room.data, np.uint8)
        return unpack(answer.body, answer.places, raw), raw

    def _wait(self, seconds: float | None) -> None:
        """Until something comes; raises CancelledError where nobody waits for it any more,
        TimeoutError where it takes longer than that."""
        if seconds is not None and not readable(self._line, seconds):
            raise TimeoutError
        while not readable(self._line, _LOOK):
            call_context.check_abandoned()

    def close(self) -> None:
        """End it; the process lets go of the shared memory."""
        self._line.close()

    def _send(self, request: Packed) -> None:
        nbytes, places, files = request.nbytes, request.places, request.files
        if not nbytes:
            send(self._line, Message(request.body, descriptors=files))
        elif (kept := request.kept_file()) is not None:
            memory, nbytes, places = kept
            send(self._line, Message(request.body, places, nbytes, 0, (memory, *files)))
        elif self._room is not None and nbytes <= min(self.room, _IN_ROOM):
            request.lend(self._room)
            send(self._line, Message(request.body, places, descriptors=files))
        else:
            memory = shared_file(nbytes)
            try:
                request.write(mapped(memory, nbytes))
                send(self._line, Message(request.body, places, nbytes, 0, (memory, *files)))
            finally:
                close_all([memory])

    def _offer(self, nbytes: int) -> None:
        descriptor = self._new_room(nbytes)
        try:
            send(self._line, Message(room=nbytes, descriptors=(descriptor,)))
        finally:
            close_all([descriptor])

    def _new_room(self, nbytes: int) -> int:
        descriptor = shared_file(nbytes)
        self._room = mapped(descriptor, nbytes)
        return descriptor


def _no_line() -> Line:
    raise LineBroken


class Lines:
    """Lines to one process: as many as there are calls at a time.

    A line whose answer lies in its shared memory is free again when the answer is forgotten.
    """

    def __init__(self, connect: Callable[[], Line]) -> None:
        self._connect = connect
        # Answers are forgotten wherever Python collects garbage, in the block of this lock too.
        self._lock = threading.RLock()
        self._free: list[Line] = []
        self._closed = False

    def ask(self, request: Packed, seconds: float | None = None) -> Any:
        """As `Line.ask`, on a line that is free; the answer alone."""
        line = self._take()
        try:
            answer, holds = line.ask(request, seconds)
        except BaseException:
            line.close()
            raise
        if holds is None:
            self._give_back(line)
        else:
            weakref.finalize(holds, self._give_back, line).atexit = False
        return answer

    def close(self) -> None:
        """Close every line that is free, and the others when they come free; no more are made."""
        with self._lock:
            free, self._free, self._closed = self._free, [], True
            # The process, which this belongs to, is forgotten without waiting for the collector.
            self._connect = _no_line
        for line in free:
            line.close()

    def _take(self) -> Line:
        with self._lock:
            if self._free:
                return self._free.pop()
        return self._connect()

    def _give_back(self, line: Line) -> None:
        with self._lock:
            idle = sum(free.room for free in self._free)
            kept = not self._closed and idle + line.room <= MOST_IDLE
            if kept:
                self._free.append(line)
        if not kept:
            line.close()
