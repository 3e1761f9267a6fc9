"""Builds assets from what a caller sent, changes them, and makes their maps ahead.

What grows and traces skin is imported by the first build: a process of a device need not wait for
it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, replace
from functools import partial
from typing import TYPE_CHECKING

from rhytid.device import watch
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import MOST_WRINKLES, AssetSettings
from rhytid.domain.graph import GraphOrigin, WrinkleGraph
from rhytid.domain.residual import Residual, ScanRelief
from rhytid.domain.skin import USUAL_AGE
from rhytid.domain.tiles import TileAddress
from rhytid.domain.uv_layout import usual_uv_length
from rhytid.domain.warnings import InputWarning
from rhytid.engine.assets.asset import Asset
from rhytid.engine.assets.graphs import graph_lengths, mean_spacing
from rhytid.engine.assets.on_device import DeviceAssets
from rhytid.engine.device_assets.asset import DeviceAsset
from rhytid.engine.job import Job
from rhytid.engine.jobs import Jobs
from rhytid.engine.messages import Refusal
from rhytid.engine.shared_assets import SharedAssets
from rhytid.errors import (
    CancelledError,
    FatalRequestError,
    NotFoundError,
    RhytidError,
    public_message,
)
from rhytid.pipeline.element_arrays import check_cover
from rhytid.pipeline.work import DrawLimit
from rhytid.storage.records import StoredRequest
from rhytid.storage.store import AssetStore

if TYPE_CHECKING:
    from rhytid.synthesis.generate import Synthesis
    from rhytid.tracing.trace import Trace

# Share of a build's progress at which the synthesis ends.
_SYNTHESIS = 0.8
# Share of a traced relief that is left, from which on its lines may explain next to nothing.
_MUCH_LEFT = 0.9
# Bins are made ahead only if they leave device memory for other assets.
_BINS_SHARE = 0.6


class AssetBuilder:
    """Runs builds as jobs: synthesis, storing, upload. Precomputed maps follow as a job of their
    own.

    An asset that the shared store has is fetched and not synthesised; an asset that is built is
    pushed.
    """

    def __init__(
        self,
        device: Device,
        on_device: DeviceAssets,
        store: AssetStore,
        shared: SharedAssets,
        jobs: Jobs,
        limit: DrawLimit,
        refused: Mapping[str, Refusal],
    ) -> None:
        self._device, self._on_device = device, on_device
        self._store, self._shared, self._jobs = store, shared, jobs
        self._limit, self._refused = limit, dict(refused)

    def start(
        self,
        asset: Asset,
        afterwards: Callable[[Job], None] | None = None,
        *,
        always: bool = False,
        again: str = "",
    ) -> None:
        """Build an asset whose request is stored, as a job.  afterwards: called with the job once
        the asset is ready.  again: the id of the job that was building it in a process that ended.

        Raises BusyError where too many jobs wait, unless `always`, and FatalRequestError where the
        asset is not to be built.
        """
        refusal = self._refused.get(asset.id)
        if refusal is not None and refusal.holds:
            raise FatalRequestError(refusal.reason)

        def work(job: Job) -> None:
            self._make(job, asset)
            if afterwards is not None:
                afterwards(job)
            self.prepare_bins(asset)

        job = self._jobs.start(
            "build", asset.id, work, small=asset.small, always=always, again=again
        )
        asset.job = job
        job.when_ended(partial(self._not_begun, job, asset))

    def _not_begun(self, job: Job, asset: Asset) -> None:
        """Give an asset up whose build was cancelled before it began."""
        if job.info.state == "cancelled" and asset.state == "building":
            self._fail(job, asset, CancelledError(job.info.detail))

    def allow(self, asset: str) -> None:
        """Allow an asset to be built again, since it was removed."""
        self._refused.pop(asset, None)

    def change(self, asset: Asset, settings: AssetSettings) -> None:
        """As `use`, and push the asset."""
        self.use(asset, settings)
        self._shared.share(asset.id)

    def use(self, asset: Asset, settings: AssetSettings) -> None:
        """Give a ready asset, whose lock is held, other settings, on the device and in the store.

        Its old settings stay where anything fails. Raises LimitError where its maps would cover too
        many texels or take too long to draw.
        """
        old, resident, prepared = asset.settings, asset.resident, None
        if resident is not None and resident.mesh.prepares(settings):
            graph = self._store.asset(asset.id).graph
            for udim in asset.udims:
                check_cover(graph, settings, udim, self._limit)
            prepared = resident.mesh.prepare(graph, settings)

        def take() -> None:  # in one task, so that no tile is drawn between the two
            if asset.resident is not None:
                mesh = self._on_device.found(asset).mesh  # it stays while memory is short
                mesh.use(settings) if prepared is None else mesh.install(prepared, settings)
            asset.settings = settings

        self._store.put_overlay(asset.id, settings)
        try:
            self._on_device.run_patiently(take)
        except BaseException:
            self._store.put_overlay(asset.id, old)
            raise

    def prepare_bins(self, asset: Asset) -> None:
        """Make the level-0 maps of the fast method ahead, as a job, if they fit into memory;
        otherwise each is made on first use."""
        self._jobs.start(
            "bins", asset.id, lambda job: self.make_bins(job, asset), small=asset.small, always=True
        )

    def make_bins(self, job: Job, asset: Asset) -> None:
        """Do the work of `prepare_bins`. It stops when the settings change, and yields to jobs of
        higher priority between tiles. Tiles that exist are not made again."""
        size = self._on_device.loaded(asset).bins.size()
        if size > _BINS_SHARE * self._device.budget.limit:
            return
        settings = asset.settings
        addresses = [a for udim in asset.udims for a in settings.grid.addresses(udim, 0)]
        for done, address in enumerate(addresses):
            told = f"tile {done + 1} of {len(addresses)}"
            job.progress(done / len(addresses), "making bins", told)
            job.give_way()
            if asset.settings != settings:
                return
            with watch.telling_of_compiling(partial(job.tell, f"{told}, compiling kernels")):
                self._on_device.make_bins(asset, address)
                if done == 0:
                    self._warm_up(asset, settings, address)

    def _warm_up(self, asset: Asset, settings: AssetSettings, address: TileAddress) -> None:
        """Compile the kernels that blend a tile whose maps are made, in tasks between which others
        run, such as a change of settings, after which there are no maps."""

        def unless_changed(warm_up: Callable[[DeviceAsset], None], resident: DeviceAsset) -> None:
            if asset.settings == settings:
                warm_up(resident)

        blend = partial(DeviceAsset.warm_up_blend, address=address)
        for warm_up in (DeviceAsset.warm_up_stretch, blend):
            self._on_device.use(asset, partial(unless_changed, warm_up), patiently=True)

    def _make(self, job: Job, asset: Asset) -> None:
        """Fetch an asset of the shared store, or else build and push it."""
        with self._failing(job, asset):
            if self._shared.take(job, asset):
                return
            self._build(job, asset)
        with suppress(RhytidError):  # it is built, and pushed later
            self._shared.share(asset.id)

    def _build(self, job: Job, asset: Asset) -> None:
        request = self._store.request(asset.id)
        graph, residual, grown = self._graph(job, asset, request)
        job.progress(_SYNTHESIS, "placing pores and wrinkles")
        request = replace(request, residual=residual)
        made = self._on_device.place(
            request.mesh, graph, request.settings, request.stiffness, residual
        )
        try:
            settings, distance = self._keep(job, asset, request, graph, grown, made)
        except BaseException:
            self._on_device.give_up(made)
            raise
        job.progress(_SYNTHESIS, "uploading")
        self._on_device.finish(asset, made, graph, settings)
        with asset.kept():
            asset.built(graph, settings, distance, residual)

    def _keep(
        self,
        job: Job,
        asset: Asset,
        request: StoredRequest,
        graph: WrinkleGraph,
        grown: Synthesis | None,
        made: DeviceAsset,
    ) -> tuple[AssetSettings, float]:
        """Store a built asset; returns its resolved settings, and the mean distance of its
        pores."""
        if grown is None:
            spacing, distance = None, mean_spacing(request.mesh, graph, made.mesh.pore_triangle)
        else:
            spacing, distance = grown.spacing, grown.distance
        asset.lengths = graph_lengths(graph, request.settings, distance, spacing)
        settings = request.settings.with_lengths(asset.lengths)
        warnings = [asdict(warning) for warning in asset.warnings]
        facts = {"spacing": asset.lengths.spacing, "distance": distance, "warnings": warnings}
        if asset.measured_uv is None:
            asset.measured_uv = usual_uv_length(request.mesh)
        facts["uv_length"] = asset.measured_uv
        job.progress(_SYNTHESIS, "storing")
        with asset.kept():
            self._store.put_asset(
                asset.id, request.mesh, graph, settings, facts, request.stiffness,
                request.residual,
            )  # fmt: skip
        return settings, distance

    def _graph(
        self, job: Job, asset: Asset, request: StoredRequest
    ) -> tuple[WrinkleGraph, Residual | None, Synthesis | None]:
        """The graph that was sent, or traced, with its residual; or a new one with its figures.
        Other tasks of the device run between the steps of both."""
        if request.graph is not None:
            return request.graph, request.residual, None
        if request.scan is not None:
            return *self._traced(job, asset, request, request.scan), None
        found = self._grown(job, asset, request)
        return found.graph, None, found

    def _traced(
        self, job: Job, asset: Asset, request: StoredRequest, scan: ScanRelief
    ) -> tuple[WrinkleGraph, Residual]:
        from rhytid.tracing.mixed import Growth, without_grain
        from rhytid.tracing.scan import fill_warnings, traced_scan

        def report(share: float, stage: str) -> None:
            job.progress(_SYNTHESIS * share, f"tracing: {stage}")

        with self._on_device.in_steps():
            found = traced_scan(
                self._device, request.mesh, scan, request.settings, report,
                self._on_device.run_patiently, Growth(request.controls, request.folds),
            )  # fmt: skip
            asset.warnings += (*fill_warnings(scan, found), *self._left(scan, found))
        for udim in asset.udims:
            check_cover(found.graph, request.settings, udim, self._limit)
        graph = found.graph
        if scan.filled and not found.grown:  # its settings have the grain of grown skin
            graph = without_grain(graph)
        return graph, Residual.of(found.residual)

    def _left(self, scan: ScanRelief, found: Trace) -> tuple[InputWarning, ...]:
        """Warnings of UDIMs whose lines explain next to nothing."""
        from rhytid.synthesis.workspace import Workspace
        from rhytid.tracing.measure import Left, spread

        work = Workspace(self._device, self._on_device.run_patiently)
        warnings: list[InputWarning] = []
        for udim, relief in scan.maps.items():
            if udim not in found.charts:  # all of it is grown
                continue
            residual, inside = found.residual[udim], found.charts[udim]
            # The fine part takes long: it is looked at where much is left.
            if spread(residual, inside) > _MUCH_LEFT * spread(relief, inside):
                warnings += Left.of(work, relief, residual, inside).warnings(udim)
        return tuple(warnings)

    def _grown(self, job: Job, asset: Asset, request: StoredRequest) -> Synthesis:
        from rhytid.synthesis.build_size import BuildSize
        from rhytid.synthesis.generate import synthesize

        size = ""
        if asset.expected_wrinkles < MOST_WRINKLES:  # else nobody has counted
            size = str(BuildSize.of(request.mesh, asset.expected_wrinkles))
        job.progress(0.0, "starting", size)

        def report(share: float, stage: str) -> None:
            job.progress(_SYNTHESIS * share, stage, size)

        found = synthesize(
            request.mesh, request.settings.graph, self._device, report,
            call=self._on_device.run_patiently, controls=request.controls, folds=request.folds,
            unit=request.settings.length_unit,
        )  # fmt: skip
        if request.settings.graph.age == USUAL_AGE:
            return found
        # Its depth is not that of the spacing alone: it is kept with the graph.
        origin = replace(
            found.graph.origin or GraphOrigin(),
            unit=request.settings.length_unit, depth=found.lengths.depth,
        )  # fmt: skip
        return replace(found, graph=found.graph.with_origin(origin))

    @contextmanager
    def _failing(self, job: Job, asset: Asset) -> Iterator[None]:
        """Make an error in the block the `reason` of the asset; an asset whose build was cancelled
        is removed."""
        try:
            yield
        except BaseException as error:
            self._fail(job, asset, error)
            raise

    def _fail(self, job: Job, asset: Asset, error: BaseException) -> None:
        with asset.lock:
            if asset.state != "removed":
                asset.fail(public_message(error))
                if isinstance(error, CancelledError) and not job.resumes:
                    with suppress(NotFoundError):
                        self._store.delete(asset.id)
