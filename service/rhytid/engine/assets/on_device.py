"""The assets on the device: loaded on first use, dropped when memory is short."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, TypeVar

from rhytid.device.ahead import ProgramsAhead
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.painted_maps import Stiffness
from rhytid.domain.residual import Residual
from rhytid.domain.tiles import TileAddress
from rhytid.engine import call_context
from rhytid.engine.assets.asset import Asset
from rhytid.engine.device_assets.asset import DeviceAsset
from rhytid.engine.device_assets.mesh import DeferredWork
from rhytid.engine.worker import DeviceWorker
from rhytid.errors import DeviceMemoryError, StorageError
from rhytid.storage.store import AssetStore
from rhytid.support import cancellation

T = TypeVar("T")
DAMAGED = "damaged in the store: send it again"
# How often an asset is loaded for one task, and how often work that the task defers is done, when
# others take the memory before the task runs.
_ATTEMPTS, _MADE = 5, 2


class Evicted(Exception):
    """The asset that a task needs has left the device since the task was queued."""


class DeviceAssets:
    """Runs tasks of the device, and loads the asset that a task needs.

    An asset on the device is an entry of the memory budget, as are the arrays computed from it: the
    least recently used entry is dropped first. Its methods are called outside of tasks, but for
    `found`, and are safe from any thread.
    """

    def __init__(
        self, device: Device, worker: DeviceWorker, store: AssetStore, ahead: ProgramsAhead
    ) -> None:
        self._device, self._worker, self._store = device, worker, store
        self._ahead = ahead
        # Assets are loaded one at a time: one that is half loaded cannot be dropped for another.
        self._loading = threading.Lock()

    def run(self, task: Callable[..., T], *arguments: Any) -> T:
        """Run one task of the device; raises BusyError where too many calls wait for it."""
        return self._worker.call(lambda: self._whole(task, arguments))

    def run_patiently(self, task: Callable[..., T], *arguments: Any, **named: Any) -> T:
        """As `run`, for long work: waits for a place in the queue."""
        return self._worker.call_patiently(lambda: self._whole(task, arguments, named))

    def use(self, asset: Asset, task: Callable[[DeviceAsset], T], *, patiently: bool = False) -> T:
        """Run a task with an asset on the device, which is loaded where it is not there.

        patiently: wait for a place in the queue, in place of raising BusyError. Raises what `using`
        does.
        """
        call = self._worker.call_patiently if patiently else self._worker.call

        def whole() -> T:
            return self._whole(lambda: task(self.found(asset)), ())

        return self.using(asset, lambda resident: call(whole, turn=asset.id))

    def using(self, asset: Asset, call: Callable[[DeviceAsset], T]) -> T:
        """Make a call whose task on the device starts with `found`, and return its result. The
        asset is loaded before the call, and again where it was dropped before the task ran. Work
        that the task defers is done in steps before the call is made again.

        Raises what `loaded` does, DeviceMemoryError where the asset is dropped again and again, and
        CancelledError where nobody waits for the result any more.
        """
        made = 0
        for _ in range(_ATTEMPTS):
            cancellation.check()
            resident = self.loaded(asset)
            try:
                found = call(resident)
            except Evicted:
                continue
            except DeferredWork as deferred:
                if (made := made + 1) > _MADE:
                    break
                self._make(asset, deferred)
            else:
                self._ahead.note_drawn()
                return found
        raise DeviceMemoryError(
            f"asset {asset.id} left the device {_ATTEMPTS} times before it could be drawn: more "
            "assets are in use than RHYTID_DEVICE_MEMORY_MB holds"
        )

    def found(self, asset: Asset) -> DeviceAsset:
        """The parts of an asset, in a task of the device; they stay until the task ends. Raises
        Evicted where they are not there."""
        found: DeviceAsset | None = self._device.budget.find(_key(asset))
        if found is None:
            raise Evicted
        return found

    def loaded(self, asset: Asset) -> DeviceAsset:
        """The parts of an asset on the device, loaded from the store where they are not there.

        The first caller loads them; others wait. Raises what `Asset.check_ready` does, and
        DeviceMemoryError where they do not fit.
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

        Raises Evicted from the first step after the asset was dropped or its settings changed, and
        what `loaded` does.
        """
        resident = self.loaded(asset)
        settings = resident.mesh.settings

        def check() -> None:
            if self.found(asset) is not resident or resident.mesh.settings is not settings:
                raise Evicted

        with self._device.in_steps(self._steps(asset.id), check):
            yield resident

    @contextmanager
    def in_steps(self) -> Iterator[None]:
        """Let this thread use the device in steps within the block, for work of no asset that is on
        it; other tasks run between them."""
        with self._device.in_steps(self._steps()):
            yield

    def _steps(self, turn: Hashable = None) -> Callable[..., Any]:
        """Runs steps in a turn. Where nobody waits for the work of this thread any more, a step
        raises CancelledError, once: the steps after it give back."""
        leaving = False

        def step(task: Callable[..., T], *arguments: Any) -> T:
            nonlocal leaving
            if not leaving and call_context.is_abandoned():
                leaving = True
                call_context.check_abandoned()
            return self._worker.call_patiently(lambda: self._whole(task, arguments), turn=turn)

        return step

    def make_bins(self, asset: Asset, address: TileAddress) -> None:
        """Make the precomputed maps of a tile in steps, unless they are there; nothing is kept
        where the asset is dropped or its settings change meanwhile."""
        self._make(asset, DeferredWork(bins=[address]))

    def _make(self, asset: Asset, deferred: DeferredWork) -> None:
        """Do the work that a task deferred. Of one asset one thread works at a time, so that
        another one that needs the same finds it made."""
        while not asset.making.acquire(timeout=call_context.LOOK):
            call_context.check_abandoned()
        try:
            with suppress(Evicted), self.stepwise(asset) as resident:
                resident.make(deferred)
        finally:
            asset.making.release()

    def place(
        self, mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings,
        stiffness: Stiffness | None, residual: Residual | None = None,
    ) -> DeviceAsset:  # fmt: skip
        """The parts of a mesh on the device, with the triangles of its pores and wrinkles. To be
        followed by `finish` or `give_up`."""
        with self.in_steps():
            made = DeviceAsset(self._device, mesh, settings, stiffness, residual)
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
            with self.in_steps():
                elements = made.mesh.upload(prepared, settings)
            self.run_patiently(made.mesh.take, elements, settings)
            with self._ahead.noting():
                self.run_patiently(made.warm_up)
            with asset.kept():
                self.run_patiently(self._device.budget.keep, _key(asset), lambda: made)
                asset.on_device = made
        except BaseException:
            self.give_up(made)
            raise

    def give_up(self, made: DeviceAsset) -> None:
        """Free the parts that `place` made."""
        self.run_patiently(made.release)

    def drop(self, asset: Asset) -> None:
        """Free the parts of an asset for good, and spare buffers beyond the bytes that are in use:
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
            made = self.place(
                stored.mesh, stored.graph, asset.settings, stored.stiffness, stored.residual
            )
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
