"""An engine in a process of its own: the same calls, and the same errors."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from typing import Any

from rhytid.device.figures import Figures
from rhytid.device.memory import usual_frame_memory, usual_host_memory
from rhytid.engine import wanted
from rhytid.engine.byte_budget import ByteBudget
from rhytid.engine.messages import DeviceInfo
from rhytid.engine.worker import READY
from rhytid.engine_process.control import FramesStored
from rhytid.engine_process.device_process import DeviceProcess
from rhytid.engine_process.frame_ledger import FrameLedger, Positions
from rhytid.engine_process.job_ledger import JobLedger
from rhytid.engine_process.line import LineBroken
from rhytid.engine_process.remote_assets import RemoteAssets
from rhytid.engine_process.remote_frames import RemoteFrames
from rhytid.engine_process.remote_jobs import RemoteJobs
from rhytid.engine_process.remote_packages import RemotePackages
from rhytid.engine_process.remote_snapshots import RemoteSnapshots
from rhytid.engine_process.remote_tiles import RemoteTiles
from rhytid.engine_process.requests import Request
from rhytid.engine_process.supervisor import Supervisor
from rhytid.engine_process.supervisors import Supervisors
from rhytid.engine_process.upload_holds import UploadHolds
from rhytid.support.settings import ServiceSettings


class RemoteEngine:
    """What `Engine` is, in another process, which is started again when it ends.

    Blocking; safe from any thread.

    Calls raise what those of `Engine` do; DeviceLostError where the process ended and no other
    answers in time, and FatalRequestError where it ended twice while it worked on the call. Stored
    frames survive it: they are kept here, too.

    Raises what `Engine` raises where the process does not start.
    """

    def __init__(self, settings: ServiceSettings) -> None:
        host_memory = settings.host_memory or usual_host_memory()
        self.memory = ByteBudget(host_memory, "RHYTID_HOST_MEMORY_MB")
        self._uploads = UploadHolds(self.memory)
        jobs = JobLedger()
        self._supervisor = Supervisors(settings, self._on_message, partial(self._lost, jobs))
        frames = FrameLedger(settings.frame_memory or usual_frame_memory(), self._put)
        self.frames = RemoteFrames(self._supervisor, frames)
        self.tiles = RemoteTiles(self._supervisor, frames)
        self.jobs = RemoteJobs(self._supervisor, jobs)
        self.assets = RemoteAssets(self._supervisor, frames, self.jobs, self._uploads, self.tiles)
        self.packages = RemotePackages(self._supervisor, self.jobs)
        self.snapshots = RemoteSnapshots(self._supervisor)
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
        """As `Engine.devices`; while a process restarts, what was known of its device before."""
        for one in self._supervisor.all:
            if one.ready is not None or one not in self._devices:
                self._devices[one] = one.call(Request("devices"))
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
        with wanted.anyway():  # else the process may store it later, after another
            self._supervisor.ask(process, Request("frames.put", (asset, name, positions)))

    def _on_message(self, message: Any) -> None:
        if isinstance(message, FramesStored):
            self._uploads.release(message.token)

    def _lost(self, jobs: JobLedger, process: DeviceProcess, its: Callable[[str], bool]) -> None:
        jobs.lose(its)
        self._uploads.release_of(process)


def _ready(supervisor: Supervisor) -> bool:
    process = supervisor.ready
    if process is None:
        return False
    ended = process.report.ended
    try:
        good, computes, _ = process.lines.ask(Request("ready").packed, seconds=READY)
    except LineBroken:
        return False
    except TimeoutError:  # others go first, where something ended meanwhile
        return process.report.ended > ended
    return bool(good and computes)
