"""Messages between a server and a process that it started, over a Unix socket.

A message is a pickle, the places of the arrays that lie apart, and descriptors of files. On a line
one side asks and the other answers; on the control connection both send messages.
"""

from __future__ import annotations

import os
import pickle
import select
import struct
import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from multiprocessing.reduction import recv_handle, send_handle
from typing import Any

from rhytid.engine.messages import Refusal
from rhytid.processes.packing import Places, pack
from rhytid.support.settings import ServiceSettings

# Number of arrays, of descriptors, bytes of shared memory with the arrays, bytes of room for an
# answer.
_HEAD = struct.Struct("<IIQQ")
_PLACE = struct.Struct("<QQ")
# Descriptors of a message, at most: of the memory with its arrays, and of a file.
_MOST_DESCRIPTORS = 2


@dataclass(frozen=True)
class Message:
    """One message as it is on the wire.

    places: of the arrays.  shared: bytes of the memory with the arrays, whose descriptor is the
    first; 0 where they lie in memory of the line.  room: bytes that an answer needs in memory of
    the line and does not have; of the message after it, bytes of that memory.
    """

    body: bytes = b""
    places: Places = ()
    shared: int = 0
    room: int = 0
    descriptors: tuple[int, ...] = ()


def send(line: Connection, message: Message) -> None:
    """Send a message; its descriptors stay the caller's. Raises OSError on a broken line."""
    places, files = message.places, message.descriptors
    head = _HEAD.pack(len(places), len(files), message.shared, message.room)
    line.send_bytes(b"".join((head, *(_PLACE.pack(*place) for place in places), message.body)))
    for descriptor in files:
        send_handle(line, descriptor, None)


def receive(line: Connection) -> Message | None:
    """The next message, whose descriptors are the caller's to close; None where the other side is
    gone, or sends more descriptors than a message has."""
    files: list[int] = []
    try:
        data = line.recv_bytes()
        arrays, count, shared, room = _HEAD.unpack_from(data)
        if count > _MOST_DESCRIPTORS:  # a decoder has read strangers' bytes
            return None
        for _ in range(count):
            files.append(recv_handle(line))
            os.set_inheritable(files[-1], False)
    except (EOFError, OSError, RuntimeError):  # the last where descriptors were lost
        close_all(files)
        return None
    end = _HEAD.size + _PLACE.size * arrays
    places = tuple(_PLACE.iter_unpack(data[_HEAD.size : end]))
    return Message(data[end:], places, shared, room, tuple(files))


def readable(line: Connection, seconds: float) -> bool:
    """Whether something comes, or the end, in that time. A fifth of what `Connection.poll` takes,
    and for each tile it is asked."""
    poll = select.poll()
    poll.register(line, select.POLLIN)
    return bool(poll.poll(1000 * seconds))


def close_all(descriptors: Sequence[int]) -> None:
    """Close descriptors."""
    for descriptor in descriptors:
        os.close(descriptor)


@dataclass(frozen=True)
class Start:
    """The first message to a process, with the descriptors of the memory for its report and for the
    counts of what it changes, and of that for its figures.

    refused: ids of assets that are not to be built, and why.  log_level: of what it logs; 0 = only
    what Python writes by itself, warnings.  assets: those of the store that are this device's;
    None = all.  builds: the jobs that built assets when the process before ended, by asset.
    """

    settings: ServiceSettings
    refused: dict[str, Refusal]
    log_level: int
    assets: frozenset[str] | None = None
    builds: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class OpenLine:
    """A line, whose other end comes along."""


@dataclass(frozen=True)
class Close:
    """The process shall end."""


@dataclass(frozen=True)
class Started:
    """The engine is there, or else the error that it ended with."""

    error: Exception | None


@dataclass(frozen=True)
class FramesStored:
    """The job that stored the frames of an upload has ended.  number: of the call of the upload."""

    number: int


@dataclass(frozen=True)
class BuildChanged:
    """A job that builds an asset has begun or ended. Sent before anybody has its id."""

    asset: str
    job: str
    ended: bool


class Control:
    """The connection between both beside calls. Any thread may send, one receives."""

    def __init__(self, line: Connection) -> None:
        self.line = line
        self._sending = threading.Lock()

    def send(self, message: Any, *descriptors: int) -> None:
        """Send a message; raises OSError where it is gone."""
        with self._sending:
            send(self.line, Message(pack(message).body, descriptors=descriptors))

    def receive(self) -> tuple[Any, tuple[int, ...]] | None:
        """The next message of the other side, and descriptors, which are the caller's to close;
        None where it is gone."""
        found = receive(self.line)
        return None if found is None else (pickle.loads(found.body), found.descriptors)

    def close(self) -> None:
        """End it, between two messages: while a connection is closed it still has the number that
        the system may give to the next one."""
        with self._sending:
            self.line.close()
