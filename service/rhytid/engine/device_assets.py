"""The assets that lie on the device: loaded on first use, dropped when memory is short."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from typing import Any, TypeVar

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.stiffness import Stiffness
from rhytid.domain.tiles import TileAddress
from rhytid.engine.assets import Asset
from rhytid.engine.device_asset import DeviceAsset
from rhytid.engine.worker import DeviceWorker
from rhytid.errors import DeviceMemoryError, StorageError
from rhytid.storage.store import AssetStore

T = TypeVar("T")
# How often an asset is loaded for one task, when others take its memory before the task runs.
_ATTEMPTS = 5
DAMAGED = "damaged in the store: send it again"


class Evicted(Exception):
    """The asset that a task needs has left the device since the task was queued."""


class DeviceAssets:
    """Runs tasks on the device thread, those of an asset with what lies on the device of it.

    An asset on the device is an entry of the memory budget, like what is made of it: the entry that
    was used longest ago goes first. Safe from any thread but that of the device.
    """

    def __init__(self, device: Device, worker: DeviceWorker, store: AssetStore) -> None:
        self._device, self._worker, self._store = device, worker, store
        # One is loaded after the other: what is half loaded cannot make room.
        self._loading = threading.Lock()

    def run(self, task: Callable[..., T], *arguments: Any) -> T:
        """Run one task on the device thread; raises BusyError where too many wait for it."""
        return self._worker.call(lambda: self._whole(task, arguments))

    def run_patiently(self, task: Callable[..., T], *arguments: Any, **named: Any) -> T:
        """As `run`, for long work: waits for a place in the queue."""
        return self._worker.call_patiently(lambda: self._whole(task, arguments, named))

    def use(self, asset: Asset, task: Callable[[DeviceAsset], T], *, patiently: bool = False) -> T:
        """Run a task with an asset on the device, loaded where it is not there.

        Raises what `loaded` and `run` do.
        """
        run = self.run_patiently if patiently else self.run
        return self.using(asset, lambda: run(lambda: task(self.found(asset))))

    def using(self, asset: Asset, call: Callable[[], T]) -> T:
        """What `call` returns, whose task on the device starts with `found`: the asset is loaded
        before, and again where it was dropped before the task ran.

        Raises what `loaded` does, and DeviceMemoryError where it is dropped again and again.
        """
        for _ in range(_ATTEMPTS):
            self.loaded(asset)
            try:
                return call()
            except Evicted:
                continue
        raise DeviceMemoryError(
            f"asset {asset.id} left the device {_ATTEMPTS} times before it could be drawn: more "
            "assets are in use than RHYTID_DEVICE_MEMORY_MB holds"
        )

    def found(self, asset: Asset) -> DeviceAsset:
        """An asset, on the device thread: it stays until the task ends. Raises Evicted."""
        found: DeviceAsset | None = self._device.budget.find(_key(asset))
        if found is None:
            raise Evicted
        return found

    def loaded(self, asset: Asset) -> DeviceAsset:
        """An asset as it lies on the device now, loaded from the store where it does not.

        Whoever asks first loads it; others wait. Raises NotReadyError, ConflictError where it
        failed, NotFoundError where it was removed, DeviceMemoryError where it does not fit.
        """
        asset.check_ready()
        lying = asset.lying
        if lying is not None:
            return lying
        with asset.lock:
            asset.check_ready()
            return asset.lying or self._load(asset)

    @contextmanager
    def stepwise(self, asset: Asset) -> Iterator[DeviceAsset]:
        """An asset on the device, for long work of this thread in the block: others get the device
        between two of its steps.

        Raises Evicted from the step before which the asset was dropped or its settings changed, and
        what `loaded` does.
        """
        lying = self.loaded(asset)
        settings = lying.mesh.settings

        def check() -> None:
            if self.found(asset) is not lying or lying.mesh.settings is not settings:
                raise Evicted

        with self._device.from_elsewhere(self.run_patiently, check):
            yield lying

    def make_bins(self, asset: Asset, address: TileAddress) -> None:
        """Make the precomputed maps of one tile where they are not there, step by step; nothing is
        kept where the asset is dropped or its settings change meanwhile."""
        with suppress(Evicted), self.stepwise(asset) as lying:
            if self.run_patiently(lying.bins.has, address):
                return
            tile = lying.bins.made(address)
            self._device.step(partial(lying.bins.keep, address, tile))

    def place(
        self, mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings, stiffness: Stiffness | None
    ) -> DeviceAsset:
        """A mesh with the triangles of its pores and wrinkles; `finish` or `give_up` it."""
        with self._device.from_elsewhere(self.run_patiently):
            made = DeviceAsset(self._device, mesh, settings, stiffness)
            made.mesh.locate(graph)
        return made

    def finish(
        self, asset: Asset, made: DeviceAsset, graph: WrinkleGraph, settings: AssetSettings
    ) -> None:
        """Upload what is drawn of an asset; from then on it may be dropped.

        Raises CancelledError where the asset was removed meanwhile.
        """
        try:
            prepared = made.mesh.prepare(graph, settings)
            with self._device.from_elsewhere(self.run_patiently):
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
        """Give back what was placed."""
        self.run_patiently(made.release)

    def drop(self, asset: Asset) -> None:
        """Give back what an asset has on the device, for good: no more lies spare than is in use,
        for the sizes of one asset hardly fit another."""

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
