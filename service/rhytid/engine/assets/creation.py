"""Creates assets from uploads: checks what was sent, warns of it, registers an asset and starts its
build. Registers the assets of the store, too."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.expressions import Expressions, Folds
from rhytid.domain.frame import counted_frame
from rhytid.domain.settings_changes import settings_changed
from rhytid.domain.warnings import InputWarning, check_codes, refuse
from rhytid.engine.assets.asset import Asset, AssetRegistry
from rhytid.engine.assets.builder import AssetBuilder
from rhytid.engine.assets.on_device import DeviceAssets
from rhytid.engine.assets.stored import StoredAssets
from rhytid.engine.assets.upload import CheckedUpload
from rhytid.engine.byte_budget import ByteBudget, Hold
from rhytid.engine.frame_service import FrameService
from rhytid.engine.frames import Frame, FrameMemory
from rhytid.engine.job import Job
from rhytid.engine.jobs import Jobs
from rhytid.engine.messages import NewAsset
from rhytid.engine.shared_assets import SharedAssets
from rhytid.errors import FatalRequestError, NotFoundError
from rhytid.pipeline.folds import measured_folds
from rhytid.pipeline.work import DrawLimit
from rhytid.storage.records import StoredRequest
from rhytid.storage.store import AssetStore

Positions = Sequence[NDArray[np.float32]]
Warnings = tuple[InputWarning, ...]


class AssetCreation:
    """Takes in uploads of assets.

    memory: counts the frames of new assets.  limit: of how long the maps of a given graph may take.
    """

    def __init__(
        self,
        registration: AssetRegistration,
        device: Device,
        on_device: DeviceAssets,
        store: AssetStore,
        shared: SharedAssets,
        memory: FrameMemory,
        limit: DrawLimit,
    ) -> None:
        self._registration, self._memory, self._limit = registration, memory, limit
        self._device, self._on_device = device, on_device
        self._store, self._shared = store, shared

    def take(
        self, new: NewAsset, strict: bool, allow: Collection[str], hold: Hold | None
    ) -> tuple[Asset, Warnings]:
        """The asset of an upload, new or known, and warnings beside its own; raises what
        `AssetService.create` does."""
        check_codes(allow)
        upload = CheckedUpload.of(new, self._device.budget.limit, self._limit)
        made = cache(partial(upload.asset, self._memory))
        known, sent = self._registration.known(upload.id), upload.unused
        if upload.frames:
            sent = (*sent, *_frame_warnings(known or made(), upload.frames))
        if strict:
            refuse((*upload.warnings, *_changed(known, upload.settings), *sent), allow)
        asset = self._registration.register(upload, made, self._folds(upload, made), hold)
        if new.shapes is not None and new.shapes.named:
            self._keep_shapes(asset, new.shapes)
        return asset, (*_changed(asset, upload.settings), *sent)

    def _keep_shapes(self, asset: Asset, shapes: Expressions) -> None:
        """Store the shapes of an asset in place of earlier ones, unless its build failed meanwhile:
        then nothing of the asset is kept."""
        with asset.kept(), suppress(NotFoundError):
            self._store.put_shapes(asset.id, shapes)
            if asset.state == "ready":
                self._shared.share(asset.id)

    def _folds(self, upload: CheckedUpload, made: Callable[[], Asset]) -> Folds | None:
        """The folds that expressions make in the mesh of an asset that is not built yet; other
        tasks of the device run between the steps. An asset that `made` gives, of all that grows,
        expects as many wrinkles as regions leave. Raises what `check_amount` does."""
        if upload.expressions is None or self._registration.known(upload.id) is not None:
            return None
        new, settings = upload.new, upload.settings
        folds = new.folds or measured_folds(
            self._device, new.mesh, upload.expressions, settings.response.log_stretch_limit,
            settings.length_unit, lambda *_: None, self._on_device.run_patiently,
            settings.graph.anatomy,
        )  # fmt: skip
        if folds is not None and folds.regions:
            from rhytid.synthesis.capacity import check_amount

            memory = self._device.budget.limit
            wrinkles = check_amount(new.mesh, settings.graph, new.controls, memory, folds)
            if new.scan is None:
                made().expected_wrinkles = wrinkles
        return folds


class AssetRegistration:
    """Registers assets, starts their builds, and stores the frames that come with them.

    memory: counts such frames until they are stored.
    """

    def __init__(
        self,
        registry: AssetRegistry,
        store: AssetStore,
        stored: StoredAssets,
        builder: AssetBuilder,
        frames: FrameService,
        jobs: Jobs,
        memory: ByteBudget,
    ) -> None:
        self._assets, self._store, self._stored = registry, store, stored
        self._builder, self._frames, self._jobs, self._memory = builder, frames, jobs, memory

    def open_store(self, only: Collection[str] | None, builds: Mapping[str, str]) -> None:
        """Register the assets of the store, or those of `only`, and go on with builds that were
        interrupted.  builds: the ids of their jobs, by asset, as far as they are known."""
        for asset in self._stored.built(only):
            self._assets.replace(None, asset)
        for asset in self._stored.pending(only):
            self._assets.replace(None, asset)
            if asset.state == "building":
                try:
                    self._builder.start(asset, always=True, again=builds.get(asset.id, ""))
                except FatalRequestError as error:
                    asset.fail(str(error))

    def known(self, id: str) -> Asset | None:
        """The asset of an id, or None where there is none or it failed."""
        known = self._assets.find(id)
        return None if known is None or known.state == "failed" else known

    def register(
        self,
        upload: CheckedUpload,
        make: Callable[[], Asset],
        folds: Folds | None,
        hold: Hold | None,
    ) -> Asset:
        """The asset that is known by the id of an upload. Where none is, or it failed, the one that
        `make` makes, which is then built. The frames of the upload are stored by a job.

        hold: counts the bytes of the frames already, as far as it has any.
        """
        with self._held(upload.frames, hold) as held:
            asset = self._registered(upload, make, folds)
            if asset.job is None:
                held.release()
            else:
                asset.job.when_ended(held.release)
        return asset

    @contextmanager
    def _held(self, frames: Positions, counted: Hold | None) -> Iterator[Hold]:
        """Hold the bytes of frames that wait for their job; gives them back where none is
        queued."""
        nbytes = sum(positions.nbytes for positions in frames)
        hold = self._memory.hold("jobs") if counted is None else counted.split("jobs", nbytes)
        try:
            hold.grow(nbytes - hold.nbytes)
            yield hold
        except BaseException:
            hold.release()
            raise

    def _registered(
        self, upload: CheckedUpload, make: Callable[[], Asset], folds: Folds | None
    ) -> Asset:
        while True:
            known = self._assets.find(upload.id)
            if known is not None and known.state != "failed":
                with known.lock:
                    if known.state in ("building", "ready"):
                        self._add_frames(known, upload.frames)
                        return known
            else:
                made = make()
                with made.lock:
                    if self._assets.replace(known, made):
                        self._begin(made, known, upload, folds)
                        made.mesh = partial(self._store.mesh, upload.id)
                        return made

    def _begin(
        self, asset: Asset, before: Asset | None, upload: CheckedUpload, folds: Folds | None
    ) -> None:
        """Restore a built asset from the store, else store the upload and build it. On failure the
        asset that was registered before is registered again."""
        new = upload.new
        try:
            if self._stored.restore(asset):
                self._add_frames(asset, upload.frames)
                return
            request = StoredRequest(
                new.mesh, new.settings, new.graph, new.stiffness, new.controls, folds,
                new.residual, new.scan, new.noted,
            )  # fmt: skip
            self._store.put_request(asset.id, request)
            self._builder.start(asset, self._frames_work(asset, upload.frames))
        except BaseException:
            asset.state = "removed"
            self._assets.replace(asset, before)
            raise

    def _add_frames(self, asset: Asset, frames: Positions) -> None:
        if frames:
            work = self._frames_work(asset, frames)
            asset.job = self._jobs.start("frames", asset.id, work, small=asset.small)

    def _frames_work(self, asset: Asset, frames: Positions) -> Callable[[Job], None]:
        since = asset.frames.stored

        def work(job: Job) -> None:
            for index, positions in enumerate(frames):
                job.progress(0.9, "frames", f"{index + 1} of {len(frames)}")
                name, frame = counted_frame(index), Frame.of(positions)
                warnings = asset.frame_warnings(positions, f"frame {name}")
                self._frames.store(asset, name, frame, warnings, patiently=True, since=since)

        return work


def _frame_warnings(asset: Asset, frames: Positions) -> Warnings:
    """Warnings of the frames that come with a mesh, by the names that they will have."""
    return tuple(
        warning
        for index, positions in enumerate(frames)
        for warning in asset.frame_warnings(positions, f"frame {counted_frame(index)}")
    )


def _changed(asset: Asset | None, sent: AssetSettings) -> Warnings:
    """Warnings of the settings in which the asset of the same content differs from the upload by
    now."""
    if asset is None or asset.state == "failed":
        return ()
    return settings_changed(asset.id, asset.settings, sent, asset.lengths)
