"""Assets: create, change, calibrate, remove."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.curves import Curves, graph_curves, with_triangles
from rhytid.domain.expressions import Expressions, grown_from
from rhytid.domain.folds import Folds
from rhytid.domain.frame import check_positions, frame_label
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.graph_origin import GraphOrigin
from rhytid.domain.mesh import Mesh
from rhytid.domain.mesh_warnings import mesh_warnings
from rhytid.domain.settings_changes import CHANGEABLE, settings_changed, settings_unused
from rhytid.domain.texel_sizes import usual_uv_length
from rhytid.domain.tiles import mesh_udims
from rhytid.domain.warnings import InputWarning, check_codes, refuse
from rhytid.engine.asset_builder import AssetBuilder
from rhytid.engine.asset_registry import AssetRegistry
from rhytid.engine.assets import Asset
from rhytid.engine.byte_budget import ByteBudget, Hold
from rhytid.engine.device_assets import DeviceAssets
from rhytid.engine.frame_service import FrameService, checked_frame
from rhytid.engine.frames import Frame
from rhytid.engine.given_graphs import check_graph
from rhytid.engine.jobs import Job, Jobs
from rhytid.engine.keys import content_key
from rhytid.engine.messages import AssetContent, AssetInfo, JobInfo, NewAsset
from rhytid.engine.stored_assets import StoredAssets
from rhytid.errors import InputError, MeshError, NotFoundError, SettingsError
from rhytid.pipeline.elements import check_cover
from rhytid.pipeline.folds import measured_folds
from rhytid.pipeline.stretch import r_max_of
from rhytid.storage.contents import asset_id
from rhytid.storage.store import AssetStore
from rhytid.synthesis.fields.capacity_check import check_amount

Positions = Sequence[NDArray[np.float32]]


class AssetService:
    """Registers assets from uploads and, at startup, from the store; changes and removes them."""

    def __init__(
        self,
        registry: AssetRegistry,
        device: Device,
        on_device: DeviceAssets,
        store: AssetStore,
        builder: AssetBuilder,
        frames: FrameService,
        jobs: Jobs,
        memory: ByteBudget,
    ) -> None:
        self._memory = memory
        self._assets, self._device, self._on_device = registry, device, on_device
        self._store, self._builder, self._frames, self._jobs = store, builder, frames, jobs
        self._stored = StoredAssets(store, on_device, registry.frame_memory)

    def open_store(self) -> None:
        """Register what the store holds, and go on with builds that were interrupted."""
        for asset in self._stored.built():
            self._assets.replace(None, asset)
        for asset in self._stored.pending():
            self._assets.replace(None, asset)
            if asset.state == "building":
                self._builder.start(asset, always=True)

    def create(
        self, new: NewAsset, *, strict: bool = False, allow: Collection[str] = ()
    ) -> AssetInfo:
        """Take a mesh in; the build runs as a job. The same content again: the same asset.

        The answer warns of the mesh, of the frames that came with it, of settings of a known asset
        that were changed since, and of those without effect. strict: raise StrictError instead,
        before anything is kept, of warnings whose codes are not in `allow`.

        Raises GraphError where a given graph does not fit the mesh or was made for another, unless
        `force`; SettingsError where its lengths are of a unit that cannot be converted, or a graph
        is to be grown in one that is not known; LimitError where it covers too many texels,
        QueryError for a code of `allow` that there is not, MeshError where the mesh has no UV
        inside the range of UDIMs, InputError where a painted map is of a UDIM without mesh or
        `graph.lines` asks for expressions and none came, what `check_amount` does.
        """
        check_codes(allow)
        udims = mesh_udims(new.mesh)
        if not udims:
            raise MeshError("no triangle lies in a UDIM: u goes from 0 to 10, v from 0 up")
        expressions = None
        if new.graph is not None:
            settings, wrinkles = new.settings.for_graph(new.graph.origin), new.graph.wrinkles
            check_graph(new.graph, new.mesh, force=new.force)
            for udim in udims:
                check_cover(new.graph, settings, udim)
        else:
            settings = new.settings.for_synthesis()
            expressions = grown_from(settings.graph.lines, new.shapes)
            memory = self._device.budget.limit
            wrinkles = check_amount(new.mesh, settings.graph, new.controls, memory)
        new = replace(new, settings=settings)
        for painted in (new.stiffness, new.controls):
            if painted is not None:
                painted.check_udims(udims)
        if new.graph is not None and new.controls is not None:
            names = ", ".join(new.controls.maps)
            raise InputError(f"{names}: maps that guide synthesis; a graph was sent")
        sent = () if new.frames is None else new.frames
        frames = [check_positions(positions, len(new.mesh.positions)) for positions in sent]
        warnings = mesh_warnings(new.mesh, new.settings.length_unit, new.settings.resolution, udims)
        unused = () if new.graph is None else settings_unused(new.settings)
        id = asset_id(new.mesh, new.settings, new.graph, new.stiffness, new.controls, expressions)

        @cache
        def make() -> Asset:
            memory = self._assets.frame_memory
            made = Asset.of(id, new.mesh, new.settings, warnings, memory, lambda: new.mesh)
            made.wanted, made.uv_length = wrinkles, usual_uv_length(new.mesh)
            return made

        told = unused
        if frames:
            told = (*unused, *_frame_warnings(self._known(id) or make(), frames))
        if strict:
            known = self._changed(self._known(id), new.settings)
            refuse((*warnings, *known, *told), allow)
        folds = self._folds(id, new, expressions)
        with self._held(frames) as hold:
            asset = self._registered(id, make, new, frames, folds)
            if asset.job is None:
                hold.release()
            else:
                asset.job.when_ended(hold.release)
        info, changed = asset.info(), self._changed(asset, new.settings)
        return replace(info, warnings=(*info.warnings, *changed, *told))

    @contextmanager
    def _held(self, frames: Positions) -> Iterator[Hold]:
        """The bytes of frames that wait for their job; given back where none is queued."""
        hold = self._memory.hold("jobs")
        hold.grow(sum(positions.nbytes for positions in frames))
        try:
            yield hold
        except BaseException:
            hold.release()
            raise

    def _known(self, id: str) -> Asset | None:
        """The asset of that id, if there is one that did not fail."""
        known = self._assets.find(id)
        return None if known is None or known.state == "failed" else known

    def _registered(
        self,
        id: str,
        make: Callable[[], Asset],
        new: NewAsset,
        frames: Positions,
        folds: Folds | None,
    ) -> Asset:
        """The asset that is known by the id; where none is, or it failed, what `make` makes, which
        is built."""
        while True:
            known = self._assets.find(id)
            if known is not None and known.state != "failed":
                with known.lock:
                    if known.state in ("building", "ready"):
                        self._add_frames(known, frames)
                        return known
            else:
                made = make()
                with made.lock:
                    if self._assets.replace(known, made):
                        self._begin(made, known, new, frames, folds)
                        made.mesh = partial(self._store.mesh, id)
                        return made

    def _begin(
        self, asset: Asset, before: Asset | None, new: NewAsset, frames: Positions,
        folds: Folds | None,
    ) -> None:  # fmt: skip
        """Take a built asset out of the store, else keep what was sent and build it. Where that
        fails, what was known before is known again."""
        try:
            if self._stored.restore(asset):
                self._add_frames(asset, frames)
                return
            self._store.put_request(
                asset.id, new.mesh, new.settings, new.graph, new.stiffness, new.controls, folds
            )
            self._builder.start(asset, self._frames_work(asset, frames))
        except BaseException:
            asset.state = "removed"
            self._assets.replace(asset, before)
            raise

    def _add_frames(self, asset: Asset, frames: Positions) -> None:
        if frames:
            work = self._frames_work(asset, frames)
            asset.job = self._jobs.start("frames", asset.id, work, small=asset.small)

    def _frames_work(self, asset: Asset, frames: Positions) -> Callable[[Job], None]:
        def work(job: Job) -> None:
            for index, positions in enumerate(frames):
                job.progress(0.9, "frames", f"{index + 1} of {len(frames)}")
                name, frame = frame_label(index), Frame.of(positions)
                warnings = asset.frame_warnings(positions, f"frame {name}")
                self._frames.store(asset, name, frame, warnings, patiently=True)

        return work

    def _changed(self, asset: Asset | None, sent: AssetSettings) -> tuple[InputWarning, ...]:
        """Where the asset of the content that is sent has other settings by now."""
        if asset is None or asset.state == "failed":
            return ()
        return settings_changed(asset.id, asset.settings, sent, asset.lengths)

    def _folds(self, id: str, new: NewAsset, expressions: Expressions | None) -> Folds | None:
        """Where expressions fold the mesh of an asset that is not built yet: other work goes
        between the steps. Raises what `check_amount` does."""
        if expressions is None or self._known(id) is not None:
            return None
        limit, graph = new.settings.response.log_stretch_limit, new.settings.graph
        folds = measured_folds(
            self._device, new.mesh, expressions, limit, new.settings.length_unit,
            lambda *_: None, self._on_device.run_patiently,
        )  # fmt: skip
        if folds is not None and folds.regions:
            memory = self._device.budget.limit
            check_amount(new.mesh, graph, new.controls, memory, folds)
        return folds

    def all(self) -> list[AssetInfo]:
        """Every asset."""
        return [asset.info() for asset in self._assets.all()]

    def info(self, asset: str) -> AssetInfo:
        """One asset."""
        return self._assets.get(asset).info()

    def change(self, asset: str, changes: Mapping[str, Any]) -> AssetInfo:
        """Change response, shape, depth, angles, preset, bins or convolve; tiles and keys change.

        A `preset` sets the bins but for `r_max`; keys of `bins` beside it override it. `depth`,
        `convolve.sigma` or `shape.wave_frequency` null means the default again: what the file of a
        given graph says, else in proportion to the spacing. Raises SettingsError for what cannot be
        changed.
        """
        found = self._assets.get(asset)
        found.check_ready()
        for key in changes:
            if key in AssetSettings.__dataclass_fields__ and key not in CHANGEABLE:
                raise SettingsError(f"{key} is fixed once an asset is made: make a new one")
        with found.lock:
            found.check_ready()
            settings = found.settings.changed(changes)
            self._builder.change(found, settings.with_lengths(found.lengths))
        self._builder.prepare_bins(found)
        return found.info()

    def delete(self, asset: str) -> None:
        """Remove an asset from memory, device and disk; cancels what is being made of it."""
        found = self._assets.get(asset)
        with found.lock:
            found.check_known()
            with suppress(NotFoundError):  # a cancelled build has left nothing in the store
                self._store.delete(asset)
            found.state = "removed"
            self._jobs.cancel_all(asset)
            self._assets.replace(found, None)
        found.frames.close()
        self._on_device.drop(found)

    def content(self, asset: str) -> AssetContent:
        """Names what `graph`, `mesh` and `curves` of a ready asset answer now, and how large that
        is; reads none of it."""
        found = self._assets.get(asset)
        found.check_ready()
        files = self._store.contents(asset)
        lengths = found.settings.lengths(found.lengths.spacing)
        digests = {name: file.sha256 for name, file in files.items()}
        key = content_key(asset, digests, found.settings.length_unit, lengths)
        return AssetContent(key, sum(file.nbytes for file in files.values()))

    def graph(self, asset: str) -> WrinkleGraph:
        """The wrinkle graph of a ready asset, and with what it is drawn now."""
        found = self._assets.get(asset)
        found.check_ready()
        stored = self._store.asset(asset)
        lengths = found.settings.lengths(found.lengths.spacing)
        origin = GraphOrigin.of(stored.mesh, found.settings.length_unit, lengths)
        return replace(stored.graph, origin=origin)

    def mesh(self, asset: str) -> Mesh:
        """The neutral mesh of a ready asset, out of the store."""
        self._assets.get(asset).check_ready()
        return self._store.asset(asset).mesh

    def curves(self, asset: str) -> Curves:
        """The wrinkles of a ready asset as lines in space; those with an end off the mesh are not
        among them."""
        lying = self._on_device.loaded(self._assets.get(asset))
        stored = self._store.asset(asset)
        triangles = len(stored.mesh.faces)
        placed = with_triangles(stored.graph, lying.mesh.pore_triangle, triangles)
        return graph_curves(stored.mesh, placed)

    def calibrate(
        self,
        asset: str,
        positions: ArrayLike,
        *,
        strict: bool = False,
        allow: Collection[str] = (),
    ) -> JobInfo:
        """Set r_max from a frame (section 2.4) and make the bins anew, as a job.

        The job warns of the frame; strict: raise StrictError instead, unless its code is in
        `allow`.
        """
        found = self._assets.get(asset)
        found.check_ready()
        name = "frame of the calibration"
        frame, warnings = checked_frame(found, positions, name, strict, allow)

        changed = False

        def work(job: Job) -> None:
            nonlocal changed
            if not changed:  # else it gave way to another job when that was done
                measure(job)
                changed = True
            self._builder.make_bins(job, found)

        def measure(job: Job) -> None:
            job.progress(0.0, "measuring stretch")
            ratios, _ = self._on_device.use(
                found, lambda lying: lying.frames.ratios(frame), patiently=True
            )
            with found.kept():
                limit = found.settings.response.log_stretch_limit
                settings = found.settings.with_r_max(r_max_of(ratios, limit))
                self._builder.change(found, settings)

        job = self._jobs.start("calibration", asset, work, small=found.small)
        job.update(warnings=warnings)
        return job.info


def _frame_warnings(asset: Asset, frames: Positions) -> tuple[InputWarning, ...]:
    """About the frames that come with a mesh, by the names that they will have."""
    return tuple(
        warning
        for index, positions in enumerate(frames)
        for warning in asset.frame_warnings(positions, f"frame {frame_label(index)}")
    )
