"""What a replica answers: the calls of the engine, on assets and frames that it sees to first."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rhytid.engine.frames import refuse_neutral
from rhytid.engine.messages import ENDED_STATES, AssetInfo, FrameInfo, JobInfo, NewAsset
from rhytid.engine_process.job_ledger import resumed
from rhytid.engine_process.remote_engine import RemoteEngine
from rhytid.fleet.envelopes import Envelope
from rhytid.fleet.frame_sync import FrameSync
from rhytid.fleet.jobs import JobName, JobNames, ReplicaNames
from rhytid.fleet.replica_assets import ReplicaAssets

# Calls of parts of the engine, as they are.
PLAIN = {
    "assets": ("info", "content", "graph", "mesh", "shapes", "shapes_nbytes", "curves"),
    "frames": ("warnings",),
    "tiles": ("triangles", "bins", "bin_tile"),
}
# Calls of frames that are there, by asset and name.
_OF_FRAME = ("info", "positions", "stretch")
# Calls that replace or remove what may be damaged.
_MENDING = ("assets.change", "assets.delete", "restore")


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
        self._calls: dict[str, Callable[..., Any]] = {
            "assets.change": assets.change,
            "assets.calibrate": assets.calibrate,
            "assets.delete": assets.delete,
            "packages.of": assets.package,
            "snapshot": assets.snapshot,
            "restore": self._restore,
            "frames.all": self._all_frames,
            "plans_once": self._plans_once,
            "draw_once": self._draw_once,
        }
        for part, plain in PLAIN.items():
            for name in plain:
                self._calls[f"{part}.{name}"] = getattr(getattr(engine, part), name)
        self._of_frame: dict[str, Callable[..., Any]] = {
            f"frames.{name}": getattr(engine.frames, name) for name in _OF_FRAME
        }
        for kind, plan in (("tile", engine.tiles.plan), ("map", engine.tiles.plan_map)):
            self._of_frame[f"plan_{kind}"] = lambda *a, plan=plan: plan(*a[:-1]).facts()
            self._of_frame[f"draw_{kind}"] = lambda *a, plan=plan: _drawn(plan(*a[:-1]))

    def perform(self, envelope: Envelope) -> tuple[Any, int]:
        """What the engine answers, and the version of a frame that it stored or removed, else 0;
        raises what the engine raises, and ElsewhereError."""
        positional, named = envelope.arguments()
        if envelope.name == "ready":
            return self._engine.ready(), 0
        if envelope.name.startswith("jobs."):
            return self._job(envelope, *positional), 0
        if envelope.name == "create":
            return self._seen(self._create(envelope, *positional, **named)), 0
        mend = envelope.name in _MENDING
        with self._assets.loaded.using(envelope.asset, envelope.to, mend=mend):
            if envelope.name == "frames.put":
                return self._put(*positional, **named)
            if envelope.name == "frames.delete":
                return None, self._remove(envelope, *positional)
            if envelope.name in self._of_frame:
                self._frames.bring(positional[0], positional[1], envelope.version)
                return self._of_frame[envelope.name](*positional, **named), 0
            return self._seen(self._calls[envelope.name](*positional, **named)), 0

    def _create(
        self, envelope: Envelope, new: NewAsset, *, strict: bool, allow: Collection[str]
    ) -> AssetInfo:
        return self._assets.create(new, envelope.to, strict=strict, allow=allow)

    def _restore(self, asset: str, name: str, nbytes: int) -> tuple[AssetInfo, bool]:
        info, new = self._assets.restore(asset, name, nbytes)
        return self._seen(info), new

    def _put(
        self, asset: str, name: str, positions: ArrayLike, **named: Any
    ) -> tuple[FrameInfo, int]:
        def put() -> tuple[FrameInfo, int]:
            with self._frames.changing(asset):
                info = self._engine.frames.put(asset, name, positions, **named)
                return info, self._frames.keep(asset, name, np.asarray(positions, np.float32))

        return self._frames.with_room(asset, put)

    def _remove(self, envelope: Envelope, asset: str, name: str) -> int:
        self._frames.bring(asset, name, envelope.version)
        with self._frames.changing(asset):
            self._engine.frames.info(asset, name)  # raises where there is none
            refuse_neutral(name)
            return self._frames.remove(asset, name)

    def _all_frames(self, asset: str) -> list[FrameInfo]:
        self._frames.bring_all(asset)
        return self._engine.frames.all(asset)

    def _plans_once(self, *arguments: Any) -> list[Any]:
        plans: list[Any] = list(self._engine.tiles.plans_once(*arguments))
        return [plan.facts() for plan in plans]

    def _draw_once(self, asset: str, positions: ArrayLike, query: Any, address: Any) -> Any:
        (plan,) = self._engine.tiles.plans_once(asset, positions, query, [address])
        return _drawn(plan)

    def _job(self, envelope: Envelope, id: str) -> JobInfo:
        name = self._names.read(id)
        if name.replica == self._replica:
            jobs = self._engine.jobs
            call = jobs.info if envelope.name == "jobs.info" else jobs.cancel
            found = call(name.own)
            if found.state in ENDED_STATES:
                self._assets.settle(name.own)
            return self._seen_as.job(found)
        with self._assets.loaded.using(name.asset, envelope.to):
            if envelope.name == "jobs.cancel":
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
        return self._seen_as.asset(found) if isinstance(found, AssetInfo) else found


def _drawn(plan: Any) -> tuple[Any, ...]:
    """A tile, what was planned, and the key that there is when it is drawn."""
    tile = plan.draw()
    return tile, plan.facts(), plan.key_now()
