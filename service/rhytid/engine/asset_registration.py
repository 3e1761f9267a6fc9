"""Registers assets, from the store or from an upload, and starts their builds."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.expressions import Folds
from rhytid.domain.frame import counted_frame
from rhytid.engine.asset_builder import AssetBuilder
from rhytid.engine.asset_registry import AssetRegistry
from rhytid.engine.assets import Asset
from rhytid.engine.byte_budget import ByteBudget, Hold
from rhytid.engine.checked_upload import CheckedUpload
from rhytid.engine.frame_service import FrameService
from rhytid.engine.frames import Frame
from rhytid.engine.job import Job
from rhytid.engine.jobs import Jobs
from rhytid.engine.stored_assets import StoredAssets
from rhytid.errors import FatalRequestError
from rhytid.storage.store import AssetStore

Positions = Sequence[NDArray[np.float32]]


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

    def open_store(self, only: Collection[str] | None = None) -> None:
        """Register what the store holds, or those of `only`, and go on with builds that were
        interrupted."""
        for asset in self._stored.built(only):
            self._assets.replace(None, asset)
        for asset in self._stored.pending(only):
            self._assets.replace(None, asset)
            if asset.state == "building":
                try:
                    self._builder.start(asset, always=True)
                except FatalRequestError as error:
                    asset.fail(str(error))

    def known(self, id: str) -> Asset | None:
        """The asset of that id, if there is one that did not fail."""
        known = self._assets.find(id)
        return None if known is None or known.state == "failed" else known

    def register(
        self,
        upload: CheckedUpload,
        make: Callable[[], Asset],
        folds: Folds | None,
        hold: Hold | None,
    ) -> Asset:
        """The asset that is known by the id of an upload; where none is, or it failed, what `make`
        makes, which is built. Its frames are stored by a job.

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
        """The bytes of frames that wait for their job; given back where none is queued."""
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
        """Restore a built asset from the store, else store what was sent and build it. On failure
        the asset that was registered before is registered again."""
        new = upload.new
        try:
            if self._stored.restore(asset):
                self._add_frames(asset, upload.frames)
                return
            self._store.put_request(
                asset.id, new.mesh, new.settings, new.graph, new.stiffness, new.controls, folds
            )
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
