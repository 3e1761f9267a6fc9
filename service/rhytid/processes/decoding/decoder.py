"""Decodes uploads: what is light on the caller's thread, all else in a process with limits."""

from __future__ import annotations

import logging
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from multiprocessing import Pipe
from typing import Any

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.scan import ScanSettings
from rhytid.engine.byte_budget import Hold
from rhytid.engine.messages import NewAsset
from rhytid.errors import BusyError, CancelledError, InputError, LimitError, RhytidError
from rhytid.processes.decoding import limits
from rhytid.processes.decoding.reading import Files, all_files, read_asset
from rhytid.processes.decoding.words import (
    Begun,
    Broken,
    Granted,
    Job,
    Piece,
    Promised,
    TooLarge,
    read_word,
    written,
)
from rhytid.processes.interpreter import possible
from rhytid.processes.packing import handed_on
from rhytid.processes.wire import Message, close_all, readable, receive, send

Gone = Callable[[], bool]
logger = logging.getLogger(__name__)
# Uploads that wait for their turn at most, and seconds that each does.
_WAITING, _PATIENCE = 16, 60.0
_LOOK = 0.1
_CODE = (
    "import sys; sys.path[:] = sys.argv[1].split(sys.argv[2]); "
    "from rhytid.processes.decoding.child import main; main(*map(int, sys.argv[3:]))"
)


class Decoder:
    """Decodes uploads, AT_ONCE of those that are not light at a time, one of those that become
    large."""

    def __init__(self) -> None:
        self._turns = threading.BoundedSemaphore(limits.AT_ONCE)
        self._alone = threading.BoundedSemaphore(1)
        self._places = threading.BoundedSemaphore(limits.AT_ONCE + _WAITING)

    def read(
        self,
        parts: Files,
        settings: AssetSettings,
        scan: ScanSettings,
        *,
        force: bool,
        hold: Hold,
        gone: Gone,
        file: Callable[[], int],
    ) -> NewAsset:
        """A new asset of what was sent.

        scan: how a scan is read.  file: the descriptor of the file of the upload.  hold: what it
        takes, afterwards as much as the caller needs to use it.  gone: whether nobody waits for it
        any more. Raises what `read_asset` does, LimitError where it takes more memory or time than
        it may, InputError where it ends the process, BusyError, CancelledError and what `Hold.grow`
        does.
        """
        if limits.is_light(parts) or not possible():
            promised = limits.promised(parts, settings.resolution)
            sent = limits.sent_bytes(parts) + promised
            hold.grow(min(limits.ROOM_A_PROMISED * sent, hold.limit))
            return read_asset(parts, settings, scan, force=force)
        with self._turn(gone):
            hold.grow(min(limits.room(parts), hold.limit))
            seconds = limits.seconds(parts)
            job = Job(_pieces(parts), settings, scan, force, hold.nbytes, seconds)
            alone = _taken(self._alone, gone)
            with ExitStack() as held, closing(_Process(job, file())) as process:
                return process.result(hold, gone, lambda: held.enter_context(alone))

    @contextmanager
    def _turn(self, gone: Gone) -> Iterator[None]:
        if not self._places.acquire(blocking=False):
            raise BusyError(f"{_WAITING} uploads wait to be decoded already")
        try:
            with _taken(self._turns, gone):
                yield
        finally:
            self._places.release()


@contextmanager
def _taken(turns: threading.BoundedSemaphore, gone: Gone) -> Iterator[None]:
    """A turn within the block; waits for it."""
    until = time.monotonic() + _PATIENCE
    while not turns.acquire(timeout=_LOOK):
        if gone():
            raise CancelledError("the client has closed the connection")
        if time.monotonic() > until:
            raise BusyError(f"other uploads were decoded for {_PATIENCE:g} seconds")
    try:
        yield
    finally:
        turns.release()


class _Process:
    """One process, from its start to its end."""

    def __init__(self, job: Job, file: int) -> None:
        self._at = ""
        self._seconds = job.seconds
        self._until = time.monotonic() + limits.CLOCK * job.seconds
        self._line, far = Pipe()
        with far:
            numbers = [str(number) for number in (far.fileno(), file, os.getpid())]
            code = [sys.executable, "-c", _CODE, os.pathsep.join(sys.path), os.pathsep]
            self._process = subprocess.Popen(
                [*code, *numbers],
                stdin=subprocess.DEVNULL,
                pass_fds=(far.fileno(), file),
                start_new_session=True,
            )
        self._tell(job)

    def result(self, hold: Hold, gone: Gone, alone: Callable[[], None]) -> NewAsset:
        """What it makes of the upload, as `Decoder.read` says.

        alone: waits until no other upload that becomes large is decoded.
        """
        while True:
            word = self._next(gone)
            if isinstance(word, NewAsset):
                hold.resize(min(hold.nbytes, limits.ROOM_A_PROMISED * self._nbytes))
                return word
            if isinstance(word, Promised):
                if word.nbytes >= limits.LARGE:
                    alone()
                    self._until = time.monotonic() + limits.CLOCK * self._seconds
                more = min(limits.ROOM_A_PROMISED * word.nbytes, hold.limit - hold.nbytes)
                hold.grow(more)
                self._tell(Granted(more))
            elif isinstance(word, Begun):
                self._at = word.filename
            else:
                raise self._error(word)

    def _error(self, word: Any) -> Exception:
        if isinstance(word, RhytidError):
            return word
        if isinstance(word, TooLarge):
            limit = f"{word.room} bytes of memory"
            return LimitError(f"{self._at}: decoding it takes more than {limit}, its limit")
        trace = word.trace if isinstance(word, Broken) else repr(word)
        return RuntimeError(f"an upload cannot be decoded: {trace}")

    def close(self) -> None:
        """End it, wherever it is."""
        self._process.kill()
        self._process.wait()
        self._line.close()

    def _next(self, gone: Gone) -> Any:
        while not readable(self._line, _LOOK):
            if gone():
                raise CancelledError("the client has closed the connection")
            if time.monotonic() > self._until:
                limit = f"{limits.CLOCK * self._seconds} seconds"
                raise LimitError(f"{self._at}: decoding it takes more than {limit}, its limit")
        found = receive(self._line)
        if found is None:
            raise self._ended()
        try:
            self._nbytes = found.shared
            memory = handed_on(found.descriptors[0], found.shared) if found.descriptors else None
            return read_word(found.body, found.places, memory)
        finally:
            close_all(found.descriptors)

    def _ended(self) -> RhytidError:
        """Why it has told nothing more."""
        status = self._process.wait()
        if -status == getattr(signal, "SIGXCPU", None):
            limit = f"{self._seconds} seconds of processor time"
            return LimitError(f"{self._at}: decoding it takes more than {limit}, its limit")
        name = signal.Signals(-status).name if status < 0 else f"status {status}"
        logger.warning("decoding %r ended by %s", self._at, name)
        return InputError(f"{self._at}: damaged: it ends its decoder ({name})")

    def _tell(self, word: Any) -> None:
        with suppress(OSError):  # it has ended, which `_next` finds
            send(self._line, Message(written(word)))


def _pieces(parts: Files) -> tuple[Piece, ...]:
    return tuple(Piece(f.name, f.filename, f.start, f.size) for f in all_files(parts))
