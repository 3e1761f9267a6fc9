"""The process of a device: an engine that answers calls over lines, until the server is gone."""

from __future__ import annotations

import ctypes
import faulthandler
import logging
import mmap
import os
import select
import signal
import socket
import sys
import threading
from contextlib import nullcontext, suppress
from functools import partial
from typing import Any, NoReturn

from rhytid.device import figures
from rhytid.device.figures import Figures, spans_of_request
from rhytid.device.watch import SIZE, Purpose, Report, report_to, used_for
from rhytid.engine import wanted
from rhytid.engine.callers import caller
from rhytid.engine.engine import Engine
from rhytid.engine.worker import drawn_live
from rhytid.engine_process import heaps
from rhytid.engine_process.calls import Calls
from rhytid.engine_process.control import (
    Close,
    Control,
    FramesStored,
    OpenLine,
    Start,
    Started,
)
from rhytid.engine_process.packing import Packed, pack, unpack
from rhytid.engine_process.shared import Bytes, mapped, private
from rhytid.engine_process.wire import Message, close_all, receive, send
from rhytid.errors import RhytidError
from rhytid.support.logs import log_to_stderr, request_id

# Of prctl: the signal that comes when the parent ends.
_PARENT_DIES = 1
_log = logging.getLogger(__name__)


def main(control: int, report: int, figures_memory: int, parent: int) -> NoReturn:
    """Run the process.  control, report, figures_memory: descriptors of the control socket, and
    of the memory for the report and for figures.  parent: the process that started this one."""
    _end_with(parent)
    heaps.keep_few()
    for descriptor in (control, report, figures_memory):
        os.set_inheritable(descriptor, False)
    # The server ends this process: signals of a terminal or a service manager are for the server.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    with suppress(OSError, ValueError):  # without stderr
        faulthandler.enable()
    server = Control(socket.socket(fileno=control))
    found = server.receive()
    if found is None:
        os._exit(0)
    start: Start = found[0]
    _log_as(start)
    memory = mapped(report, mmap.PAGESIZE)
    report_to(Report(memory.data[:SIZE]), start.settings.launch_seconds)
    counters = Figures(mapped(figures_memory, figures.SIZE).data)
    _Process(server).run(start, counters)


class _Process:
    def __init__(self, control: Control) -> None:
        self._control = control
        self._closing = threading.Event()
        self._calls: Calls | None = None

    def run(self, start: Start, counters: Figures) -> NoReturn:
        threading.Thread(target=self._listen, name="rhytid-control", daemon=True).start()
        try:
            engine = Engine(start.settings, start.refused, counters, start.assets)
        except Exception as error:  # noqa: BLE001 the server raises it
            if not isinstance(error, RhytidError | OSError):
                _log.exception("the engine does not start")
            self._notify(Started(_sendable(error)))
            _exit(1)
        self._calls = Calls(engine, lambda token: self._notify(FramesStored(token)))
        self._notify(Started(None))
        heaps.keep_giving_back(self._closing)
        self._closing.wait()
        engine.close()
        _exit(0)

    def _listen(self) -> None:
        """Handle messages of the server; end where it is gone."""
        while (received := self._control.receive()) is not None:
            message, descriptors = received
            if isinstance(message, OpenLine):
                line = socket.socket(fileno=descriptors[0])
                threading.Thread(target=self._answer, args=(line,), daemon=True).start()
            elif isinstance(message, Close):
                self._closing.set()
        os._exit(0)

    def _notify(self, message: Any) -> None:
        with suppress(OSError):  # `_listen` finds that the server is gone
            self._control.send(message)

    def _answer(self, line: socket.socket) -> None:
        """Answer the calls of one line until it is closed."""
        room: Bytes | None = None
        with line, suppress(ConnectionError):
            while (message := receive(line, descriptors=True)) is not None:
                memory, room = _memory(message, room)
                with wanted.unless(partial(_hung_up, line)):
                    answer = self._performed(message, memory)
                del message, memory
                if answer.nbytes > (0 if room is None else len(room)):
                    send(line, Message(room=answer.nbytes))
                    if (offer := receive(line, descriptors=True)) is None:
                        return
                    _, room = _memory(offer, room)
                if room is not None and answer.sizes:
                    answer.write(room)
                send(line, Message(answer.body, answer.sizes))
                del answer

    def _performed(self, message: Message, memory: Bytes | None) -> Packed:
        assert self._calls is not None  # lines are opened once the engine is there
        call = unpack(message.body, message.sizes, memory)
        request_id.set(call.request_id)
        caller.set(call.caller)
        kept = spans_of_request() if call.traced else nullcontext(())
        with kept as spans:
            try:
                with used_for(Purpose(request=call.number)), drawn_live(call.live):
                    return pack((True, self._calls.perform(call), spans))
            except RhytidError as error:
                return pack((False, error, spans))
            except Exception as error:  # noqa: BLE001 the server raises it
                _log.exception("%s failed", call.name)
                return pack((False, _sendable(error), spans))


def _hung_up(line: socket.socket) -> bool:
    """Whether the server has closed a line: nobody waits for the answer."""
    poll = select.poll()
    poll.register(line, 0)
    return bool(poll.poll(0))


def _memory(message: Message, room: Bytes | None) -> tuple[Bytes | None, Bytes | None]:
    """The memory that the arrays of a message lie in, and that for the answer."""
    descriptors = list(message.descriptors)
    try:
        memory = private(descriptors[0], message.shared) if message.shared else None
        return memory, mapped(descriptors[-1], message.room) if message.room else room
    finally:
        close_all(descriptors)


def _sendable(error: Exception) -> Exception:
    """The error itself where the server knows its class, else one with its name and words."""
    if isinstance(error, RhytidError | OSError):
        return error
    return RuntimeError(f"{type(error).__name__}: {error}")


def _end_with(parent: int) -> None:
    """Have the system end this process where the thread that started it ends."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PARENT_DIES, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(0)


def _log_as(start: Start) -> None:
    if start.log_level:
        log_to_stderr(start.settings.log_format, start.log_level, "device")


def _exit(status: int) -> NoReturn:
    """End at once: drivers may hang where Python lets go of them."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError, AttributeError):
            stream.flush()
    os._exit(status)
