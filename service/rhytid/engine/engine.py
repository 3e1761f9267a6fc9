"""The engine: assets on a device, a frame in, tiles out. Its arguments and results are plain values
(see messages.py)."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from types import MappingProxyType

import numpy as np

from rhytid.device.ahead import ProgramsAhead
from rhytid.device.figures import Figures
from rhytid.device.memory import usual_frame_memory, usual_host_memory
from rhytid.device.runtime import Device
from rhytid.device.select import Candidate, candidates, choose
from rhytid.engine.assets.asset import AssetRegistry
from rhytid.engine.assets.builder import AssetBuilder
from rhytid.engine.assets.creation import AssetCreation, AssetRegistration
from rhytid.engine.assets.on_device import DeviceAssets
from rhytid.engine.assets.service import AssetService
from rhytid.engine.assets.stored import RestoredAssets, StoredAssets
from rhytid.engine.byte_budget import ByteBudget
from rhytid.engine.changes import Mark, counted
from rhytid.engine.frame_service import FrameService
from rhytid.engine.jobs import Jobs
from rhytid.engine.local_copies import LocalCopies
from rhytid.engine.messages import DeviceInfo, Refusal
from rhytid.engine.packages import PackageService
from rhytid.engine.shared_assets import SharedAssets
from rhytid.engine.snapshots import SnapshotService
from rhytid.engine.tiles.batcher import MOST_TILES, TileBatcher
from rhytid.engine.tiles.service import TileService
from rhytid.engine.worker import READY, DeviceWorker
from rhytid.errors import BusyError, DeviceError
from rhytid.pipeline.measured_shape import remembered_pace, remembered_shape
from rhytid.pipeline.work import DrawLimit
from rhytid.storage.shared.mirror import StoreMirror
from rhytid.storage.shared.shared_store import SharedStore
from rhytid.storage.store import AssetStore
from rhytid.support.settings import ServiceSettings

# Work-items of the kernel that tells whether the device computes.
_PROBED = 64


class Engine:
    """Holds assets on one device and answers for their frames. Blocking; safe from any thread.

    refused: why assets are not built, by id.  figures: counts what the device does; one in memory
    that another process reads may be given.  only: the assets to open, of a store that several
    engines share and another process holds open; None: all, and this engine holds the store.
    builds: the jobs that built assets in a process that has ended, by asset: they go on here.

    memory: bytes that requests and jobs hold on the host.  figures: by the number of the device.
    shared: the shared store.  assets, frames, tiles, jobs, snapshots, packages: the calls. Every
    call raises NotFoundError for an unknown id, NotReadyError while the asset builds, ConflictError
    where it failed to build, and BusyError where too many calls wait already; with a shared store,
    FetchingError while the asset is fetched, SharedDamageError, and SharedStoreError.
    """

    def __init__(
        self,
        settings: ServiceSettings,
        refused: Mapping[str, Refusal] = MappingProxyType({}),
        figures: Figures | None = None,
        only: Collection[str] | None = None,
        builds: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        # Before a device is opened, so that a shared store that cannot be used is found at once.
        shared = SharedStore.at(settings.shared_store) if settings.shared_store else None
        figures = figures or Figures()
        figures.begin()
        self._device = open_device(settings, figures=figures)
        self.figures = {str(self._device.info.index): figures}
        self._store = AssetStore(settings.store, lock=only is None, packages=settings.packages)
        self._worker = DeviceWorker(settings.queue, figures)
        self._ahead = ProgramsAhead(self._device, settings.cache)
        self._on_device = DeviceAssets(self._device, self._worker, self._store, self._ahead)
        host_memory = settings.host_memory or usual_host_memory()
        self.memory = ByteBudget(host_memory, "RHYTID_HOST_MEMORY_MB")
        self.jobs = Jobs(settings.jobs, figures, settings.build_seconds)
        registry = AssetRegistry(settings.frame_memory or usual_frame_memory())
        limit = DrawLimit(settings.draw_seconds, self._device.work_pace)
        stored = StoredAssets(self._store, self._on_device, registry.frame_memory)
        restored = RestoredAssets(registry, self._store, stored)
        self.shared = self._shared_assets(settings, shared, registry, restored)
        registry.elsewhere = self.shared.get
        builder = AssetBuilder(
            self._device, self._on_device, self._store, self.shared, self.jobs, limit, refused
        )
        # Between two tasks a GPU waits for the host, a processor does not.
        most = 1 if self._device.info.kind == "cpu" else MOST_TILES
        batcher = TileBatcher(self._worker, self._device.task, most)
        self.frames = FrameService(registry, self._on_device)
        self.tiles = TileService(registry, self._on_device, self._device, batcher, settings.queue)
        registration = AssetRegistration(
            registry, self._store, stored, builder, self.frames, self.jobs, self.memory
        )
        creation = AssetCreation(
            registration,
            self._device,
            self._on_device,
            self._store,
            self.shared,
            registry.frame_memory,
            limit,
        )
        self.assets = AssetService(
            registry, creation, self._on_device, self._store, self.shared, builder, self.jobs
        )
        self.packages = PackageService(
            registry, self.assets, self.tiles, self._store, self.jobs, self.memory
        )
        self.snapshots = SnapshotService(registry, self._store, restored, self.shared)
        registration.open_store(only, builds)
        try:
            self.shared.open()
        except BaseException:
            self.close()
            raise
        self._ahead.begin()

    def close(self) -> None:
        """Stop the jobs, finish the tasks that wait for the device, and close the store."""
        self.shared.close()
        self.jobs.close()
        self._ahead.close()
        self._worker.close()
        self._store.close()

    def mark(self, asset: str, frame: str) -> Mark:
        """Counts of what was changed of an asset and a frame. Does not block."""
        return counted().mark(asset, frame)

    def well(self) -> bool:
        """Whether the thread of the device runs. Does not block."""
        return self._worker.runs

    def ready(self) -> bool:
        """Whether a kernel computes on the device. It runs before all calls that wait; where a task
        takes long, the answer is whether one ends within READY seconds."""
        try:
            return self._worker.answers(self._probe, READY)
        except (BusyError, DeviceError):  # busy: the engine is closed
            return False

    def devices(self) -> list[DeviceInfo]:
        """Every OpenCL device. Budget and use are those of the device of this engine, and 0 for
        others."""
        return [self._device_info(candidate) for candidate in candidates()]

    @property
    def waiting(self) -> int:
        """Calls that wait for the device."""
        return self._worker.waiting + self.tiles.joined

    @property
    def restarts(self) -> dict[str, int]:
        """How often the process of each device was restarted: none, since this engine has no
        process of its own."""
        return {}

    def _shared_assets(
        self,
        settings: ServiceSettings,
        shared: SharedStore | None,
        registry: AssetRegistry,
        restored: RestoredAssets,
    ) -> SharedAssets:
        """The assets of the shared store, if there is one, with the limit of the local store."""
        mirror = copies = None
        if shared is not None:
            mirror = StoreMirror(self._store, shared)
            copies = LocalCopies(
                settings.store_limit, mirror, registry, self._store, self._on_device, self.jobs
            )
        return SharedAssets(mirror, registry, restored, self.jobs, copies, in_step=settings.in_step)

    def _probe(self) -> bool:
        """Launch the kernel that devices are tried with, and check what it wrote."""
        with self._device.task():
            buffer = self._device.empty(_PROBED, np.float32)
            try:
                self._device.launch("trial", "probe", (_PROBED,), buffer)
                values = self._device.read(buffer, (_PROBED,), np.float32)
            finally:
                buffer.release()
        return bool(np.array_equal(values, 2.0 * np.arange(_PROBED)))

    def _device_info(self, candidate: Candidate) -> DeviceInfo:
        selected = candidate.index == self._device.info.index
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


def open_device(
    settings: ServiceSettings, wanted: str | None = None, figures: Figures | None = None
) -> Device:
    """Open a device with the memory of the settings, drawing in the shape that is fastest on it.

    wanted: the device, in place of the one that the settings name.  figures: what it does.

    Raises NoDeviceError where none computes.
    """
    found = choose(wanted or settings.device, settings.cache)
    device = Device(found, settings.device_memory, figures)
    if settings.cache is not None:
        device.shape = remembered_shape(device, settings.cache)
        device.work_pace = remembered_pace(device, settings.cache)
    return device
