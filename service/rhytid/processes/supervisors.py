"""The processes of all devices of a server; each asset is on one device."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from typing import Any

from rhytid.engine.changes import Mark
from rhytid.engine.messages import NewAsset
from rhytid.engine.operations import OPERATIONS
from rhytid.errors import DeviceLostError, NotFoundError, StorageError
from rhytid.processes.device_process import DeviceProcess
from rhytid.processes.envelope import Request
from rhytid.processes.keyed_locks import KeyedLocks
from rhytid.processes.placement import Placement, found_devices, named_devices, settings_of
from rhytid.processes.supervisor import Supervisor
from rhytid.storage.homes import ID
from rhytid.storage.snapshots import OpenFile, asset_of
from rhytid.storage.store import AssetStore
from rhytid.support.settings import ServiceSettings

Prepare = Callable[[DeviceProcess], None]
# Called with a process that has ended, and with a function that says whether an asset was its.
OnEnd = Callable[[DeviceProcess, Callable[[str], bool]], None]
# Bytes that a wrinkle takes on the device, about; how many there are, about, where no setting says.
_WRINKLE, _WRINKLES = 64, 300_000
# Bytes that a texel of a residual takes there.
_CODE = 2


class Supervisors:
    """What `Supervisor` is, of one device or of those that `settings.devices` names.

    With several, a new asset goes to the device that has most room, and each process opens its
    assets of the store alone, which this holds open. Raises NoDeviceError for a device that there
    is not, and what opening a store does.
    """

    def __init__(
        self,
        settings: ServiceSettings,
        on_message: Callable[[Any], None],
        on_end: OnEnd,
        builds: Callable[[], dict[str, str]] = dict,
    ) -> None:
        self._store: AssetStore | None = None
        self._shared = settings.shared_store is not None
        self._placement, self._on_end = Placement([0]), on_end
        # An asset is placed or removed by one thread at a time.
        self._changing = KeyedLocks()
        if not settings.devices:
            ended = partial(self._one_ended, 0)
            self.all = [Supervisor(settings, on_message, ended, builds=builds)]
            return
        chosen = named_devices(settings.devices, found_devices())
        each = [settings_of(one, chosen, settings) for one in chosen]
        self._placement = Placement([one.device_memory or 0 for one in each])
        self._store = AssetStore(settings.store)
        for asset, nbytes in sorted(_sizes(self._store), key=lambda found: -found[1]):
            self._placement.place(asset, nbytes)
        self.all = [
            Supervisor(
                one,
                on_message,
                partial(self._one_ended, number),
                partial(self._placement.on, number),
                builds,
            )
            for number, one in enumerate(each)
        ]

    def _one_ended(self, number: int, process: DeviceProcess) -> None:
        self._on_end(process, lambda asset: (self._placement.of(asset) or 0) == number)

    @property
    def waiting(self) -> int:
        """Calls that are not answered yet."""
        return sum(one.waiting for one in self.all)

    @property
    def restarts(self) -> Counter[str]:
        """How often the processes were started again, by what had ended them."""
        return sum((one.restarts for one in self.all), Counter[str]())

    @property
    def well(self) -> bool:
        """Whether every device's process is looked after, and one of them answers, or did of
        late."""
        return all(one.runs for one in self.all) and any(one.well for one in self.all)

    def start(self) -> None:
        """Wait until every first process answers; raises what one ended with, else."""
        for one in self.all:
            one.start()

    def close(self) -> None:
        """End the processes, in bounded time."""
        with ThreadPoolExecutor(len(self.all)) as pool:
            list(pool.map(Supervisor.close, self.all))
        if self._store is not None:
            self._store.close()

    def mark(self, asset: str, frame: str) -> Mark | None:
        """As `Supervisor.mark`; None for an asset that is on none of several devices: what one of
        them counts says nothing of another that fetches the asset."""
        if self._placement.of(asset) is None and len(self.all) > 1:
            return None
        return self._of(asset).mark(asset, frame)

    def forget(self, asset: str) -> None:
        """As `Supervisor.forget`."""
        self._of(asset).forget(asset)

    def ask(self, process: DeviceProcess, request: Request) -> Any:
        """As `Supervisor.ask`."""
        return self._of(request.asset).ask(process, request)

    def call(self, request: Request, prepare: Prepare | None = None) -> Any:
        """As `Supervisor.call`, of the device that has the asset."""
        if len(self.all) == 1:
            return self.all[0].call(request, prepare)
        operation = request.operation
        if operation.addresses == "content":
            asset, nbytes = _content(request.positional[0])
            return self._placed_as(asset, nbytes, request, prepare)
        if operation.addresses == "assets":
            # All or none: a list without the assets of a device that is lost would say that they
            # are gone.
            return [info for one in self.all for info in one.call(Request(operation))]
        if operation.addresses == "job":
            return self._of_job(request)
        if (operation.addresses, operation.effect) == ("asset", "remove"):
            return self._deleted(request)
        if self._shared and request.asset and self._placement.of(request.asset) is None:
            return self._fetched(request, prepare)
        return self._of(request.asset).call(request, prepare)

    def _of(self, asset: str) -> Supervisor:
        """The device of an asset; any, where it has none: its process says that it is not known."""
        return self.all[self._placement.of(asset) or 0]

    def _of_job(self, request: Request) -> Any:
        """The answer of the process that knows a job: that of its asset, where that is known; else
        all are asked, those that run first. Raises DeviceLostError where none knows it and one did
        not answer: the job may be there."""
        number = self._placement.of(request.of)
        if number is not None:
            return self.all[number].call(request)
        lost: DeviceLostError | None = None
        for one in sorted(self.all, key=lambda one: one.ready is None):
            try:
                return one.call(Request(request.operation, request.positional))
            except DeviceLostError as error:  # noqa: PERF203 a handful of devices
                lost = error
            except NotFoundError as error:
                missing = error
        raise lost or missing

    def _fetched(self, request: Request, prepare: Prepare | None) -> Any:
        """The answer to a request for an asset that may be in the shared store alone, of a size
        that is not known yet."""
        asset = request.asset
        if ID.fullmatch(asset):
            # Asked for apart: whoever sends a frame holds a lock of it, and none waits for that
            # while the asset is placed.
            looked = Request(OPERATIONS["assets.info"], (asset,))
            self._placed_as(asset, _WRINKLE * _WRINKLES, looked, None)
        return self._of(asset).call(request, prepare)

    def _placed_as(self, asset: str, nbytes: int, request: Request, prepare: Prepare | None) -> Any:
        with self._changing.holding(asset):
            number, new = self._placement.place(asset, nbytes)
            try:
                return self.all[number].call(request, prepare)
            except BaseException:
                if new and not self._knows(number, asset):
                    self._placement.forget(asset)
                raise

    def _deleted(self, request: Request) -> Any:
        """The answer to a request that removes an asset: it then has no device."""
        asset = request.asset
        with self._changing.holding(asset):
            try:
                answer = self._of(asset).call(request)
            except NotFoundError:
                self._gone(asset)
                raise
            self._gone(asset)
            return answer

    def _gone(self, asset: str) -> None:
        self.forget(asset)  # while it is known whose asset it was
        self._placement.forget(asset)

    def _knows(self, number: int, asset: str) -> bool:
        try:
            self.all[number].call(Request(OPERATIONS["assets.info"], (asset,)))
        except NotFoundError:
            return False
        except Exception:  # noqa: BLE001 the caller gets the first error
            return True
        return True


def _content(content: NewAsset | OpenFile) -> tuple[str, int]:
    """The id of what is sent, a mesh or a snapshot, and the bytes that it will take."""
    # Imported here: with one device, this process imports nothing that computes.
    from rhytid.engine.assets.upload import content_id

    if isinstance(content, OpenFile):
        descriptor = content.descriptor
        return asset_of(OpenFile(descriptor)), os.fstat(descriptor).st_size
    mesh, wrinkles = content.mesh, content.settings.graph.wrinkles or _WRINKLES
    own = sum(array.nbytes for array in (mesh.positions, mesh.faces, mesh.uv, mesh.face_uv))
    if content.graph is not None:
        wrinkles = content.graph.wrinkles
    residual, scan = content.residual, content.scan
    scanned = residual.codes if residual is not None else {} if scan is None else scan.maps
    own += sum(_CODE * map.size for map in scanned.values())
    return content_id(content), own + _WRINKLE * wrinkles


def _sizes(store: AssetStore) -> Iterator[tuple[str, int]]:
    """Assets of a store and their bytes there; 0 of what cannot be read."""
    for asset in (*store.ids(), *store.pending()):
        nbytes = 0
        with suppress(StorageError, NotFoundError):
            nbytes = sum(file.nbytes for file in store.contents(asset).values())
        yield asset, nbytes
