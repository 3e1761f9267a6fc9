"""Outputs of commands that have a wrinkle graph: figures, curves and a picture."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rhytid.cli.options import add_json
from rhytid.cli.service_options import add_device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.lengths import Lengths
from rhytid.domain.mesh import Mesh
from rhytid.domain.wording import plural
from rhytid.errors import InputError
from rhytid.support.console import check_suffix, detail, make_place, report, table, working

if TYPE_CHECKING:
    from rhytid.device.runtime import Device

PNG = ".png"


def add_outputs(parser: argparse.ArgumentParser) -> None:
    """Add `--curves`, `--preview`, `--patch`, `--device` and `--json`."""
    add = parser.add_argument
    curves = "write the wrinkles as lines in space, for other programs"
    add("--curves", type=Path, metavar="FILE.obj|.usda", help=curves)
    picture = "write a picture of the whole maps and of patches 20 mm wide"
    add("--preview", type=Path, metavar="FILE.png", help=picture)
    patch = (
        "with --preview: the place of the patch, U and V in UV (1.3 0.5 is in UDIM 1002) or X, Y "
        "and Z near the surface (default: the two flattest places)"
    )
    add("--patch", nargs="+", type=float, default=[], metavar="NUMBER", help=patch)
    add_device(parser)
    add_json(parser)


def check_outputs(arguments: argparse.Namespace, mesh: Mesh) -> None:
    """Check before long work that the outputs can be written, and make their folders. Raises
    InputError for an unknown ending, a file that cannot be written, or a patch that is not on the
    mesh."""
    from rhytid.exports.curves import curve_file

    if arguments.patch:
        _check_patch(arguments, mesh)

    if arguments.curves is not None:
        curve_file(arguments.curves.name)
    if arguments.preview is not None:
        check_suffix(arguments.preview, PNG, "the preview")
    make_place(arguments.curves)
    make_place(arguments.preview)


def _check_patch(arguments: argparse.Namespace, mesh: Mesh) -> None:
    from rhytid.cli.preview_spots import spot_at

    if arguments.preview is None:
        raise InputError("--patch needs --preview FILE.png: it is drawn in that picture")
    if len(arguments.patch) not in (2, 3):
        raise InputError(f"--patch has {plural(len(arguments.patch), 'number')}: U V or X Y Z")
    spot_at(mesh, arguments.patch, 1.0)


def placed_graph(
    opened: Callable[[], Device], mesh: Mesh, graph: WrinkleGraph, *, force: bool
) -> WrinkleGraph:
    """The graph with the triangle of each pore. Those that its file leaves open are found on a
    device.

    opened: opens the device; called only where one is needed.  force: whether a graph of another
    mesh is used.
    """
    from rhytid.domain.graph_geometry import with_triangles
    from rhytid.engine.assets.graphs import check_graph
    from rhytid.pipeline.locate import locate_points

    check_graph(graph, mesh, force=force)
    known = graph.node_triangle
    if known is not None and (known >= 0).all():
        return graph
    settings, device = AssetSettings(), opened()
    with working("placing the pores"), device.task():
        found = locate_points(device, mesh, graph.node_uv, settings.resolution, settings.padding)
    triangle = found if known is None else np.where(known >= 0, known, found)
    return with_triangles(graph, triangle, len(mesh.faces))


def write_outputs(
    arguments: argparse.Namespace,
    device: Device,
    mesh: Mesh,
    graph: WrinkleGraph,
    facts: dict[str, Any],
    first: Callable[[], None] | None = None,
) -> None:
    """Write the outputs that the arguments ask for, and report `facts` with the statistics of the
    graph.  first: writes the graph itself, while this is measured."""
    from rhytid.cli.preview import write_preview
    from rhytid.domain.graph_geometry import graph_curves
    from rhytid.exports.curves import curve_file
    from rhytid.synthesis.statistics import statistics

    settings = AssetSettings(unit=arguments.unit).for_graph(graph.origin)
    lengths = _lengths(mesh, graph, settings)
    drawn = {
        "unit": settings.length_unit,
        "depth": lengths.depth,
        "spacing": lengths.spacing,
    }
    with working("measuring the graph"), _beside(first) if first else nullcontext():
        figures = {**facts, **statistics(mesh, graph, device), **drawn}
    if arguments.curves is not None:
        write = curve_file(arguments.curves.name).write
        detail(f"writing {arguments.curves}")
        whole_file(arguments.curves, write(graph_curves(mesh, graph), settings.length_unit))
    if arguments.preview is not None:
        distance = figures["distance"]["mean"] or lengths.spacing
        drawing = settings.with_lengths(lengths)
        write_preview(device, mesh, graph, drawing, distance, arguments.preview, arguments.patch)
    report(figures, table(("figure", "value"), _rows(figures)), arguments.json)


@contextmanager
def _beside(task: Callable[[], None]) -> Iterator[None]:
    """Run a task on another thread during the block, which ends with it and raises what it does:
    a disk is waited for meanwhile."""
    with ThreadPoolExecutor(1) as pool:
        done = pool.submit(task)
        yield
        done.result()


def whole_file(file: Path, pieces: Any) -> None:
    """Write pieces of bytes into a file, which appears when it is complete. Its folder exists."""
    from rhytid.support.atomic_files import atomic_write, write_pieces

    with atomic_write(file) as aside:
        write_pieces(aside, pieces)


def open_device(arguments: argparse.Namespace) -> Device:
    """Open the device that the arguments name, else the one of the environment."""
    from rhytid.engine import engine
    from rhytid.support.settings import ServiceSettings

    with working("opening the device"):
        return engine.open_device(ServiceSettings.from_environment(), arguments.device)


def _lengths(mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings) -> Lengths:
    """The lengths that the graph is drawn with. Distances of pores are measured where its file has
    none."""
    from rhytid.engine.assets.graphs import graph_lengths, mean_spacing

    if graph.origin is not None and graph.origin.spacing is not None:
        return graph_lengths(graph, settings, graph.origin.spacing)
    assert graph.node_triangle is not None
    known = graph.node_triangle
    distance = mean_spacing(mesh, graph, np.where(known >= 0, known, len(mesh.faces)))
    return graph_lengths(graph, settings, distance)


def _rows(figures: dict[str, Any]) -> list[tuple[str, str]]:
    rows = []
    for name, value in figures.items():
        if name == "warnings":  # printed on stderr
            continue
        parts = value.items() if isinstance(value, dict) else [("", value)]
        rows += [(f"{name} {part}".strip(), _text(v)) for part, v in parts]
    return rows


def _text(value: object) -> str:
    if isinstance(value, list):
        return " ".join(_text(v) for v in value)
    return f"{value:.4g}" if isinstance(value, float) else str(value)
