"""Builds assets: from what a caller sent, or from the store after a restart."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, replace
from functools import partial
from typing import Any, TypeVar

from rhytid.device.runtime import Device
from rhytid.domain.ageing import USUAL_AGE
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.graph_origin import GraphOrigin
from rhytid.engine.assets import Asset, Assets
from rhytid.engine.given_graphs import graph_lengths
from rhytid.engine.jobs import Job
from rhytid.engine.resident_levels import ResidentLevels
from rhytid.engine.spacing import mean_spacing
from rhytid.engine.worker import DeviceWorker
from rhytid.errors import CancelledError, NotFoundError, RhytidError
from rhytid.storage.records import StoredAsset, StoredRequest
from rhytid.storage.store import AssetStore
from rhytid.synthesis.generate import Synthesis, synthesize

T = TypeVar("T")

# Shares of a build's progress at which its stages end.
_SYNTHESIS, _UPLOAD = 0.6, 0.75
# Bins are made ahead only where they leave room for others in the device memory.
_BINS_SHARE = 0.6


class Builder:
    """The steps of a build. Runs on the thread of the jobs; device work goes to the worker."""

    def __init__(
        self, device: Device, worker: DeviceWorker, store: AssetStore, assets: Assets
    ) -> None:
        self._device, self._worker, self._store = device, worker, store
        self._assets = assets

    def build(self, job: Job, asset: Asset) -> None:
        """Make the asset of a stored request: synthesise, store, upload, make bins."""
        with self._failing(job, asset):
            wanted = self._store.request(asset.id)
            graph, grown = self._graph(job, wanted)
            with self._placed(job, wanted, graph, wanted.settings) as resident:
                if grown is None:
                    spacing = None
                    distance = mean_spacing(wanted.mesh, graph, resident.pore_triangle)
                else:
                    spacing, distance = grown.spacing, grown.distance
                asset.lengths = graph_lengths(graph, wanted.settings, distance, spacing)
                asset.distance = distance
                settings = wanted.settings.with_lengths(asset.lengths)
                job.progress(_SYNTHESIS, "storing")
                with self._still_known(asset):
                    kept = [asdict(warning) for warning in asset.warnings]
                    spacing = asset.lengths.spacing
                    facts = {"spacing": spacing, "distance": distance, "warnings": kept}
                    self._store.put_asset(
                        asset.id, wanted.mesh, graph, settings, facts, wanted.stiffness
                    )
                self._finish(job, asset, resident, graph, settings)
        self.make_bins(job, asset, _UPLOAD)

    def load(self, job: Job, asset: Asset) -> None:
        """Bring a stored asset to the device."""
        with self._failing(job, asset):
            stored = self._store.asset(asset.id)
            with self._placed(job, stored, stored.graph, asset.settings) as resident:
                if asset.distance is None:  # stored by a version that did not keep it
                    asset.distance = mean_spacing(stored.mesh, stored.graph, resident.pore_triangle)
                self._finish(job, asset, resident, stored.graph, asset.settings)
        self.make_bins(job, asset, _UPLOAD)

    def change(self, asset: Asset, settings: AssetSettings) -> None:
        """Give a ready asset other settings, on the device and in the store."""
        resident, old = asset.ready(), asset.settings
        prepared = None
        if resident.prepares(settings):
            prepared = resident.prepare(self._store.asset(asset.id).graph, settings)

        def take() -> None:  # in one task: no tile is drawn between the two
            resident.use(settings) if prepared is None else resident.install(prepared, settings)
            asset.settings = settings

        self._store.put_overlay(asset.id, settings)
        try:
            self.on_device(take)
        except BaseException:
            self._store.put_overlay(asset.id, old)
            raise

    def make_bins(self, job: Job, asset: Asset, start: float = 0.0) -> None:
        """Make the level-0 maps of the fast method ahead, if they fit; else they stay lazy."""
        resident, settings = asset.ready(), asset.settings
        if resident.bins_size() > _BINS_SHARE * self._device.budget.limit:
            return
        addresses = [a for udim in asset.udims for a in settings.grid.addresses(udim, 0)]
        for done, address in enumerate(addresses):
            share = start + (1.0 - start) * done / len(addresses)
            job.progress(share, "making bins", f"tile {done + 1} of {len(addresses)}")
            if asset.settings != settings:  # changed meanwhile: these bins are out of date
                return
            self.on_device(resident.bin_tile, address)
            if done == 0:
                self.on_device(resident.warm_up_blend, address)

    def on_device(self, task: Callable[..., T], *arguments: Any, **named: Any) -> T:
        """Run one task on the device thread, waiting for a place in its queue."""
        return self._worker.call_patiently(lambda: self._task(task, arguments, named))

    def _task(self, task: Callable[..., T], arguments: tuple[Any, ...], named: dict[str, Any]) -> T:
        with self._device.task():
            return task(*arguments, **named)

    def _graph(self, job: Job, wanted: StoredRequest) -> tuple[WrinkleGraph, Synthesis | None]:
        """The graph given, or a new one with what else is known of it; other work goes between its
        steps."""
        if wanted.graph is not None:
            return wanted.graph, None

        def report(share: float, stage: str) -> None:
            job.progress(_SYNTHESIS * share, stage)

        found = synthesize(
            wanted.mesh, wanted.settings.graph, self._device, report,
            call=self.on_device, controls=wanted.controls, folds=wanted.folds,
        )  # fmt: skip
        if wanted.settings.graph.age == USUAL_AGE:
            return found.graph, found
        # Its depth is not that of the spacing alone: it is kept with the graph.
        origin = GraphOrigin(wanted.settings.length_unit, depth=found.lengths.depth)
        return replace(found.graph, origin=origin), found

    @contextmanager
    def _placed(
        self,
        job: Job,
        stored: StoredRequest | StoredAsset,
        graph: WrinkleGraph,
        settings: AssetSettings,
    ) -> Iterator[ResidentLevels]:
        """A mesh on the device, its elements located; given back where what follows fails."""
        job.progress(_SYNTHESIS, "placing pores and wrinkles")
        made = partial(ResidentLevels, self._device, stored.mesh, settings, stored.stiffness)
        resident = self.on_device(made)
        try:
            self.on_device(resident.locate, graph)
            yield resident
        except BaseException:
            self.on_device(resident.release)
            raise

    def _finish(
        self,
        job: Job,
        asset: Asset,
        resident: ResidentLevels,
        graph: WrinkleGraph,
        settings: AssetSettings,
    ) -> None:
        job.progress(_SYNTHESIS, "uploading")
        self.on_device(resident.install, resident.prepare(graph, settings), settings)
        self.on_device(resident.warm_up)
        with self._still_known(asset):
            asset.settings, asset.resident = settings, resident
            asset.pores, asset.wrinkles = graph.counts()
            asset.statistics = {"spacing": asset.distance, **graph.figures()}
            asset.state = "ready"

    @contextmanager
    def _still_known(self, asset: Asset) -> Iterator[None]:
        """Neither removed nor made anew meanwhile, nor while the block runs."""
        with self._assets.changing:
            if not self._assets.knows(asset):
                raise CancelledError(f"asset {asset.id} was removed")
            yield

    @contextmanager
    def _failing(self, job: Job, asset: Asset) -> Iterator[None]:
        """Whatever goes wrong becomes the asset's reason; a cancelled build is forgotten."""
        try:
            yield
        except BaseException as error:
            known = isinstance(error, RhytidError)
            asset.reason = str(error) if known else f"internal error: {type(error).__name__}"
            asset.state = "failed"
            if isinstance(error, CancelledError) and not job.resumes:
                with self._assets.changing, suppress(NotFoundError):
                    if self._assets.knows(asset):
                        self._store.delete(asset.id)
            raise
