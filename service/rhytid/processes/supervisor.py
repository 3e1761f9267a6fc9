"""Keeps a process of the device running: starts it, and starts it again when it has ended. What
ended it twice is refused."""

from __future__ import annotations

import logging
import math
import os
import threading
import time
from collections import Counter, OrderedDict
from collections.abc import Callable, Iterator
from concurrent.futures import TimeoutError as FutureTimeoutError
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from rhytid.device import figures
from rhytid.device.figures import Figures
from rhytid.engine.changes import Mark
from rhytid.engine.frames import UnknownFrameError
from rhytid.engine.messages import Refusal
from rhytid.errors import DeviceError, DeviceLostError, FatalRequestError
from rhytid.processes.device_process import DeviceProcess, Ending
from rhytid.processes.envelope import Answer, Request
from rhytid.processes.lines import LineBroken
from rhytid.processes.packing import mapped, shared_file
from rhytid.processes.wire import Start
from rhytid.support.settings import ServiceSettings

# Seconds that a call waits for a process that starts, and for the end of one that broke its line.
PATIENCE, ENDING_PATIENCE = 15.0, 10.0
# How often one call is sent, where the process ends each time without that call being to blame.
_SENT = 4
# Seconds between an end and the next start: none the first time, then growing; a process that ran
# for so long counts as a good one.
_FIRST_PAUSE, _LONGEST_PAUSE, _GOOD = 0.5, 30.0, 60.0
# Failed starts in a row after which calls do not wait for the next.
_HOPELESS = 3
# Seconds without a process that answers after which the server is not well.
UNWELL = 120.0
_log = logging.getLogger(__name__)


class Supervisor:
    """One device's process, whichever it is now.

    on_message: called with messages of a process beside answers.  on_end: called when one has
    ended, before the next starts.  assets: those of the store that are this device's; None = all.
    builds: the jobs that build assets, by asset, with which the next process goes on.  figures:
    what the device has done, in all of its processes.
    """

    def __init__(
        self,
        settings: ServiceSettings,
        on_message: Callable[[Any], None],
        on_end: Callable[[DeviceProcess], None],
        assets: Callable[[], frozenset[str]] | None = None,
        builds: Callable[[], dict[str, str]] = dict,
    ) -> None:
        self.restarts: Counter[str] = Counter()
        self._figures_memory = shared_file(figures.SIZE)
        self.figures = Figures(mapped(self._figures_memory, figures.SIZE).data)
        self._settings, self._on_message, self._on_end = settings, on_message, on_end
        self._assets, self._builds = assets, builds
        self._refusals = Refusals()
        # Who is blamed, by the number of what is asked.
        self._asked: dict[int, Request] = {}
        self._local = threading.local()
        self._changed = threading.Condition()
        self._made: DeviceProcess | None = None
        self._ready: DeviceProcess | None = None
        self._failed: BaseException | None = None
        # Whether any process ever answered.
        self._begun = False
        self._closing = False
        # Starts in a row after which no process answered, and since when none does.
        self._failures, self._without_since = 0, time.monotonic()
        self._thread = threading.Thread(target=self._run, name="rhytid-supervisor", daemon=True)
        self._thread.start()

    @property
    def waiting(self) -> int:
        """Calls that are not answered yet."""
        return len(self._asked)

    @property
    def ready(self) -> DeviceProcess | None:
        """The process that answers now, if there is one."""
        return self._ready

    @property
    def runs(self) -> bool:
        """Whether its thread is there, which starts processes."""
        return self._closing or self._thread.is_alive()

    @property
    def well(self) -> bool:
        """Whether a process answers, or did within UNWELL seconds."""
        recent = time.monotonic() - self._without_since <= UNWELL
        return self._closing or self._ready is not None or recent

    def start(self) -> None:
        """Wait until the first process answers; raises what it ended with, else, or DeviceError
        where none can be started."""
        with self._changed:
            while self._ready is None and self._failed is None:
                # In turns: a signal is handled between two of them.
                self._changed.wait(1.0)
        if self._failed is not None:
            raise self._failed

    def close(self) -> None:
        """End the process, in bounded time; calls that wait for it raise DeviceLostError."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
            if self._made is not None:
                self._made.close()
        self._thread.join()
        with self._changed:
            memory, self._figures_memory = self._figures_memory, -1
        if memory >= 0:
            os.close(memory)

    def call(self, request: Request, prepare: Callable[[DeviceProcess], None] | None = None) -> Any:
        """The answer to a request; sent again where the process ends meanwhile.

        prepare: called with each process that is asked, before.

        Raises what the engine raises; DeviceLostError where no process answers in time, and
        FatalRequestError where the process ended twice at this request.
        """
        self._refusals.check(request)
        for _ in range(_SENT):
            process = self.process()
            try:
                if prepare is not None:
                    with self._instead(request):
                        prepare(process)
                return self.ask(process, request)
            except LineBroken:
                self._refusals.check(request)
        raise DeviceLostError("the process of the device ended again and again; try later")

    def mark(self, asset: str, frame: str) -> Mark | None:
        """Counts of what the process has changed of an asset and a frame; None where none answers.
        The counts of one process never equal those of another."""
        process = self._ready
        return None if process is None else process.changes.mark(asset, frame)

    def forget(self, asset: str) -> None:
        """An asset was changed or removed: what is asked of it may be tried again."""
        self._refusals.forget(asset)

    def ask(self, process: DeviceProcess, request: Request) -> Any:
        """The answer of one process; raises LineBroken where it has ended."""
        self._asked[request.number] = getattr(self._local, "blamed", None) or request
        request.sent += 1
        try:
            answer: Answer = process.lines.ask(request.packed)
        except LineBroken:
            # Until it is known who is to blame, this is among those who were at work.
            self._await_end(process)
            raise
        finally:
            self._asked.pop(request.number, None)
        if not isinstance(answer.value, UnknownFrameError):  # else it was not worked on at all
            self._refusals.absolve(request)
        return answer.open()

    @contextmanager
    def _instead(self, request: Request) -> Iterator[None]:
        """What this thread asks in the block is for the sake of a request, which is blamed."""
        self._local.blamed = request
        try:
            yield
        finally:
            self._local.blamed = None

    def process(self) -> DeviceProcess:
        """A process that answers; raises DeviceLostError where there is none in time."""
        found = self._ready
        if found is not None and not self._closing:
            return found
        with self._changed:
            self._changed.wait_for(self._known, PATIENCE)
            if self._closing:
                raise DeviceLostError("the server is shutting down")
            if self._ready is None:
                raise DeviceLostError("the process of the device is not running; it is restarted")
            return self._ready

    def _known(self) -> bool:
        """Whether there is a process, or there will be none for a while."""
        return self._ready is not None or self._closing or self._failures >= _HOPELESS

    def _await_end(self, process: DeviceProcess) -> None:
        try:
            process.ending.result(ENDING_PATIENCE)
        except FutureTimeoutError:
            raise DeviceLostError("the process of the device does not answer") from None

    def _run(self) -> None:
        short = 0
        while not self._closing:
            began = time.monotonic()
            try:
                self._run_once()
            except Exception as error:  # noqa: BLE001 else nobody would start a process any more
                self._note_failure(error)
            if self._failed is not None:
                return
            good = self._failures == 0 and time.monotonic() - began > _GOOD
            short = 1 if good else short + 1
            with self._changed:
                self._changed.wait_for(lambda: self._closing, _pause(short))

    def _run_once(self) -> None:
        """Start a process, and watch it until it has ended."""
        process = self._make()
        ending = process.watch()
        answered = process.started.done() and process.started.exception() is None
        with self._changed:
            self._failures = 0 if answered else self._failures + 1
            self._changed.notify_all()
        if not answered and not self._begun:
            self._fail(_reason(process, ending))
        self._settle(process, ending)

    def _note_failure(self, error: Exception) -> None:
        """A process could not be started: the system has no room for it, for one."""
        why = str(error) or type(error).__name__
        # The system's own words say enough; of anything else the log has the place.
        place = None if isinstance(error, OSError | MemoryError) else error
        _log.error("the process of the device cannot be started: %s", why, exc_info=place)
        self.restarts["start"] += self._begun
        with self._changed:
            self._ready = self._made = None
            self._failures += 1
            self._changed.notify_all()
        if not self._begun:
            self._fail(DeviceError(f"the process of the device cannot be started: {why}"))

    def _fail(self, error: BaseException) -> None:
        """The first process did not start: then there is no service."""
        with self._changed:
            self._failed = error
            self._changed.notify_all()

    def _make(self) -> DeviceProcess:
        level, assets = logging.getLogger("rhytid").level, self._assets and self._assets()
        refused, builds = self._refusals.builds(), self._builds()
        start = Start(self._settings, refused, level, assets, builds)
        process = DeviceProcess(start, self._on_message, self._publish, self._figures_memory)
        with self._changed:
            self._made = process
            if self._closing:
                process.close()
        return process

    def _publish(self, process: DeviceProcess) -> None:
        with self._changed:
            self._ready, self._begun, self._failures = process, True, 0
            self._changed.notify_all()

    def _settle(self, process: DeviceProcess, ending: Ending) -> None:
        """Find who is to blame, and let those go on who wait for the end of the process."""
        with self._changed:
            if self._ready is not None:
                self._without_since = time.monotonic()
            self._ready = self._made = None
        try:
            if self._begun and not self._closing:
                self._note_end(process, ending)
            self._on_end(process)
        except Exception:  # noqa: BLE001 the next process is started all the same
            _log.exception("the end of the process of the device (%d)", process.pid)
        finally:
            process.ending.set_result(ending)

    def _note_end(self, process: DeviceProcess, ending: Ending) -> None:
        self.restarts["start" if self._failures else ending.kind] += 1
        _log.error("the process of the device (%d) is restarted: %s", process.pid, ending.reason)
        if ending.blames:
            self._blame(ending)

    def _blame(self, ending: Ending) -> None:
        request = self._asked.get(ending.purpose.request)
        if request is not None:
            _log.error("it worked on %s", request)
            self._refusals.strike(request, ending)
        elif ending.purpose.asset:
            asset = f"{ending.purpose.asset:016x}"
            _log.error("it worked on a job of asset %s", asset)
            self._refusals.strike_build(asset, ending)


def _pause(short: int) -> float:
    """Seconds until the next start.  short: processes in a row that did not run for long."""
    return 0.0 if short == 1 else min(_FIRST_PAUSE * 2 ** min(short - 2, 10), _LONGEST_PAUSE)


def _reason(process: DeviceProcess, ending: Ending) -> BaseException:
    """Why a process did not start."""
    said = process.started.exception() if process.started.done() else None
    return said or DeviceError(f"the process of the device did not start: {ending.reason}")


STRIKES = 2
# Seconds of a refusal whose last ending was a call of the driver that took too long, twice as many
# after each further one: the machine may have been busy, or asleep.
LATE, LONGEST_LATE = 600.0, 86_400.0
_REMEMBERED = 1000


@dataclass
class _Record:
    asset: str
    refusal: Refusal | None = None
    strikes: int = 0

    def strike(self, what: str, ending: Ending) -> None:
        self.strikes += 1
        if self.strikes < STRIKES:
            return
        reason = (
            f"the process of the device ended {self.strikes} times while it worked on {what}: "
            f"{ending.reason}"
        )
        until = math.inf
        if ending.kind == "late":
            seconds = min(LATE * 2 ** min(self.strikes - STRIKES, 10), LONGEST_LATE)
            until = time.monotonic() + seconds
            reason += f"; it may be tried again after {seconds / 60:.0f} minutes"
        self.refusal = Refusal(reason, until)


class Refusals:
    """Counts, by what was asked for, how often the process ended meanwhile."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        # Names of calls that the process ended at: of others no digest has to be made.
        self._names: set[str] = set()
        self._requests: OrderedDict[str, _Record] = OrderedDict()
        self._builds: dict[str, _Record] = {}

    def check(self, request: Request) -> None:
        """Raise FatalRequestError where the process ended twice at such a request."""
        if request.operation.name not in self._names:
            return
        with self._lock:
            record = self._requests.get(request.digest)
        refusal = None if record is None else record.refusal
        if refusal is not None and refusal.holds:
            raise FatalRequestError(refusal.reason)

    def strike(self, request: Request, ending: Ending) -> None:
        """The process ended at this request."""
        with self._lock:
            self._names.add(request.operation.name)
            record = self._requests.setdefault(request.digest, _Record(request.asset))
            record.strike("this request", ending)
            self._requests.move_to_end(request.digest)
            while len(self._requests) > _REMEMBERED:
                self._requests.popitem(last=False)

    def strike_build(self, asset: str, ending: Ending) -> None:
        """The process ended at a job of an asset."""
        with self._lock:
            self._builds.setdefault(asset, _Record(asset)).strike("its build", ending)

    def absolve(self, request: Request) -> None:
        """The request was answered."""
        if request.operation.name in self._names:
            with self._lock:
                self._requests.pop(request.digest, None)

    def forget(self, asset: str) -> None:
        """The asset was changed or removed: what is asked of it may be tried again."""
        with self._lock:
            self._builds.pop(asset, None)
            for digest in [d for d, record in self._requests.items() if record.asset == asset]:
                del self._requests[digest]

    def builds(self) -> dict[str, Refusal]:
        """Ids of assets that are not to be built, and why."""
        with self._lock:
            found = {asset: record.refusal for asset, record in self._builds.items()}
        return {asset: one for asset, one in found.items() if one is not None and one.holds}
