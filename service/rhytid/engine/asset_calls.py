"""Assets and jobs: create, change, calibrate, remove."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.curves import Curves, graph_curves, with_triangles
from rhytid.domain.expressions import Expressions, grown_from
from rhytid.domain.folds import Folds
from rhytid.domain.frame import check_positions
from rhytid.domain.frame_warnings import FrameCheck
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.graph_origin import GraphOrigin
from rhytid.domain.mesh_warnings import mesh_warnings
from rhytid.domain.settings_changes import CHANGEABLE, settings_changed, settings_unused
from rhytid.domain.tiles import mesh_udims
from rhytid.domain.warnings import InputWarning, check_codes, refuse
from rhytid.engine.arrivals import AssetArrivals
from rhytid.engine.assets import Asset
from rhytid.engine.frame_calls import checked_frame
from rhytid.engine.given_graphs import check_graph
from rhytid.engine.jobs import Job
from rhytid.engine.messages import AssetInfo, JobInfo, NewAsset
from rhytid.errors import InputError, MeshError, NotFoundError, SettingsError
from rhytid.pipeline.elements import check_cover
from rhytid.pipeline.folds import measured_folds
from rhytid.pipeline.stretch import r_max_of
from rhytid.storage.contents import asset_id
from rhytid.synthesis.amount import check_amount


class AssetCalls(AssetArrivals):
    """The calls about assets and their jobs."""

    def create_asset(
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
            settings = new.settings.for_graph(new.graph.origin)
            check_graph(new.graph, new.mesh, force=new.force)
            for udim in udims:
                check_cover(new.graph, settings, udim)
        else:
            settings = new.settings.for_synthesis()
            expressions = grown_from(settings.graph.lines, new.shapes)
            check_amount(new.mesh, settings.graph, new.controls, self._device.budget.limit)
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
        told = (*unused, *_frame_warnings(new, frames))
        id = asset_id(new.mesh, new.settings, new.graph, new.stiffness, new.controls, expressions)
        if strict:
            known = self._changed(self._assets.find(id), new.settings)
            refuse((*warnings, *known, *told), allow)
        folds = self._folds(id, new, expressions)
        with self._assets.changing:
            asset = self._assets.find(id)
            if asset is None or asset.state == "failed":
                asset = self._welcome(id, new, warnings, frames, folds)
            elif frames:
                asset.job = self._jobs.start("frames", id, self._frames_work(asset, frames))
            info, changed = asset.info(), self._changed(asset, new.settings)
            return replace(info, warnings=(*info.warnings, *changed, *told))

    def _changed(self, asset: Asset | None, sent: AssetSettings) -> tuple[InputWarning, ...]:
        """Where the asset of the content that is sent has other settings by now."""
        if asset is None or asset.state == "failed":
            return ()
        return settings_changed(asset.id, asset.settings, sent, asset.lengths)

    def _folds(self, id: str, new: NewAsset, expressions: Expressions | None) -> Folds | None:
        """Where expressions fold the mesh of an asset that is not built yet: other work goes
        between the steps. Raises what `check_amount` does."""
        known = self._assets.find(id)
        if expressions is None or (known is not None and known.state != "failed"):
            return None
        limit, graph = new.settings.response.log_stretch_limit, new.settings.graph
        folds = measured_folds(
            self._device, new.mesh, expressions, limit, new.settings.length_unit,
            lambda *_: None, self._builder.on_device,
        )  # fmt: skip
        if folds is not None and folds.regions:
            memory = self._device.budget.limit
            check_amount(new.mesh, graph, new.controls, memory, folds)
        return folds

    def assets(self) -> list[AssetInfo]:
        """Every asset."""
        return [asset.info() for asset in self._assets.all()]

    def asset(self, asset: str) -> AssetInfo:
        """One asset."""
        return self._assets.get(asset).info()

    def change_asset(self, asset: str, changes: Mapping[str, Any]) -> AssetInfo:
        """Change response, shape, depth, angles, preset, bins or convolve; tiles and keys change.

        A `preset` sets the bins but for `r_max`; keys of `bins` beside it go before it. `depth`,
        `convolve.sigma` or `shape.wave_frequency` null means the default again: what the file of a
        given graph says, else in proportion to the spacing. Raises SettingsError for what cannot be
        changed.
        """
        found = self._assets.get(asset)
        found.ready()
        for key in changes:
            if key in AssetSettings.__dataclass_fields__ and key not in CHANGEABLE:
                raise SettingsError(f"{key} is fixed once an asset is made: make a new one")
        with found.changing:
            settings = found.settings.changed(changes)
            self._builder.change(found, settings.with_lengths(found.lengths))
        self._prepare_bins(found)
        return found.info()

    def delete_asset(self, asset: str) -> None:
        """Remove an asset from memory, device and disk; cancels what is being made of it."""
        with self._assets.changing:
            found = self._assets.remove(asset)
            self._jobs.cancel_of(asset)
            with suppress(NotFoundError):  # a cancelled build has left nothing in the store
                self._store.delete(asset)
        found.frames.close()
        if found.resident is not None:
            self._builder.on_device(found.resident.release)

    def graph(self, asset: str) -> WrinkleGraph:
        """The wrinkle graph of a ready asset, and with what it is drawn now."""
        found = self._assets.get(asset)
        found.ready()
        stored = self._store.asset(asset)
        lengths = found.settings.lengths(found.lengths.spacing)
        origin = GraphOrigin.of(stored.mesh, found.settings.length_unit, lengths)
        return replace(stored.graph, origin=origin)

    def curves(self, asset: str) -> Curves:
        """The wrinkles of a ready asset as lines in space; those with an end off the mesh are not
        among them."""
        resident = self._assets.get(asset).ready()
        stored = self._store.asset(asset)
        triangles = len(stored.mesh.faces)
        placed = with_triangles(stored.graph, resident.pore_triangle, triangles)
        return graph_curves(stored.mesh, placed)

    def job(self, job: str) -> JobInfo:
        """How far a job is."""
        return self._jobs.get(job).info

    def cancel_job(self, job: str) -> JobInfo:
        """Ask a job to stop at its next step."""
        found = self._jobs.get(job)
        found.cancel()
        return found.info

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
        found.ready()
        name = "frame of the calibration"
        frame, warnings = checked_frame(found, positions, name, strict, allow)

        def work(job: Job) -> None:
            job.progress(0.0, "measuring stretch")
            ratios, _ = self._builder.on_device(found.ready().stretch, frame)
            with found.changing:
                limit = found.settings.response.log_stretch_limit
                settings = found.settings.with_r_max(r_max_of(ratios, limit))
                self._builder.change(found, settings)
            self._builder.make_bins(job, found)

        job = self._jobs.start("calibration", asset, work)
        job.update(warnings=warnings)
        return job.info

    def _prepare_bins(self, asset: Asset) -> None:
        self._jobs.start("bins", asset.id, lambda job: self._builder.make_bins(job, asset))


def _frame_warnings(
    new: NewAsset, frames: Sequence[NDArray[np.float32]]
) -> tuple[InputWarning, ...]:
    """About the frames that come with a mesh, by the names that they will have."""
    if not frames:
        return ()
    check = FrameCheck(new.mesh, new.settings.length_unit)
    return tuple(
        warning
        for index, positions in enumerate(frames)
        for warning in check.warnings(positions, f"frame {index:04d}")
    )
