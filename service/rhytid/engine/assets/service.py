"""Creates, describes, changes, calibrates and removes assets."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from contextlib import nullcontext, suppress
from dataclasses import replace
from typing import Any, TypeVar

from numpy.typing import ArrayLike
from typing_extensions import override

from rhytid.domain.asset_settings import MOST_WRINKLES, AssetSettings
from rhytid.domain.expressions import Expressions
from rhytid.domain.graph import GraphOrigin, WrinkleGraph
from rhytid.domain.graph_geometry import Curves, graph_curves, with_triangles
from rhytid.domain.mesh import Mesh
from rhytid.domain.notices import preset_notice, redrawn_notice
from rhytid.domain.settings_changes import CHANGEABLE
from rhytid.engine.assets.asset import Asset, AssetRegistry
from rhytid.engine.assets.builder import AssetBuilder
from rhytid.engine.assets.creation import AssetCreation
from rhytid.engine.assets.on_device import DeviceAssets
from rhytid.engine.byte_budget import Hold
from rhytid.engine.frame_service import checked_frame
from rhytid.engine.frames import Frame
from rhytid.engine.job import Job
from rhytid.engine.jobs import Jobs
from rhytid.engine.keys import content_key
from rhytid.engine.messages import (
    AssetContent,
    AssetDimensions,
    AssetInfo,
    FollowedAsset,
    JobInfo,
    NewAsset,
)
from rhytid.engine.operations import Assets
from rhytid.engine.shared_assets import SharedAssets
from rhytid.errors import NotFoundError, SettingsError
from rhytid.pipeline.stretch import r_max_of
from rhytid.storage.records import StoredAsset
from rhytid.storage.store import AssetStore

T = TypeVar("T")


class AssetService(Assets):
    """Creates assets from uploads; describes, changes, calibrates and removes them."""

    def __init__(
        self,
        registry: AssetRegistry,
        creation: AssetCreation,
        on_device: DeviceAssets,
        store: AssetStore,
        shared: SharedAssets,
        builder: AssetBuilder,
        jobs: Jobs,
    ) -> None:
        self._assets, self._creation, self._on_device = registry, creation, on_device
        self._store, self._shared = store, shared
        self._builder, self._jobs = builder, jobs

    @override
    def create(
        self,
        new: NewAsset,
        *,
        strict: bool = False,
        allow: Collection[str] = (),
        hold: Hold | None = None,
    ) -> AssetInfo:
        asset, warnings = self._creation.take(new, strict, allow, hold)
        info = asset.info()
        warned, told = (*info.warnings, *warnings), (*info.notices, *new.notices)
        return replace(info, warnings=warned, notices=told)

    @override
    def all(self) -> list[AssetInfo]:
        return [asset.info() for asset in self._assets.all()]

    @override
    def info(self, asset: str) -> AssetInfo:
        return self._assets.get(asset).info()

    @override
    def dimensions(self, asset: str) -> AssetDimensions:
        return self._assets.get(asset).dimensions

    @override
    def change(self, asset: str, changes: Mapping[str, Any]) -> AssetInfo:
        found = self._assets.get(asset)
        found.check_ready()
        for key in changes:
            if key in AssetSettings.__dataclass_fields__ and key not in CHANGEABLE:
                raise SettingsError(f"{key} is fixed once an asset is made: make a new one")
        with found.lock:
            found.check_ready()
            before = found.settings
            after = before.changed(changes).with_lengths(found.lengths)
            self._builder.change(found, after)
        self._builder.prepare_bins(found)
        info, notices = found.info(), preset_notice(before, after, changes)
        if found.residual is not None:
            notices += redrawn_notice(before, after)
        return replace(info, notices=(*info.notices, *notices))

    def resized(self, asset: str, resolution: int) -> AssetInfo:
        """Create an asset of the skin of a ready one at another resolution: its mesh, wrinkles,
        stiffness, residual, which is resampled, and present settings; nothing is synthesised.
        Raises what `create` does."""
        found = self._assets.get(asset)
        graph, stored = self.graph(asset), self._store.asset(asset)
        side = min(found.settings.tile_size, resolution)
        grown = found.settings.graph
        if grown.density != 1.0:  # part of the spacing that the graph itself says
            grown = replace(grown, spacing=None)
        settings = replace(found.settings, resolution=resolution, tile_size=side, graph=grown)
        residual = None if stored.residual is None else stored.residual.resized(resolution)
        new = NewAsset(stored.mesh, settings, graph, stiffness=stored.stiffness, residual=residual)
        return self.create(new)

    def expected_wrinkles(self, asset: str) -> int | None:
        """How many wrinkles grow in a build of this process; None where nobody has counted."""
        expected = self._assets.get(asset).expected_wrinkles
        return expected if expected < MOST_WRINKLES else None

    @override
    def delete(self, asset: str, *, shared: bool = False) -> None:
        found = self._assets.find(asset)
        if found is not None:
            self._delete(found)
        if shared:
            with suppress(NotFoundError) if found is not None else nullcontext():
                self._shared.remove(asset)
        elif found is None:
            raise NotFoundError(f"no asset {asset!r}")

    @override
    def follow(self, asset: str, *, replace: bool) -> FollowedAsset | None:
        self._shared.look_anew(asset)
        found = self._assets.find(asset)
        if found is not None and not self._followed(found, replace):
            return None
        now = self._assets.get(asset)
        if now.state == "failed":
            with suppress(NotFoundError):  # another machine may have built it
                now = self._assets.elsewhere(asset)
        with now.lock:
            manifest = self._shared.manifest(asset) if now.state == "ready" else ""
            return FollowedAsset(now.info(), manifest, replaced=now is not found)

    @override
    def leave(self, asset: str) -> bool:
        found = self._assets.find(asset)
        return found is None or self._shared.leave(found)

    def _followed(self, found: Asset, replace: bool) -> bool:
        """Give an asset the settings that the shared store has, or take it out to be fetched;
        False where that is not allowed."""

        def use(settings: AssetSettings) -> None:
            self._builder.use(found, settings)
            self._builder.prepare_bins(found)

        with found.lock:
            if found.state != "ready":
                return True
            try:
                return self._shared.follow(found, use, replace=replace)
            except NotFoundError:
                self._delete(found)
                raise

    def _delete(self, found: Asset) -> None:
        asset = found.id
        with found.lock:
            found.check_known()
            with suppress(NotFoundError):  # a cancelled build has left nothing in the store
                self._store.delete(asset)
            found.state = "removed"
            self._jobs.cancel_all(asset)
            self._assets.replace(found, None)
        self._builder.allow(asset)
        found.frames.close()
        self._on_device.drop(found)

    @override
    def content(self, asset: str) -> AssetContent:
        found = self._assets.get(asset)
        found.check_ready()
        files = self._store.contents(asset)
        lengths = found.settings.lengths(found.lengths.spacing)
        digests = {name: file.sha256 for name, file in files.items()}
        key = content_key(asset, digests, found.settings.length_unit, lengths)
        return AssetContent(key, sum(file.nbytes for file in files.values()))

    @override
    def graph(self, asset: str) -> WrinkleGraph:
        found = self._assets.get(asset)
        found.check_ready()
        stored = self._store.asset(asset)
        lengths = found.settings.lengths(found.lengths.spacing)
        settings = found.settings
        unit, seed, graph = settings.length_unit, settings.graph.start, stored.graph
        origin = GraphOrigin.of(stored.mesh, unit, lengths, seed, graph.origin)
        return graph.with_origin(origin)

    @override
    def mesh(self, asset: str) -> Mesh:
        self._assets.get(asset).check_ready()
        return self._store.mesh(asset)

    @override
    def shapes(self, asset: str) -> Expressions:
        return self._of_shapes(asset, self._store.shapes)

    @override
    def shapes_nbytes(self, asset: str) -> int:
        return self._of_shapes(asset, self._store.shapes_nbytes)

    def _of_shapes(self, asset: str, find: Callable[[str], T]) -> T:
        self._assets.get(asset).check_ready()
        try:
            return find(asset)
        except NotFoundError:
            raise NotFoundError(
                f"asset {asset} has no named shapes: send its mesh again with the part shapes"
            ) from None

    def stored(self, asset: str) -> StoredAsset:
        """What the store has of a ready asset."""
        self._assets.get(asset).check_ready()
        return self._store.asset(asset)

    @override
    def curves(self, asset: str) -> Curves:
        resident = self._on_device.loaded(self._assets.get(asset))
        stored = self._store.asset(asset)
        triangles = len(stored.mesh.faces)
        placed = with_triangles(stored.graph, resident.mesh.pore_triangle, triangles)
        return graph_curves(stored.mesh, placed)

    @override
    def calibrate(
        self,
        asset: str,
        positions: ArrayLike,
        *,
        strict: bool = False,
        allow: Collection[str] = (),
    ) -> JobInfo:
        found = self._assets.get(asset)
        found.check_ready()
        name = "frame of the calibration"
        frame, warnings = checked_frame(found, positions, name, strict, allow, calibrates=True)
        work = _Calibration(found, frame, self._on_device, self._builder)
        job = self._jobs.start("calibration", asset, work, small=found.small)
        job.update(warnings=warnings)
        return job.info


class _Calibration:
    """The work of a job: sets r_max of a ready asset from a frame (section 2.4), then makes its
    precomputed maps anew, which may give way to other jobs."""

    def __init__(
        self, asset: Asset, frame: Frame, on_device: DeviceAssets, builder: AssetBuilder
    ) -> None:
        self._asset, self._frame = asset, frame
        self._on_device, self._builder = on_device, builder
        self._changed = False

    def __call__(self, job: Job) -> None:
        """Measure the frame, unless that was done before the job gave way; then make the maps."""
        if not self._changed:
            self._measure(job)
            self._changed = True
        self._builder.make_bins(job, self._asset)

    def _measure(self, job: Job) -> None:
        job.progress(0.0, "measuring stretch")
        asset = self._asset
        ratios, _ = self._on_device.use(
            asset, lambda resident: resident.frames.ratios(self._frame), patiently=True
        )
        job.check()
        with asset.kept():
            limit = asset.settings.response.log_stretch_limit
            self._builder.change(asset, asset.settings.with_r_max(r_max_of(ratios, limit)))
