"""The process of a device: an engine that answers calls over lines, until the server is gone."""

from __future__ import annotations

import ctypes
import faulthandler
import logging
import mmap
import os
import select
import signal
import sys
import threading
from contextlib import suppress
from functools import partial
from multiprocessing.connection import Connection
from typing import Any, NoReturn

from rhytid.device import figures
from rhytid.device.figures import Figures
from rhytid.device.watch import SIZE, Purpose, Report, report_to, used_for
from rhytid.engine import changes
from rhytid.engine.engine import Engine
from rhytid.engine.job import Job
from rhytid.engine.messages import AssetInfo
from rhytid.errors import NotFoundError, RhytidError
from rhytid.processes.device_process import SHARED
from rhytid.processes.envelope import Answer, Envelope, answered
from rhytid.processes.packing import Bytes, Packed, mapped, pack, private, unpack
from rhytid.processes.wire import (
    BuildChanged,
    Close,
    Control,
    FramesStored,
    Message,
    OpenLine,
    Start,
    Started,
    close_all,
    receive,
    send,
)
from rhytid.storage.lock import known_by
from rhytid.storage.snapshots import Snapshot
from rhytid.support.garbage import tidy_at_rest
from rhytid.support.heap import give_back_heap
from rhytid.support.logs import log_to_stderr

# Of prctl: the signal that comes when the parent ends.
_PARENT_DIES = 1
_log = logging.getLogger(__name__)


def main(control: int, parent: int) -> NoReturn:
    """Run the process, once the server says for what.

    control: descriptor of the control socket.  parent: the process that started this one.
    """
    _end_with(parent)
    os.set_inheritable(control, False)
    # The server ends this process: signals of a terminal or a service manager are for the server.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    with suppress(OSError, ValueError):  # without stderr
        faulthandler.enable()
    server = Control(Connection(control))
    found = server.receive()
    if found is None:
        os._exit(0)
    start: Start = found[0]
    known_by(parent)
    report, figures_memory = found[1]
    _log_as(start)
    memory = mapped(report, SHARED).data
    changes.count_in(memory[mmap.PAGESIZE :])
    report_to(Report(memory[:SIZE]), start.settings.launch_seconds)
    counters = Figures(mapped(figures_memory, figures.SIZE).data)
    close_all(found[1])
    _Process(server).run(start, counters)


class _Process:
    def __init__(self, control: Control) -> None:
        self._control = control
        self._closing = threading.Event()
        self._engine: Engine | None = None

    def run(self, start: Start, counters: Figures) -> NoReturn:
        threading.Thread(target=self._listen, name="rhytid-control", daemon=True).start()
        try:
            engine = Engine(start.settings, start.refused, counters, start.assets, start.builds)
        except Exception as error:  # noqa: BLE001 the server raises it
            if not isinstance(error, RhytidError | OSError):
                _log.exception("the engine does not start")
            self._notify(Started(_sendable(error)))
            _exit(1)
        self._engine = engine
        self._tell_builds(engine.jobs.builds())
        self._notify(Started(None))
        # glibc by itself gives back the end of a heap alone.
        tidy_at_rest(self._closing, also=give_back_heap)
        self._closing.wait()
        engine.close()
        _exit(0)

    def _listen(self) -> None:
        """Handle messages of the server; end where it is gone."""
        while (received := self._control.receive()) is not None:
            message, descriptors = received
            if isinstance(message, OpenLine):
                line = Connection(descriptors[0])
                threading.Thread(target=self._answer, args=(line,), daemon=True).start()
            elif isinstance(message, Close):
                self._closing.set()
        os._exit(0)

    def _notify(self, message: Any) -> None:
        with suppress(OSError):  # `_listen` finds that the server is gone
            self._control.send(message)

    def _answer(self, line: Connection) -> None:
        """Answer the calls of one line until it is closed."""
        room: Bytes | None = None
        with line, suppress(ConnectionError):
            while (message := receive(line)) is not None:
                answer = self._answered(message, line, room)
                if answer.nbytes > (0 if room is None else len(room)):
                    send(line, Message(room=answer.nbytes))
                    if (offer := receive(line)) is None:
                        return
                    room = _room(offer)
                if room is not None and answer.places:
                    answer.lend(room)
                send(line, Message(answer.body, answer.places))
                del answer, message

    def _answered(self, message: Message, line: Connection, room: Bytes | None) -> Packed:
        files = message.descriptors
        try:
            memory = private(files[0], message.shared) if message.shared else None
            if memory is None and message.places:  # the answer is written over them
                assert room is not None
                memory = room[: sum(message.places[-1])].copy()
            own = files[1:] if message.shared else files
            envelope: Envelope = unpack(message.body, message.places, memory, own)
            answer = answered(envelope, self._perform, partial(_hung_up, line))
            try:
                return pack(answer)
            except Exception as error:  # noqa: BLE001 the server raises it
                _log.exception("the answer to %s cannot be sent", envelope.name)
                return pack(Answer(False, _sendable(error), answer.spans))
            finally:
                if isinstance(answer.value, Snapshot):  # the server opens its files
                    answer.value.close()
        finally:
            close_all(files)

    def _perform(self, envelope: Envelope) -> Any:
        assert self._engine is not None  # lines are opened once the engine is there
        with used_for(Purpose(request=envelope.number)):
            value = envelope.perform(self._engine)
        if isinstance(value, AssetInfo) and envelope.operation.addresses == "content":
            builds = self._engine.jobs.builds()
            self._tell_builds([job for job in builds if job.info.asset == value.id])
            self._when_stored(value, envelope.number)
        return value

    def _tell_builds(self, jobs: list[Job]) -> None:
        """Tell the server of builds: should this process end, the next goes on with them."""
        for job in jobs:
            info = job.info
            self._notify(BuildChanged(info.asset, info.id, ended=False))
            job.when_ended(partial(self._notify, BuildChanged(info.asset, info.id, ended=True)))

    def _when_stored(self, info: AssetInfo, number: int) -> None:
        """Tell the server when the frames are stored that came with an asset."""
        assert self._engine is not None
        stored = partial(self._notify, FramesStored(number))
        try:
            if info.job is None:
                raise NotFoundError
            self._engine.jobs.get(info.job).when_ended(stored)
        except NotFoundError:
            stored()


def _hung_up(line: Connection) -> bool:
    """Whether the server has closed a line: nobody waits for the answer."""
    poll = select.poll()
    poll.register(line, 0)
    return bool(poll.poll(0))


def _room(offer: Message) -> Bytes:
    """The memory for an answer."""
    try:
        return mapped(offer.descriptors[0], offer.room)
    finally:
        close_all(offer.descriptors)


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
