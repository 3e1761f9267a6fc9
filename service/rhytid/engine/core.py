"""What every call of the engine stands on: the device, its owner thread, the store, the jobs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from rhytid.device.memory import usual_frame_memory
from rhytid.device.select import Candidate, candidates
from rhytid.engine.assets import Assets
from rhytid.engine.building import Builder
from rhytid.engine.gathering import Gathering
from rhytid.engine.jobs import Jobs
from rhytid.engine.messages import DeviceInfo
from rhytid.engine.opening import open_device
from rhytid.engine.together import MOST_TILES, Together
from rhytid.engine.worker import DeviceWorker
from rhytid.errors import BusyError, DeviceError
from rhytid.pipeline.drawing import drawing_version
from rhytid.settings import ServiceSettings
from rhytid.storage.store import AssetStore

T = TypeVar("T")


class EngineCore:
    """Opens the device and the store, and closes them."""

    def __init__(self, settings: ServiceSettings) -> None:
        self._device = open_device(settings)
        self._candidate = self._device.info
        self._store = AssetStore(settings.store)
        self._worker = DeviceWorker(settings.queue)
        most = 1 if self._candidate.kind == "cpu" else MOST_TILES
        self._together = Together(self._worker, self._device.task, most)
        self._assets = Assets(settings.frame_memory or usual_frame_memory())
        self._builder = Builder(self._device, self._worker, self._store, self._assets)
        self._gathering = Gathering(self._on_device, self._builder.on_device, settings.queue)
        self._jobs = Jobs()

    def close(self) -> None:
        """Stop the jobs, finish what waits for the device, and let go of the store."""
        self._jobs.close()
        self._worker.close()
        self._store.close()

    def ready(self) -> bool:
        """Whether the device computes; a full queue is a device at work."""
        try:
            return self._on_device(self._probe)
        except BusyError:
            return True
        except DeviceError:
            return False

    def devices(self) -> list[DeviceInfo]:
        """Every OpenCL device; budget and use are those of the selected one, else 0."""
        return [self._device_info(candidate) for candidate in candidates()]

    @property
    def waiting(self) -> int:
        """Calls that wait for the device."""
        return self._worker.waiting + self._together.joined + self._gathering.joined

    def _on_device(self, task: Callable[..., T], *arguments: Any) -> T:
        def run() -> T:
            with self._device.task():
                return task(*arguments)

        return self._worker.call(run)

    @property
    def _drawn_by(self) -> str:
        """The device, where floats differ, and the version of the drawing."""
        device = self._candidate
        return f"{device.platform}/{device.version}/{device.name}/{drawing_version()}"

    def _probe(self) -> bool:
        buffer = self._device.full(1, np.float32(1.0))
        value = self._device.read(buffer, (1,), np.float32)
        buffer.release()
        return bool(value[0] == 1.0)

    def _device_info(self, candidate: Candidate) -> DeviceInfo:
        selected = candidate.index == self._candidate.index
        budget = self._device.budget
        return DeviceInfo(
            name=candidate.name,
            platform=candidate.platform,
            kind=candidate.kind,
            version=candidate.version,
            compute_units=candidate.compute_units,
            memory=candidate.memory,
            budget=budget.limit if selected else 0,
            used=budget.used if selected else 0,
            selected=selected,
        )
