"""What a replica answers: the calls of the engine, on assets and frames that it sees to first."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from rhytid.engine.frames import Frame, refuse_neutral
from rhytid.engine.messages import ENDED_STATES, AssetInfo, FrameInfo, JobInfo
from rhytid.fleet.frame_sync import FrameSync
from rhytid.fleet.jobs import JobName, JobNames, ReplicaNames
from rhytid.fleet.replica_assets import ReplicaAssets
from rhytid.processes.envelope import Answer, Envelope
from rhytid.processes.job_ledger import resumed
from rhytid.processes.remote_engine import RemoteEngine


class ReplicaCalls:
    """Performs calls.  replica: its name, which ids of jobs hold."""

    def __init__(
        self,
        engine: RemoteEngine,
        assets: ReplicaAssets,
        frames: FrameSync,
        names: JobNames,
        replica: str,
    ) -> None:
        self._engine, self._assets, self._frames = engine, assets, frames
        self._names, self._replica = names, replica
        self._seen_as = ReplicaNames(names, replica, engine.jobs.info)
        # Calls that change what all replicas share. All others go to the engine as they are.
        self._own: dict[str, Callable[..., Any]] = {
            "assets.change": assets.change,
            "assets.calibrate": assets.calibrate,
            "assets.delete": assets.delete,
            "packages.of": assets.package,
            "snapshots.of": assets.snapshot,
            "snapshots.restore": assets.restore,
        }

    def perform(self, envelope: Envelope, asset: str, to: str) -> Answer:
        """What the engine answers, with the version of a frame that it stored or removed; raises
        what the engine raises, and ElsewhereError.

        asset: what the call is about.  to: the replica that the asset was asked for at before.
        """
        operation = envelope.operation
        if operation.addresses == "engine":
            return Answer(True, envelope.perform(self._engine))
        if operation.addresses == "job":
            return Answer(True, self._job(envelope, to))
        if operation.name == "assets.create":
            new = envelope.positional[0]
            return Answer(True, self._seen(self._assets.create(new, to, **envelope.named)))
        with self._assets.loaded.using(asset, to, mend=operation.mends):
            way = (operation.addresses, operation.effect)
            if way == ("frame", "change"):
                return self._put(*envelope.positional, **envelope.named)
            if way == ("frame", "remove"):
                return self._remove(envelope.version, *envelope.positional)
            return Answer(True, self._seen(self._done(envelope, asset)))

    def _done(self, envelope: Envelope, asset: str) -> Any:
        if envelope.operation.addresses == "frames":
            self._frames.bring_all(asset)
        elif envelope.operation.addresses == "frame":
            frame = envelope.positional[1]
            if isinstance(frame, str):
                self._frames.bring(asset, frame, envelope.version)
        own = self._own.get(envelope.name)
        if own is None:
            return envelope.perform(self._engine)
        return own(*envelope.positional, **envelope.named)

    def _put(self, asset: str, name: str, frame: Any, **named: Any) -> Answer:
        given = frame.positions if isinstance(frame, Frame) else frame
        positions = np.asarray(given, np.float32)

        def put() -> tuple[FrameInfo, int]:
            with self._frames.changing(asset):
                info = self._engine.frames.put(asset, name, frame, **named)
                return info, self._frames.keep(asset, name, positions)

        info, version = self._frames.with_room(asset, put)
        return Answer(True, info, version=version)

    def _remove(self, wanted: int, asset: str, name: str) -> Answer:
        self._frames.bring(asset, name, wanted)
        with self._frames.changing(asset):
            self._engine.frames.info(asset, name)  # raises where there is none
            refuse_neutral(name)
            return Answer(True, None, version=self._frames.remove(asset, name))

    def _job(self, envelope: Envelope, to: str) -> JobInfo:
        id = envelope.positional[0]
        name = self._names.read(id)
        cancels = envelope.operation.effect != "read"
        if name.replica == self._replica:
            jobs = self._engine.jobs
            found = jobs.cancel(name.own) if cancels else jobs.info(name.own)
            if found.state in ENDED_STATES:
                self._assets.settle(name.own)
            return self._seen_as.job(found)
        with self._assets.loaded.using(name.asset, to):
            if cancels:
                self._cancel_resumed(name)
            return resumed(name.unknown(id), self._engine.assets.info, self._engine.jobs.info)

    def _cancel_resumed(self, name: JobName) -> None:
        info = self._engine.assets.info(name.asset)
        if info.state == "building" and info.job is not None:
            self._engine.jobs.cancel(info.job)

    def _seen(self, found: Any) -> Any:
        """As callers see it: ids of jobs name this replica."""
        if isinstance(found, JobInfo):
            return self._seen_as.job(found)
        if isinstance(found, tuple) and found and isinstance(found[0], AssetInfo):
            return self._seen_as.asset(found[0]), *found[1:]
        return self._seen_as.asset(found) if isinstance(found, AssetInfo) else found
