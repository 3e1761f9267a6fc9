"""Messages between a server and the process of its device, beside calls."""

from __future__ import annotations

import pickle
import socket
import threading
from dataclasses import dataclass
from typing import Any

from rhytid.engine.messages import Refusal
from rhytid.engine_process.packing import pack
from rhytid.engine_process.wire import Message, receive, send
from rhytid.support.settings import ServiceSettings


@dataclass(frozen=True)
class Start:
    """The first message to a process.

    refused: ids of assets that are not to be built, and why.  log_level: of what it logs; 0 = only
    what Python writes by itself, warnings.  assets: those of the store that are this device's;
    None = all.
    """

    settings: ServiceSettings
    refused: dict[str, Refusal]
    log_level: int
    assets: frozenset[str] | None = None


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
    """The job that stored the frames of an upload has ended; `token` is that of the upload."""

    token: int


class Control:
    """The socket between the two. Any thread may send, one receives."""

    def __init__(self, line: socket.socket) -> None:
        self.line = line
        self._sending = threading.Lock()

    def send(self, message: Any, *descriptors: int) -> None:
        """Send a message; raises OSError where it is gone."""
        with self._sending:
            send(self.line, Message(pack(message).body, descriptors=descriptors))

    def receive(self) -> tuple[Any, tuple[int, ...]] | None:
        """The next message of the other side, and descriptors, which are the caller's to close;
        None where it is gone."""
        found = receive(self.line, descriptors=True)
        return None if found is None else (pickle.loads(found.body), found.descriptors)
