"""Calls that create, change and remove assets: the engine of a replica and the shared folder change
together."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from rhytid.domain.frame import counted_frame
from rhytid.domain.settings_changes import CHANGEABLE
from rhytid.durable import reported
from rhytid.engine import wanted
from rhytid.engine.checked_upload import content_id
from rhytid.engine.messages import AssetInfo, JobInfo, NewAsset, Package
from rhytid.engine_process.remote_engine import RemoteEngine
from rhytid.errors import NotFoundError
from rhytid.fleet.frame_sync import FrameSync
from rhytid.fleet.jobs import JobNames, JobWatch, ReplicaNames
from rhytid.fleet.kept_uploads import read_upload, written_upload
from rhytid.fleet.loaded_assets import LoadedAssets
from rhytid.fleet.shared_folder import SharedFolder


class ReplicaAssets:
    """The assets of one replica.

    replica: its name.  most: assets that stay loaded.
    """

    def __init__(
        self,
        engine: RemoteEngine,
        shared: SharedFolder,
        frames: FrameSync,
        names: JobNames,
        replica: str,
        most: int,
    ) -> None:
        self._engine, self._shared = engine, shared
        self._frames, self._replica = frames, replica
        self._jobs = JobWatch(engine.jobs.info)
        seen = ReplicaNames(names, replica, engine.jobs.info)
        self.residents = LoadedAssets(
            engine, shared, frames, most, replica, self._resume, seen.asset
        )

    def close(self) -> None:
        """Watch jobs no more."""
        self._jobs.close()

    def settle(self, job: str) -> None:
        """Wait until what follows a job that has ended is done: others then see it, too."""
        self._jobs.settle(job)

    def create(
        self, new: NewAsset, gone: str, *, strict: bool, allow: Collection[str]
    ) -> AssetInfo:
        """As `AssetService.create`; what was sent is kept until the asset is shared."""
        asset = content_id(new)
        with self.residents.using(asset, gone, mend=True):
            info = self._engine.assets.create(new, strict=strict, allow=allow)
            with self.residents.changing(asset):
                if self._shared.revision(asset) is None or not self.residents.has(asset):
                    self._begin(info, new)
                elif new.shapes is not None:
                    self._share(asset)
            if info.job is not None:
                self._while_running(asset, info.job)
            self._keep_frames(asset, new)
        return info

    def change(self, asset: str, changes: Mapping[str, Any]) -> AssetInfo:
        """As `AssetService.change`, for every replica."""
        with self.residents.changing(asset):
            info = self._engine.assets.change(asset, changes)
            self._share_settings(asset)
        return info

    def calibrate(self, asset: str, positions: ArrayLike, **named: Any) -> JobInfo:
        """As `AssetService.calibrate`; its settings are shared when it has ended."""
        job = self._engine.assets.calibrate(asset, positions, **named)
        self._jobs.watch(job.id, lambda ended: self._share_settings(asset))
        self._while_running(asset, job.id)  # what is watched first is done first
        return job

    def delete(self, asset: str, *, shared: bool = False) -> None:
        """As `AssetService.delete`, for every replica, whether that is asked for or not."""
        with self.residents.changing(asset):
            there = self._shared.revision(asset) or self._shared.owner(asset)
            self._shared.remove(asset)
            try:
                self._engine.assets.delete(asset)
            except NotFoundError:
                if not there:
                    raise
            self._frames.remove_all(asset)
            self.residents.forget(asset)

    def package(self, asset: str, *arguments: Any) -> Package | JobInfo | None:
        """As `PackageService.of`; the file lies in the shared folder."""
        found = self._engine.packages.of(asset, *arguments)
        if isinstance(found, JobInfo):
            self._while_running(asset, found.id)
        if isinstance(found, Package):
            return self._shared.share_package(asset, found)
        return found

    def snapshot(self, asset: str) -> Path:
        """A snapshot with the present settings, in the shared folder; the caller removes it."""
        with self._engine.snapshots.of(asset) as made:
            path = self._shared.give(made.pieces())
        if wanted.is_gone():  # nobody would remove it
            path.unlink(missing_ok=True)
        wanted.check()
        return path

    def restore(self, asset: str, path: Path, nbytes: int) -> tuple[AssetInfo, bool]:
        """As `SnapshotService.restore`, of a file in the shared folder."""
        with reported(f"{path} cannot be read"), path.open("rb") as stream:
            info, new = self._engine.snapshots.restore(stream, nbytes)
        if new:
            with self.residents.changing(asset):
                self._share(asset)
        return info, new

    def _begin(self, info: AssetInfo, new: NewAsset) -> None:
        """A build was started, or has ended already; it is given up where it cannot be kept."""
        try:
            if info.state == "ready":
                self._share(info.id)
                return
            if self._shared.owner(info.id) != self._replica:
                self._shared.put_upload(info.id, self._replica, written_upload(new))
        except BaseException:
            if not self.residents.has(info.id):
                self._engine.assets.delete(info.id)
            raise
        self.residents.take(info.id)
        if info.job is not None:
            self._jobs.watch(info.job, partial(self._built, info.id))

    def _built(self, asset: str, job: JobInfo | None) -> None:
        with self.residents.changing(asset):
            if not self.residents.has(asset):
                return  # it was removed
            if self._engine.assets.info(asset).state == "ready":
                self._share(asset)
            else:
                self._shared.remove_upload(asset)

    def _share(self, asset: str) -> None:
        with self._engine.snapshots.of(asset) as made:
            placed = self._shared.put_snapshot(asset, made)
        self.residents.take(asset, placed)
        self.residents.describe(asset)

    def _share_settings(self, asset: str) -> None:
        with self.residents.changing(asset):
            settings = self._engine.assets.info(asset).settings
            now = {name: settings[name] for name in CHANGEABLE}
            self.residents.note_settings(asset, self._shared.put_settings(asset, now))
            self.residents.describe(asset)

    def _keep_frames(self, asset: str, new: NewAsset) -> None:
        for index, positions in enumerate(() if new.frames is None else new.frames):
            name = counted_frame(index)
            with self._frames.changing(asset):
                self._frames.keep(asset, name, positions)

    def _while_running(self, asset: str, job: str) -> None:
        """The asset stays until a job of it has ended."""
        release = self.residents.pin(asset)
        self._jobs.watch(job, lambda ended: release())

    def _resume(self, asset: str) -> None:
        """Go on with a build whose replica is gone."""
        try:
            new = read_upload(self._shared.upload(asset))
        except FileNotFoundError:
            return
        self._shared.own(asset, self._replica)
        self._begin(self._engine.assets.create(new), new)
        self._keep_frames(asset, new)
