"""An engine in a process of its own: the same calls, and the same errors."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

from rhytid.device.figures import Figures
from rhytid.device.memory import usual_frame_memory, usual_host_memory
from rhytid.engine import call_context
from rhytid.engine.byte_budget import ByteBudget
from rhytid.engine.changes import Mark
from rhytid.engine.messages import DeviceInfo
from rhytid.engine.operations import OPERATIONS, Proxy
from rhytid.engine.worker import READY
from rhytid.processes.device_process import DeviceProcess
from rhytid.processes.envelope import Answer, Request
from rhytid.processes.frame_ledger import FrameLedger, Positions
from rhytid.processes.job_ledger import JobLedger
from rhytid.processes.lines import LineBroken
from rhytid.processes.remote_calls import RemoteCalls, UploadHolds
from rhytid.processes.supervisor import Supervisor
from rhytid.processes.supervisors import Supervisors
from rhytid.processes.wire import BuildChanged, FramesStored
from rhytid.support.settings import ServiceSettings


class RemoteEngine(Proxy):
    """An engine in another process, which is started again when it ends.

    Stored frames survive that: they are kept here, too. Raises what `rhytid.engine.engine.Engine`
    raises where the process does not start.
    """

    def __init__(self, settings: ServiceSettings) -> None:
        host_memory = settings.host_memory or usual_host_memory()
        self.memory = ByteBudget(host_memory, "RHYTID_HOST_MEMORY_MB")
        self._uploads, self._jobs = UploadHolds(self.memory), JobLedger()
        self._supervisor = Supervisors(settings, self._on_message, self._on_end, self._jobs.builds)
        frames = FrameLedger(settings.frame_memory or usual_frame_memory(), self._put)
        super().__init__(RemoteCalls(self._supervisor, frames, self._jobs, self._uploads))
        self._devices: dict[Supervisor, list[DeviceInfo]] = {}
        self.figures: dict[str, Figures] = {}
        try:
            self._supervisor.start()
            self.devices()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """End the process: within a few seconds, whatever the device does. Calls that wait raise
        DeviceLostError."""
        self._supervisor.close()

    def mark(self, asset: str, frame: str) -> Mark | None:
        """Counts of what the process of the asset's device has changed of it and a frame; None
        while that restarts. Does not block."""
        return self._supervisor.mark(asset, frame)

    def well(self) -> bool:
        """Whether the process of a device answers, did within two minutes, and is started again
        where it ends. Does not block."""
        return self._supervisor.well

    def ready(self) -> bool:
        """Whether a kernel computes on the device, or on one of several. Not where nothing came
        back from its driver for five seconds, and not while its process restarts."""
        if len(self._supervisor.all) == 1:
            return _ready(self._supervisor.all[0])
        with ThreadPoolExecutor(len(self._supervisor.all)) as pool:
            return any(pool.map(_ready, self._supervisor.all))

    def devices(self) -> list[DeviceInfo]:
        """Every OpenCL device, with budget and use of those of this engine; while a process
        restarts, what was known of its device before."""
        for one in self._supervisor.all:
            if one.ready is not None or one not in self._devices:
                self._devices[one] = one.call(Request(OPERATIONS["devices"]))
        found = list(next(iter(self._devices.values())))
        for one, listed in self._devices.items():
            for number, device in enumerate(listed):
                if device.selected:
                    restarts = sum(one.restarts.values())
                    found[number] = replace(device, restarts=restarts)
                    self.figures[str(number)] = one.figures
        return found

    @property
    def waiting(self) -> int:
        """Calls that the process has not answered yet."""
        return self._supervisor.waiting

    @property
    def restarts(self) -> dict[str, int]:
        """How often the process was started again, by what had ended it."""
        return dict(self._supervisor.restarts)

    def _put(self, process: DeviceProcess, asset: str, name: str, positions: Positions) -> None:
        with call_context.never_abandoned():  # else the process may store it later, after another
            put = Request(OPERATIONS["frames.put"], (asset, name, positions))
            self._supervisor.ask(process, put)

    def _on_message(self, message: Any) -> None:
        if isinstance(message, FramesStored):
            self._uploads.release(message.number)
        elif isinstance(message, BuildChanged):
            self._jobs.note_build(message)

    def _on_end(self, process: DeviceProcess, its: Callable[[str], bool]) -> None:
        self._jobs.lose(its)
        self._uploads.release_of(process)


def _ready(supervisor: Supervisor) -> bool:
    process = supervisor.ready
    if process is None:
        return False
    ended = process.report.ended
    try:
        answer: Answer = process.lines.ask(Request(OPERATIONS["ready"]).packed, seconds=READY)
    except LineBroken:
        return False
    except TimeoutError:  # others go first, where something ended meanwhile
        return process.report.ended > ended
    return bool(answer.good and answer.value)
