"""The assets on the device: loaded on first use, dropped when memory is short."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, TypeVar

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.painted_maps import Stiffness
from rhytid.domain.tiles import TileAddress
from rhytid.engine import wanted
from rhytid.engine.assets import Asset
from rhytid.engine.device_asset import DeviceAsset
from rhytid.engine.unmade import Unmade
from rhytid.engine.worker import DeviceWorker
from rhytid.errors import DeviceMemoryError, StorageError
from rhytid.storage.store import AssetStore
from rhytid.support import cancellation

T = TypeVar("T")
# How often an asset is loaded for one task, when others take its memory before the task runs.
_ATTEMPTS = 5
DAMAGED = "damaged in the store: send it again"


# How often what a task lacks is made for it, when it is dropped before the task runs.
_MADE = 2
# Seconds after which who waits for what another makes looks whether it is still wanted.
_PATIENCE = 0.25


class Evicted(Exception):
    """The asset that a task needs has left the device since the task was queued."""


class DeviceAssets:
    """Runs tasks of the device, and loads the asset that a task needs.

    An asset on the device is an entry of the memory budget, as are the arrays computed from it: the
    least recently used entry is dropped first. Safe outside of its tasks.
    """

    def __init__(self, device: Device, worker: DeviceWorker, store: AssetStore) -> None:
        self._device, self._worker, self._store = device, worker, store
        # Assets are loaded one at a time: one that is half loaded cannot be dropped for another.
        self._loading = threading.Lock()

    def run(self, task: Callable[..., T], *arguments: Any) -> T:
        """Run one task of the device; raises BusyError where too many wait for it."""
        return self._worker.call(lambda: self._whole(task, arguments))

    def run_patiently(self, task: Callable[..., T], *arguments: Any, **named: Any) -> T:
        """As `run`, for long work: waits for a place in the queue."""
        return self._worker.call_patiently(lambda: self._whole(task, arguments, named))

    def use(self, asset: Asset, task: Callable[[DeviceAsset], T], *, patiently: bool = False) -> T:
        """Run a task with an asset on the device, loaded where it is not there.

        Raises what `loaded` and `run` do.
        """
        call = self._worker.call_patiently if patiently else self._worker.call

        def whole() -> T:
            return self._whole(lambda: task(self.found(asset)), ())

        return self.using(asset, lambda: call(whole, turn=asset.id))

    def using(self, asset: Asset, call: Callable[[], T]) -> T:
        """What `call` returns, whose task on the device starts with `found`: the asset is loaded
        before, and again where it was dropped before the task ran. What the task lacks and takes
        long to make is made step by step before the task is run again.

        Raises what `loaded` does, DeviceMemoryError where it is dropped again and again, and
        CancelledError where nobody wants what is made any more.
        """
        made = 0
        for _ in range(_ATTEMPTS):
            cancellation.check()
            self.loaded(asset)
            try:
                return call()
            except Evicted:
                continue
            except Unmade as lacking:
                if (made := made + 1) > _MADE:
                    break
                self._make(asset, lacking)
        raise DeviceMemoryError(
            f"asset {asset.id} left the device {_ATTEMPTS} times before it could be drawn: more "
            "assets are in use than RHYTID_DEVICE_MEMORY_MB holds"
        )

    def found(self, asset: Asset) -> DeviceAsset:
        """The parts of an asset, in a task of the device; they stay until the task ends. Raises
        Evicted."""
        found: DeviceAsset | None = self._device.budget.find(_key(asset))
        if found is None:
            raise Evicted
        return found

    def loaded(self, asset: Asset) -> DeviceAsset:
        """The parts of an asset on the device, loaded from the store if they are not there.

        The first caller loads them; others wait. Raises NotReadyError, ConflictError where it
        failed, NotFoundError where it was removed, DeviceMemoryError where it does not fit.
        """
        asset.check_ready()
        resident = asset.resident
        if resident is not None:
            return resident
        with asset.lock:
            asset.check_ready()
            return asset.resident or self._load(asset)

    @contextmanager
    def stepwise(self, asset: Asset) -> Iterator[DeviceAsset]:
        """The parts of an asset on the device, for long work of this thread within the block; other
        tasks run on the device between its steps.

        Raises Evicted from the step before which the asset was dropped or its settings changed, and
        what `loaded` does.
        """
        resident = self.loaded(asset)
        settings = resident.mesh.settings

        def check() -> None:
            if self.found(asset) is not resident or resident.mesh.settings is not settings:
                raise Evicted

        with self._device.from_elsewhere(self._steps(asset.id), check):
            yield resident

    def _steps(self, turn: Hashable = None) -> Callable[..., Any]:
        """Runs steps in a turn, until nobody wants what this thread makes any more: then it raises
        CancelledError once, and what follows are steps that give back."""
        leaving = False

        def step(task: Callable[..., T], *arguments: Any) -> T:
            nonlocal leaving
            if not leaving and wanted.is_gone():
                leaving = True
                wanted.check()
            return self._worker.call_patiently(lambda: self._whole(task, arguments), turn=turn)

        return step

    def make_bins(self, asset: Asset, address: TileAddress) -> None:
        """Make the precomputed maps of one tile where they are not there, step by step; nothing is
        kept where the asset is dropped or its settings change meanwhile."""
        self._make(asset, Unmade(lambda resident: resident.bins.make(address)))

    def _make(self, asset: Asset, lacking: Unmade) -> None:
        """Make what a task lacks, one thing of an asset after the other: who wants the same finds
        it made."""
        while not asset.making.acquire(timeout=_PATIENCE):
            wanted.check()
        try:
            with suppress(Evicted), self.stepwise(asset) as resident:
                lacking.make(resident)
        finally:
            asset.making.release()

    def place(
        self, mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings, stiffness: Stiffness | None
    ) -> DeviceAsset:
        """A mesh with the triangles of its pores and wrinkles; `finish` or `give_up` it."""
        with self._device.from_elsewhere(self._steps()):
            made = DeviceAsset(self._device, mesh, settings, stiffness)
            made.mesh.locate(graph)
            made.mesh.bounded = True
        return made

    def finish(
        self, asset: Asset, made: DeviceAsset, graph: WrinkleGraph, settings: AssetSettings
    ) -> None:
        """Upload the elements of an asset, which may be dropped from then on.

        Raises CancelledError where the asset was removed meanwhile.
        """
        try:
            prepared = made.mesh.prepare(graph, settings)
            with self._device.from_elsewhere(self._steps()):
                elements = made.mesh.upload(prepared, settings)
            self.run_patiently(made.mesh.take, elements, settings)
            self.run_patiently(made.warm_up)
            with asset.kept():
                self.run_patiently(self._device.budget.keep, _key(asset), lambda: made)
                asset.on_device = made
        except BaseException:
            self.give_up(made)
            raise

    def give_up(self, made: DeviceAsset) -> None:
        """Free what `place` made."""
        self.run_patiently(made.release)

    def drop(self, asset: Asset) -> None:
        """Free the parts of an asset for good, and spare buffers beyond the size of those in use:
        buffers of one asset rarely fit another."""

        def discard() -> None:
            self._device.budget.discard(_key(asset))
            self._device.pool.shrink(self._device.budget.used)

        self.run_patiently(discard)

    def _load(self, asset: Asset) -> DeviceAsset:
        try:
            stored = self._store.asset(asset.id)
        except StorageError:
            asset.fail(DAMAGED)
            raise
        with self._loading:
            made = self.place(stored.mesh, stored.graph, asset.settings, stored.stiffness)
            self.finish(asset, made, stored.graph, asset.settings)
        return made

    def _whole(
        self,
        task: Callable[..., T],
        arguments: tuple[Any, ...],
        named: dict[str, Any] | None = None,
    ) -> T:
        with self._device.task():
            return task(*arguments, **(named or {}))


def _key(asset: Asset) -> Hashable:
    return ("asset", asset.id, id(asset))
