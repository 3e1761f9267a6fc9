"""A replica: the engine of one device, and what it lacks fetched on first use."""

from __future__ import annotations

import asyncio
import logging
import os
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial

from ray import serve

from rhytid.device.figures import SIZE
from rhytid.errors import DeviceLostError, RhytidError
from rhytid.fleet.envelopes import Addressed, Parcel
from rhytid.fleet.fleet_store import FleetStore
from rhytid.fleet.frame_registry import Report
from rhytid.fleet.frame_sync import FrameSync
from rhytid.fleet.jobs import JobNames
from rhytid.fleet.local_place import LocalPlace
from rhytid.fleet.options import FleetOptions
from rhytid.fleet.remote_registry import RemoteFrameRegistry
from rhytid.fleet.replica_assets import ReplicaAssets
from rhytid.fleet.replica_calls import ReplicaCalls
from rhytid.processes.envelope import Answer, Envelope, answered
from rhytid.processes.placement import found_devices, named_devices, settings_of
from rhytid.processes.remote_engine import RemoteEngine
from rhytid.support.build_identity import drawing_version
from rhytid.support.logs import log_to_stderr
from rhytid.support.settings import ServiceSettings

# Seconds between two reports, and two exchanges of frames with the board; and for which the device
# may compute nothing.
REPORT, ILL = 2.0, 120.0
_log = logging.getLogger(__name__)


class EngineReplica:
    """One replica of the deployment.  limit: bytes of the frames of all replicas."""

    def __init__(self, settings: ServiceSettings, options: FleetOptions, limit: int) -> None:
        context = serve.get_replica_context()
        self._name = context.replica_id.unique_id
        log_to_stderr(settings.log_format, logging.INFO, f"replica {self._name}")
        self._place = LocalPlace(options.local)
        store = FleetStore.opened(settings, options)
        own = replace(
            _of_device(settings, self._place.number),
            store=self._place.store,
            shared_store=store.place,
            in_step=True,
        )
        self._engine = RemoteEngine(own)
        self._registry = RemoteFrameRegistry(context.app_name, limit)
        frames = FrameSync(self._engine.frames, self._registry)
        store.files.sweep()
        names = JobNames(store.files.job_key())
        self._assets = ReplicaAssets(self._engine, store, frames, names, self._name, options.assets)
        self._calls = ReplicaCalls(self._engine, self._assets, frames, names, self._name)
        self._pool = ThreadPoolExecutor(options.calls, "rhytid-call")
        self._closing = threading.Event()
        self._well = time.monotonic()
        reported = threading.Event()
        for work, name in (
            (partial(self._keep_reporting, reported), "rhytid-report"),
            (partial(self._keep_exchanging, frames), "rhytid-frames"),
        ):
            threading.Thread(target=work, name=name, daemon=True).start()
        reported.wait(REPORT)  # so that it is known before it is asked

    async def call(self, call: Addressed) -> Parcel:
        """Perform a call; errors of the engine are answers, too. Where the caller does not wait any
        more, drawing stops at its next piece."""
        gone = threading.Event()
        loop = asyncio.get_running_loop()
        try:
            work = partial(self._performed, call, gone.is_set)
            return await loop.run_in_executor(self._pool, work)
        except asyncio.CancelledError:
            gone.set()
            raise

    async def check_health(self) -> None:
        """Asked by Ray: raises where the device has not computed for long. Its process is started
        again before by its supervisor."""
        if await asyncio.to_thread(self._engine.ready):
            self._well = time.monotonic()
        if time.monotonic() - self._well > ILL:
            raise DeviceLostError(f"the device has not computed for {ILL:.0f} s")

    def __del__(self) -> None:
        """Ray ends the replica."""
        closing = getattr(self, "_closing", None)
        if closing is not None:
            closing.set()
            self._assets.close()
            self._engine.close()
            self._place.close()

    def _performed(self, call: Addressed, gone: Callable[[], bool]) -> Parcel:
        def perform(envelope: Envelope) -> Answer:
            self._check(envelope)
            return self._calls.perform(envelope, call.asset, call.to)

        return Parcel.of(answered(call.parcel.open(), perform, gone))

    def _check(self, envelope: Envelope) -> None:
        """Raise DeviceLostError where the ingress is of another build: other replicas, of the same
        as the ingress, would draw other maps."""
        if envelope.drawing != drawing_version():
            raise DeviceLostError(
                f"replica {self._name} draws as {drawing_version()}, the ingress as "
                f"{envelope.drawing}: install the same rhytid on all machines of the fleet"
            )

    def _keep_reporting(self, reported: threading.Event) -> None:
        while not self._closing.is_set():
            self._report()
            reported.set()
            self._closing.wait(REPORT)

    def _keep_exchanging(self, frames: FrameSync) -> None:
        while not self._closing.wait(REPORT):
            self._exchange(frames)

    def _exchange(self, frames: FrameSync) -> None:
        try:
            frames.exchange()
        except RhytidError as error:
            _log.warning("frames are exchanged with the board later: %s", error)
        except Exception:  # noqa: BLE001 the next exchange may do
            _log.exception("frames cannot be exchanged with the board")

    def _report(self) -> None:
        try:
            self._registry.report(self._said())
        except RhytidError as error:
            _log.warning("the replica cannot report: %s", error)
        except Exception:  # noqa: BLE001 a replica that does not report is taken for gone
            _log.exception("the replica cannot report")

    def _said(self) -> Report:
        device = next(one for one in self._engine.devices() if one.selected)
        figures = next(iter(self._engine.figures.values()), None)
        memory = bytes(SIZE) if figures is None else figures.copied()
        return Report(self._name, os.getpid(), device, memory, self._engine.restarts)


def _of_device(settings: ServiceSettings, number: int) -> ServiceSettings:
    """The settings of the replica that is the nth of its machine: its device is the nth of those
    that are named."""
    if not settings.devices:
        return settings
    chosen = named_devices(settings.devices, found_devices())
    one = settings_of(chosen[number % len(chosen)], chosen, settings)
    return replace(one, devices=())
