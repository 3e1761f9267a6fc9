"""A bake from its request to its summary."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import asdict, replace
from pathlib import Path

from rhytid.baking.assets import build, fetch, naming_store, share, stored
from rhytid.baking.baker import Baker
from rhytid.baking.farm.dask_bake import DaskBake, check_cluster
from rhytid.baking.farm.openjd_bundle import write_job
from rhytid.baking.inputs import BakeInputs
from rhytid.baking.request import BakeRequest, BakeSummary
from rhytid.baking.run_warnings import RunWarnings
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.tiles import TileGrid
from rhytid.domain.wording import plural
from rhytid.engine.engine import Engine
from rhytid.errors import InputError
from rhytid.support.atomic_files import sweep
from rhytid.support.console import Stopwatch, make_folder, note
from rhytid.support.settings import ServiceSettings
from rhytid.support.temporary_folders import temporary_folder


@contextmanager
def bake(request: BakeRequest, warnings: RunWarnings) -> Iterator[tuple[BakeSummary, Baker]]:
    """Bake the maps that are not baked yet, or write a job bundle, as the request asks. In the
    block all that is done, and the engine still has the asset: the baker may draw more of it.

    Raises InputError, LimitError and SettingsError naming the file or the setting, ConflictError
    where the asset cannot be built or used, NotFoundError where it is missing, StrictError where
    warnings are errors, and FarmError where a cluster does not work.
    """
    inputs = BakeInputs.read(request, warnings)
    if request.dask is not None:
        check_cluster(request.dask)
    if inputs.new is not None:
        _check_level(request, inputs.new.settings.grid)
    make_folder(request.openjd or request.out)
    if inputs.new is not None:
        note(f"rhytid: {inputs.size(inputs.new.settings.resolution).text()}")
    watch = Stopwatch()
    with _service(request, watch) as service, closing(Engine(service)) as engine:
        baker = _baker(request, engine, inputs, watch, warnings, service.store)
        if request.query.method == "binned" and not inputs.range_fixed:
            baker.calibrate()
        run = _maps if request.openjd is None else write_job
        yield run(request, baker, inputs), baker
        if inputs.new is not None:
            share(engine, baker.asset.id)


@contextmanager
def _service(request: BakeRequest, watch: Stopwatch) -> Iterator[ServiceSettings]:
    """The settings of the engine. Without a store the assets last as long as the block. An asset
    that the request names is fetched from the shared store first."""
    with temporary_folder("rhytid-") as folder:
        service = replace(request.service, store=request.store or folder)
        if request.asset is not None:
            fetch(service, request.asset, watch)
        yield replace(service, build_seconds=None)  # nobody else waits for it


def _baker(
    request: BakeRequest,
    engine: Engine,
    inputs: BakeInputs,
    watch: Stopwatch,
    warnings: RunWarnings,
    store: Path,
) -> Baker:
    """A baker with the asset of the request, which is built or taken from the store."""
    if inputs.new is not None:
        with watch.step("build"):
            asset = build(engine, inputs.new, warnings)
    else:
        assert request.asset is not None
        with naming_store(store):
            asset = stored(engine, request.asset, inputs.mesh, request.resolution)
        _check_level(request, AssetSettings.parse(asset.settings).grid)
    output = inputs.output(request.out)
    return Baker(
        engine, asset, inputs.mesh, request.query, inputs.frames, output, watch, warnings,
        inputs.geometry, request.lag,
    )  # fmt: skip


def _check_level(request: BakeRequest, grid: TileGrid) -> None:
    """Raise InputError where maps are asked for at a level that there is not."""
    asked, last = request.shine.of_moments, grid.levels - 1
    if asked > last and any(profile.of_slopes for profile in request.profiles):
        raise InputError(
            f"--level {asked}: maps of {grid.resolution} x {grid.resolution} texels have levels "
            f"0 to {last}"
        )


def _maps(request: BakeRequest, baker: Baker, inputs: BakeInputs) -> BakeSummary:
    """Write the maps, on this machine or on a cluster."""
    sweep(request.out)
    cluster = None if request.dask is None else DaskBake(request, inputs, baker)
    (cluster or baker).run()
    figures = {
        "asset": baker.asset.id,
        "out": str(request.out),
        "written": baker.written,
        "skipped": baker.skipped,
        "replaced": baker.replaced,
        "bytes_at_most": asdict(inputs.size(baker.asset.settings["resolution"])),
        "steps": baker.watch.figures(),
        **baker.warnings.all_figures(),
        **({} if cluster is None else {"cluster": asdict(cluster.figures)}),
    }
    what = plural(baker.written, "map" if request.geometry is None else "file")
    over = f" ({plural(baker.replaced, 'older file')} replaced)" if baker.replaced else ""
    done = f", {baker.skipped} already there" if baker.skipped else ""
    text = f"{baker.watch.table()}\n{what} written to {request.out}{over}{done}"
    return BakeSummary(figures, text)
