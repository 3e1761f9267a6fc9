"""`rhytid bake`: an animation as sequences of texture files."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

from rhytid.cli.bake_options import bake_parser, refuse_conflicts
from rhytid.cli.options import Commands
from rhytid.cli.reporting import report
from rhytid.cli.serve import sharing
from rhytid.cli.timing import Stopwatch
from rhytid.cli.voice import note
from rhytid.domain.wording import plural
from rhytid.engine.messages import MapQuery
from rhytid.support.atomic_files import sweep
from rhytid.support.build_identity import check_drawing
from rhytid.support.settings import ServiceSettings
from rhytid.support.temporary_folders import temporary_folder

if TYPE_CHECKING:
    from rhytid.cli.bake_inputs import BakeInputs
    from rhytid.cli.bake_output import BakeSize
    from rhytid.cli.baking import Baker
    from rhytid.cli.dask_bake import DaskBake
    from rhytid.cli.warned import Warned
    from rhytid.engine.engine import Engine


def add_command(commands: Commands) -> None:
    """Add `bake` to the parser."""
    bake_parser(commands).set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Read everything, build the asset, bake, and report the times."""
    refuse_conflicts(arguments)
    if arguments.drawing_version:
        check_drawing(arguments.drawing_version)
    from rhytid.cli.warned import Warned

    with Warned("bake", arguments.strict, arguments.allow) as warned:
        _run(arguments, warned)


def _run(arguments: argparse.Namespace, warned: Warned) -> None:
    # Imported here, so that --help does not wait for OpenCL.
    from rhytid.cli.bake_cluster import check_cluster
    from rhytid.cli.bake_inputs import BakeInputs
    from rhytid.cli.bake_job import write_job
    from rhytid.cli.dask_bake import DaskBake
    from rhytid.cli.places import make_folder
    from rhytid.engine.engine import Engine

    given = BakeInputs.read(arguments, warned)
    if arguments.dask is not None:
        check_cluster(arguments.dask)
    make_folder(arguments.openjd or arguments.out)
    if given.new is not None:
        note(f"rhytid: {given.size(given.new.settings.resolution).text()}")
    watch = Stopwatch()
    with _service(arguments, watch) as service, closing(Engine(service)) as engine:
        baker = _baker(arguments, engine, given, watch, warned, service.store)
        if arguments.method == "binned" and not given.range_fixed:
            baker.calibrate()
        if arguments.openjd is not None:
            write_job(arguments, engine, baker, given)
            _share(engine, baker, given)
            return
        sweep(arguments.out)
        cluster = None if arguments.dask is None else DaskBake(arguments, given, baker)
        (cluster or baker).run()
        _share(engine, baker, given)
    _report(arguments, baker, watch, given.size(baker.asset.settings["resolution"]), cluster)


def _baker(
    arguments: argparse.Namespace,
    engine: Engine,
    given: BakeInputs,
    watch: Stopwatch,
    warned: Warned,
    store: Path,
) -> Baker:
    """What bakes with the asset of the arguments, which is built where it has to be."""
    from rhytid.cli.baking import Baker
    from rhytid.cli.ready_assets import build, stored
    from rhytid.cli.shared_assets import searching

    if given.new is None:
        with searching(store):
            asset = stored(engine, arguments.asset, given.mesh, arguments.resolution)
    else:
        with watch.step("build"):
            asset = build(engine, given.new, warned)
    output = given.output(arguments.out)
    query = MapQuery(arguments.method, arguments.stretch, arguments.sampling)
    return Baker(
        engine, asset, given.mesh, query, given.frames, output, watch, warned, given.geometry
    )


def _share(engine: Engine, baker: Baker, given: BakeInputs) -> None:
    """Give an asset that was built to the shared store, if there is one."""
    from rhytid.cli.shared_assets import share

    if given.new is not None:
        share(engine, baker.asset.id)


@contextmanager
def _service(arguments: argparse.Namespace, watch: Stopwatch) -> Iterator[ServiceSettings]:
    """The settings of the engine; without --store its assets last as long as the command. The asset
    of --asset is fetched before."""
    from rhytid.cli.shared_assets import fetch

    with temporary_folder("rhytid-") as folder:
        found = sharing(arguments.store or folder, arguments.device, arguments.shared_store)
        if arguments.asset is not None:
            fetch(found, arguments.asset, watch)
        yield replace(found, build_seconds=None)  # nobody else waits for it


def _report(
    arguments: argparse.Namespace,
    baker: Baker,
    watch: Stopwatch,
    size: BakeSize,
    cluster: DaskBake | None,
) -> None:
    figures = {
        "asset": baker.asset.id,
        "out": str(arguments.out),
        "written": baker.written,
        "skipped": baker.skipped,
        "bytes_at_most": asdict(size),
        "steps": watch.figures(),
        **baker.warned.all_figures(),
        **({} if cluster is None else {"cluster": asdict(cluster.figures)}),
    }
    what = plural(baker.written, "map" if arguments.geometry is None else "file")
    done = f", {baker.skipped} already there" if baker.skipped else ""
    summary = f"{what} written to {arguments.out}{done}"
    report(figures, f"{watch.table()}\n{summary}", arguments.json)
