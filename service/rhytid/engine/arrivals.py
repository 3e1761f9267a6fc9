"""How assets come to be known: sent by a caller, or found in the store after a restart."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.folds import Folds
from rhytid.domain.frame_warnings import FrameCheck
from rhytid.domain.mesh import Mesh
from rhytid.domain.mesh_warnings import mesh_warnings
from rhytid.domain.texel_sizes import usual_uv_length
from rhytid.domain.tiles import mesh_udims
from rhytid.domain.warnings import InputWarning
from rhytid.engine.assets import Asset
from rhytid.engine.core import EngineCore
from rhytid.engine.frame_calls import put_frame
from rhytid.engine.frames import Frames
from rhytid.engine.given_graphs import graph_lengths
from rhytid.engine.jobs import Job
from rhytid.engine.messages import NewAsset
from rhytid.errors import StorageError
from rhytid.settings import ServiceSettings
from rhytid.storage.records import StoredAsset

Positions = Sequence[NDArray[np.float32]]
Warnings = tuple[InputWarning, ...]
Work = Callable[[Job], None]
_log = logging.getLogger(__name__)


class AssetArrivals(EngineCore):
    """Makes assets known and queues what brings them to the device."""

    def __init__(self, settings: ServiceSettings) -> None:
        super().__init__(settings)
        for id in self._store.ids():
            self._reload(id)
        for id in self._store.pending():
            self._resume(id)

    def _welcome(
        self,
        id: str,
        new: NewAsset,
        warnings: Warnings,
        frames: Positions,
        folds: Folds | None = None,
    ) -> Asset:
        """Keep what was sent, and what expressions leave of it, and build it; where the store has
        it built already, load it."""
        stored = self._intact(id)
        if stored is not None:
            return self._load(id, stored, frames)
        self._store.put_request(
            id, new.mesh, new.settings, new.graph, new.stiffness, new.controls, folds
        )
        return self._build(id, new.mesh, new.settings, warnings, frames)

    def _intact(self, id: str) -> StoredAsset | None:
        """The built asset of the store, for it was sent again: a damaged one is removed, damaged
        settings of an intact one are those that it was built with."""
        if id not in self._store.ids():
            return None
        try:
            stored = self._store.asset(id)
        except StorageError as error:
            _log.error("asset %s is built anew: %s", id, error)
            self._store.delete(id)
            return None
        try:
            self._store.overlay(id)
        except StorageError as error:
            _log.error("asset %s has the settings again that it was built with: %s", id, error)
            self._store.put_overlay(id, stored.settings)
        return stored

    def _build(
        self,
        id: str,
        mesh: Mesh,
        settings: AssetSettings,
        warnings: Warnings,
        frames: Positions = (),
    ) -> Asset:
        asset = self._asset(id, mesh, settings)
        asset.warnings = warnings
        self._begin("build", asset, lambda job: self._builder.build(job, asset), frames)
        return asset

    def _load(self, id: str, stored: StoredAsset, frames: Positions = ()) -> Asset:
        spacing, distance = float(stored.extra["spacing"]), stored.extra.get("distance")
        settings = self._store.overlay(id) or stored.settings
        lengths = graph_lengths(stored.graph, settings, spacing, spacing)
        asset = self._asset(id, stored.mesh, settings.with_lengths(lengths))
        asset.lengths, asset.distance = lengths, None if distance is None else float(distance)
        asset.warnings = _kept_warnings(stored)
        self._begin("load", asset, lambda job: self._builder.load(job, asset), frames)
        return asset

    def _begin(self, kind: str, asset: Asset, work: Work, frames: Positions) -> None:
        put_frames = self._frames_work(asset, frames)

        def both(job: Job) -> None:
            work(job)
            put_frames(job)

        # Known first: a build stops where its asset is not the one that its id stands for.
        self._assets.add(asset)
        asset.job = self._jobs.start(kind, asset.id, both)

    def _reload(self, id: str) -> None:
        """Know a stored asset; a damaged one as failed."""
        try:
            self._load(id, self._store.asset(id))
        except StorageError as error:
            self._give_up(id, error)

    def _resume(self, id: str) -> None:
        """Know an asset that was sent and never finished; a damaged one as failed."""
        try:
            request = self._store.request(id)
        except StorageError as error:
            self._give_up(id, error)
            return
        unit, resolution = request.settings.length_unit, request.settings.resolution
        warnings = mesh_warnings(request.mesh, unit, resolution)
        self._build(id, request.mesh, request.settings, warnings)

    def _give_up(self, id: str, error: StorageError) -> None:
        """Know a damaged asset as failed; the log has the file, callers need not."""
        _log.error("asset %s: %s", id, error)
        reason = "damaged in the store: send it again"
        self._assets.add(Asset.failed(id, reason, self._assets.frame_memory))

    def _asset(self, id: str, mesh: Mesh, settings: AssetSettings) -> Asset:
        return Asset(
            id=id,
            settings=settings,
            vertices=len(mesh.positions),
            triangles=len(mesh.faces),
            udims=mesh_udims(mesh),
            frames=Frames(self._assets.frame_memory),
            centre=mesh.centre,
            uv_length=usual_uv_length(mesh),
            frame_check=FrameCheck(mesh, settings.length_unit),
        )

    def _frames_work(self, asset: Asset, frames: Positions) -> Work:
        def work(job: Job) -> None:
            for index, positions in enumerate(frames):
                job.progress(0.0, "frames", f"{index + 1} of {len(frames)}")
                put_frame(self._builder.on_device, asset, f"{index:04d}", positions)

        return work


def _kept_warnings(stored: StoredAsset) -> Warnings:
    """Those of a stored asset; found anew for one of a version that kept none."""
    kept = stored.extra.get("warnings")
    if kept is None:
        return mesh_warnings(stored.mesh, stored.settings.length_unit, stored.settings.resolution)
    return tuple(InputWarning(**warning) for warning in kept)
