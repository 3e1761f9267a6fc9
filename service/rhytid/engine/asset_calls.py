"""Assets and jobs: create, change, calibrate, remove."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.frame import check_positions
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import mesh_udims
from rhytid.engine.assets import Asset
from rhytid.engine.building import check_triangles
from rhytid.engine.core import EngineCore
from rhytid.engine.frame_calls import put_frame
from rhytid.engine.frames import Frame, Frames
from rhytid.engine.jobs import Job
from rhytid.engine.messages import AssetInfo, JobInfo, NewAsset
from rhytid.errors import MeshError, NotFoundError, SettingsError, StorageError
from rhytid.pipeline.stretch import r_max_of
from rhytid.settings import ServiceSettings
from rhytid.storage.contents import asset_id

Positions = Sequence[NDArray[np.float32]]
_log = logging.getLogger(__name__)
# What can change without synthesising or looking up anything again.
CHANGEABLE = ("depth", "response", "shape", "bins", "convolve")


class AssetCalls(EngineCore):
    """The calls about assets and their jobs."""

    def __init__(self, settings: ServiceSettings) -> None:
        super().__init__(settings)
        for id in self._store.ids():
            self._reload(id)
        for id in self._store.pending():
            self._resume(id)

    def create_asset(self, new: NewAsset) -> AssetInfo:
        """Take a mesh in; the build runs as a job. The same content again: the same asset.

        Raises GraphError where a given graph does not fit the mesh, MeshError where the mesh has
        no UV inside the range of UDIMs.
        """
        if new.graph is not None:
            check_triangles(new.graph, len(new.mesh.faces))
        if not mesh_udims(new.mesh):
            raise MeshError("no triangle lies in a UDIM: u goes from 0 to 10, v from 0 up")
        sent = () if new.frames is None else new.frames
        frames = [check_positions(positions, len(new.mesh.positions)) for positions in sent]
        id = asset_id(new.mesh, new.settings, new.graph)
        with self._assets.lock:
            asset = self._assets.find(id)
            if asset is None or asset.state == "failed":
                self._store.put_request(id, new.mesh, new.settings, new.graph)
                asset = self._start(id, new.mesh, new.settings, frames)
            elif frames:
                asset.job = self._jobs.start("frames", id, self._frames_work(asset, frames))
            return asset.info()

    def assets(self) -> list[AssetInfo]:
        """Every asset."""
        return [asset.info() for asset in self._assets.all()]

    def asset(self, asset: str) -> AssetInfo:
        """One asset."""
        return self._assets.get(asset).info()

    def change_asset(self, asset: str, changes: Mapping[str, Any]) -> AssetInfo:
        """Change response, shape, depth, bins or convolve; tiles and their keys change.

        `depth` or `convolve.sigma` null means the default again. Raises SettingsError for what
        cannot be changed.
        """
        found = self._assets.get(asset)
        found.ready()
        for key in changes:
            if key in AssetSettings.__dataclass_fields__ and key not in CHANGEABLE:
                raise SettingsError(f"{key} is fixed once an asset is made: make a new one")
        with found.changing:
            settings = found.settings.changed(changes)
            self._builder.change(found, settings.resolved(found.spacing))
        self._prepare_bins(found)
        return found.info()

    def delete_asset(self, asset: str) -> None:
        """Remove an asset from memory, device and disk; cancels what is being made of it."""
        with self._assets.lock:
            found = self._assets.remove(asset)
            self._store.delete(asset)
        if found.job is not None:
            found.job.cancel()
        found.frames.clear()
        # Behind a build that may still run, in the order of the jobs.
        self._jobs.start("delete", asset, lambda job: self._clear_away(found))

    def graph(self, asset: str) -> WrinkleGraph:
        """The wrinkle graph of a ready asset."""
        self._assets.get(asset).ready()
        return self._store.asset(asset).graph

    def job(self, job: str) -> JobInfo:
        """How far a job is."""
        return self._jobs.get(job).info

    def cancel_job(self, job: str) -> JobInfo:
        """Ask a job to stop at its next step."""
        found = self._jobs.get(job)
        found.cancel()
        return found.info

    def calibrate(self, asset: str, positions: ArrayLike) -> JobInfo:
        """Set r_max from a frame (section 2.4) and make the bins anew, as a job."""
        found = self._assets.get(asset)
        found.ready()
        frame = Frame.of(check_positions(positions, found.vertices))

        def work(job: Job) -> None:
            job.progress(0.0, "measuring stretch")
            ratios, _ = self._builder.on_device(found.ready().stretch, frame)
            with found.changing:
                limit = found.settings.response.log_stretch_limit
                settings = found.settings.with_r_max(r_max_of(ratios, limit))
                self._builder.change(found, settings)
            self._builder.make_bins(job, found)

        return self._jobs.start("calibration", asset, work).info

    def _start(self, id: str, mesh: Mesh, settings: AssetSettings, frames: Positions = ()) -> Asset:
        """Know an asset and queue its build."""
        asset = self._asset(id, mesh, settings)
        put_frames = self._frames_work(asset, frames)

        def work(job: Job) -> None:
            self._builder.build(job, asset)
            put_frames(job)

        asset.job = self._jobs.start("build", id, work)
        self._assets.add(asset)
        return asset

    def _reload(self, id: str) -> None:
        """Know a stored asset and queue its way to the device."""
        try:
            stored = self._store.asset(id)
            settings = self._store.overlay(id) or stored.settings
        except StorageError as error:
            self._give_up(id, error)
            return
        spacing = float(stored.extra["spacing"])
        asset = self._asset(id, stored.mesh, settings.resolved(spacing))
        asset.spacing = spacing
        asset.job = self._jobs.start("load", id, lambda job: self._builder.load(job, asset))
        self._assets.add(asset)

    def _resume(self, id: str) -> None:
        """Queue the build of an asset that was requested and never finished."""
        try:
            request = self._store.request(id)
        except StorageError as error:
            self._give_up(id, error)
            return
        self._start(id, request.mesh, request.settings)

    def _give_up(self, id: str, error: StorageError) -> None:
        """Know a damaged asset as failed; the log has the file, callers need not."""
        _log.error("asset %s: %s", id, error)
        reason = "damaged in the store: delete it and send it again"
        self._assets.add(Asset.failed(id, reason, self._assets.frame_memory))

    def _asset(self, id: str, mesh: Mesh, settings: AssetSettings) -> Asset:
        return Asset(
            id=id,
            settings=settings,
            vertices=len(mesh.positions),
            triangles=len(mesh.faces),
            udims=mesh_udims(mesh),
            frames=Frames(self._assets.frame_memory),
        )

    def _prepare_bins(self, asset: Asset) -> None:
        self._jobs.start("bins", asset.id, lambda job: self._builder.make_bins(job, asset))

    def _frames_work(self, asset: Asset, frames: Positions) -> Callable[[Job], None]:
        def work(job: Job) -> None:
            for index, positions in enumerate(frames):
                job.progress(0.0, "frames", f"{index + 1} of {len(frames)}")
                put_frame(self._builder.on_device, asset, f"{index:04d}", positions)

        return work

    def _clear_away(self, asset: Asset) -> None:
        if asset.resident is not None:
            self._builder.on_device(asset.resident.release)
        with self._assets.lock, suppress(NotFoundError):
            if self._assets.find(asset.id) is None:
                self._store.delete(asset.id)
