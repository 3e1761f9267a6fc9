"""The process that decodes one upload and ends; `decoder` starts it.

It limits its own memory and processor time before it reads a byte of what was sent. This is no
jail: what is kept from the server is a crash, a loop without end and a want of memory.
"""

from __future__ import annotations

import ctypes
import mmap
import os
import signal
import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from rhytid.errors import RhytidError
from rhytid.formats import exr
from rhytid.processes.decoding.limits import promised
from rhytid.processes.decoding.reading import Files, read_asset
from rhytid.processes.decoding.words import (
    Begun,
    Broken,
    Granted,
    Job,
    Promised,
    TooLarge,
    read_word,
    written,
)
from rhytid.processes.packing import pack, shared_file
from rhytid.processes.wire import Message, receive, send

# Of prctl: the signal that comes when the parent ends.
_PARENT_DIES = 1


@dataclass(frozen=True)
class Part:
    """A file that was sent, in the file of the upload.  begun: is told when it is read."""

    name: str
    filename: str | None
    size: int
    start: int
    descriptor: int
    begun: Callable[[str], None]
    again: tuple[Part, ...] = ()

    @property
    def data(self) -> bytes:
        """Its bytes, read anew; raises EOFError where the file ends before them."""
        self.begun(self.filename or f"part {self.name}")
        parts, at = [], 0
        while at < self.size:  # one call reads 2 GiB at most
            parts.append(os.pread(self.descriptor, self.size - at, self.start + at))
            if not parts[-1]:
                raise EOFError(f"part {self.name} has {at} bytes in place of {self.size}")
            at += len(parts[-1])
        return parts[0] if len(parts) == 1 else b"".join(parts)


def main(control: int, file: int, parent: int) -> None:
    """Run the process.  control, file: descriptors of its socket and of the upload.  parent: the
    process that started this one."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PARENT_DIES, signal.SIGKILL)
        if os.getppid() != parent:
            os._exit(0)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    line = Connection(control)
    job: Job = _heard(line)
    memory = _Memory(job.room)
    _limit_seconds(job.seconds)
    try:
        _answer(line, _decoded(line, file, job, memory))
    except RhytidError as error:
        _tell(line, error)
    except MemoryError:
        _tell(line, TooLarge(memory.room))
    except Exception:  # noqa: BLE001 the server logs it
        _tell(line, Broken(traceback.format_exc(limit=20)))


def _decoded(line: Connection, file: int, job: Job, memory: _Memory) -> Any:
    def begun(name: str) -> None:
        _tell(line, Begun(name))

    exr.decode_here(begun)
    parts = _files(job, file, begun)
    if more := promised(parts, job.settings.resolution):
        _tell(line, Promised(more))
        granted: Granted = _heard(line)
        memory.add(granted.nbytes)
    return read_asset(parts, job.settings, job.scan, force=job.force)


def _files(job: Job, file: int, begun: Callable[[str], None]) -> Files:
    named: dict[str, list[Part]] = {}
    for p in job.pieces:
        named.setdefault(p.name, []).append(Part(p.name, p.filename, p.size, p.start, file, begun))
    return {
        name: Part(one.name, one.filename, one.size, one.start, file, begun, tuple(again))
        for name, (one, *again) in named.items()
    }


class _Memory:
    """The address space of this process, beyond what it has to begin with; on Linux only."""

    def __init__(self, room: int) -> None:
        self.room = room
        self._base = 0
        if sys.platform == "linux":
            self._base = int(Path("/proc/self/statm").read_text().split()[0]) * mmap.PAGESIZE
        self.add(0)

    def add(self, nbytes: int) -> None:
        """Allow so much more."""
        self.room += nbytes
        if sys.platform == "linux":
            import resource

            _, hard = resource.getrlimit(resource.RLIMIT_AS)
            most = self._base + self.room
            resource.setrlimit(resource.RLIMIT_AS, (most if hard < 0 else min(most, hard), hard))


def _limit_seconds(seconds: int) -> None:
    if sys.platform != "win32":
        import resource

        began = int(resource.getrusage(resource.RUSAGE_SELF).ru_utime) + 1
        resource.setrlimit(resource.RLIMIT_CPU, (began + seconds, began + seconds + 5))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # nor fill the disk as it crashes


def _heard(line: Connection) -> Any:
    found = receive(line)
    if found is None:  # the server has no more use for it
        os._exit(0)
    return read_word(found.body)


def _tell(line: Connection, word: Any) -> None:
    send(line, Message(written(word)))


def _answer(line: Connection, found: Any) -> None:
    packed = pack(found)
    if not packed.nbytes:
        send(line, Message(packed.body))
        return
    descriptor = shared_file(packed.nbytes)
    packed.write_file(descriptor)
    send(line, Message(packed.body, packed.places, packed.nbytes, 0, (descriptor,)))
