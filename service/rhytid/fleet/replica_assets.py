"""Calls that create, change and remove assets: the engine of a replica and the shared store change
together."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import partial
from typing import Any

from numpy.typing import ArrayLike

from rhytid.domain.frame import counted_frame
from rhytid.engine import call_context
from rhytid.engine.assets.upload import content_id
from rhytid.engine.messages import AssetInfo, JobInfo, NewAsset, Package
from rhytid.errors import NotFoundError
from rhytid.fleet.fleet_assets import GivenName
from rhytid.fleet.fleet_store import FleetStore
from rhytid.fleet.frame_sync import FrameSync
from rhytid.fleet.jobs import JobNames, JobWatch, ReplicaNames
from rhytid.fleet.loaded_assets import LoadedAssets
from rhytid.fleet.shared_files import read_upload, written_upload
from rhytid.processes.remote_engine import RemoteEngine
from rhytid.storage.snapshots import OpenFile


class ReplicaAssets:
    """The assets of one replica.

    engine: with the shared store of the fleet, in step with it.  replica: its name.  most: assets
    that stay loaded.
    """

    def __init__(
        self,
        engine: RemoteEngine,
        store: FleetStore,
        frames: FrameSync,
        names: JobNames,
        replica: str,
        most: int,
    ) -> None:
        self._engine, self._files = engine, store.files
        self._frames, self._replica = frames, replica
        self._jobs = JobWatch(engine.jobs.info)
        seen = ReplicaNames(names, replica, engine.jobs.info)
        self.loaded = LoadedAssets(engine, store, frames, most, replica, self._resume, seen.asset)

    def close(self) -> None:
        """Watch jobs no more."""
        self._jobs.close()

    def settle(self, job: str) -> None:
        """Wait until what follows a job that has ended is done: others then see it, too."""
        self._jobs.settle(job)

    def create(
        self, new: NewAsset, gone: str, *, strict: bool = False, allow: Collection[str] = ()
    ) -> AssetInfo:
        """Create an asset; the upload is kept until the asset is shared."""
        asset = content_id(new)
        with self.loaded.using(asset, gone, mend=True):
            info = self._engine.assets.create(new, strict=strict, allow=allow)
            with self.loaded.changing(asset):
                self._begin(info, new)
            if info.job is not None:
                self._while_running(asset, info.job)
            self._keep_frames(asset, new)
        return info

    def change(self, asset: str, changes: Mapping[str, Any]) -> AssetInfo:
        """Change the settings of an asset, for every replica."""
        with self.loaded.changing(asset):
            info = self._engine.assets.change(asset, changes)
            self.loaded.see_changed(asset)
        return info

    def calibrate(self, asset: str, positions: ArrayLike, **named: Any) -> JobInfo:
        """Start a calibration; the settings are shared when it has ended."""
        job = self._engine.assets.calibrate(asset, positions, **named)
        self._jobs.watch(job.id, lambda ended: self._see_changed(asset))
        self._while_running(asset, job.id)  # what is watched first is done first
        return job

    def delete(self, asset: str, *, shared: bool = False) -> None:
        """Remove an asset for every replica, whatever `shared` says."""
        with self.loaded.changing(asset):
            sent = self._files.owner(asset)
            try:
                self._engine.assets.delete(asset, shared=True)
            except NotFoundError:
                if sent is None:
                    raise
            self._files.remove(asset)
            self._frames.remove_all(asset)
            self.loaded.forget(asset)

    def package(self, asset: str, *arguments: Any, **named: Any) -> Package | JobInfo | None:
        """The package of an asset, with its file in the shared store, or the job that makes it."""
        found = self._engine.packages.of(asset, *arguments, **named)
        if isinstance(found, JobInfo):
            self._while_running(asset, found.id)
        if isinstance(found, Package):
            return self._files.share_package(asset, found)
        return found

    def snapshot(self, asset: str) -> str:
        """The name of a snapshot with the present settings among the given files; the caller
        removes it."""
        with self._engine.snapshots.of(asset) as made:
            name = self._files.give(made.pieces())
        if call_context.is_abandoned():  # nobody would remove it
            self._files.remove_given(name)
        call_context.check_abandoned()
        return name

    def restore(self, content: GivenName, nbytes: int) -> tuple[AssetInfo, bool]:
        """The asset of a given snapshot, and whether it is new here."""
        with self._files.given(content.name) as stream:
            file = OpenFile(stream.fileno())
            info, new = self._engine.snapshots.restore(file, nbytes)
        if new:
            self._see_changed(content.asset)
        return info, new

    def _begin(self, info: AssetInfo, new: NewAsset) -> None:
        """Keep the upload of a build that was started; without room for it the build is given up. A
        ready asset may have other named shapes now."""
        if info.state == "ready":
            self.loaded.see_changed(info.id)
            return
        try:
            if self._files.owner(info.id) != self._replica:
                self._files.put_upload(info.id, self._replica, written_upload(new))
        except BaseException:
            if not self.loaded.has(info.id):
                self._engine.assets.delete(info.id)
            raise
        self.loaded.take(info.id)
        if info.job is not None:
            self._jobs.watch(info.job, partial(self._built, info.id))

    def _built(self, asset: str, job: JobInfo | None) -> None:
        """A build has ended. Its upload stays until the asset is in the shared store."""
        with self.loaded.changing(asset):
            if not self.loaded.has(asset):
                return  # it was removed
            if self._engine.assets.info(asset).state == "ready":
                self.loaded.see_changed(asset)
            else:
                self._files.remove_upload(asset)

    def _see_changed(self, asset: str) -> None:
        with self.loaded.changing(asset):
            self.loaded.see_changed(asset)

    def _keep_frames(self, asset: str, new: NewAsset) -> None:
        for index, positions in enumerate(() if new.frames is None else new.frames):
            name = counted_frame(index)
            with self._frames.changing(asset):
                self._frames.keep(asset, name, positions)

    def _while_running(self, asset: str, job: str) -> None:
        """The asset stays until a job of it has ended."""
        release = self.loaded.pin(asset)
        self._jobs.watch(job, lambda ended: release())

    def _resume(self, asset: str) -> None:
        """Go on with a build whose replica is gone."""
        data = self._files.upload(asset)
        if data is None:
            return
        new = read_upload(data)
        self._files.own(asset, self._replica)
        self._begin(self._engine.assets.create(new), new)
        self._keep_frames(asset, new)
