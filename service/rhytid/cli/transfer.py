"""`rhytid transfer`: a wrinkle graph carried to another mesh."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rhytid.cli.options import (
    MESH_FILES,
    add_force,
    add_json,
    add_prim,
    add_strict,
    add_unit,
    length_unit,
    prim_clip,
    readable,
    with_warnings,
)
from rhytid.cli.parser import Commands, new_command
from rhytid.cli.service_options import add_device
from rhytid.cli.summaries import SUMMARIES
from rhytid.domain.asset_settings import AssetSettings
from rhytid.errors import InputError
from rhytid.support.console import check_suffix, make_place, report, table, working

if TYPE_CHECKING:
    from rhytid.baking.run_warnings import RunWarnings
    from rhytid.domain.graph import WrinkleGraph
    from rhytid.meshes.transfer import Transfer

_GRAPH = ".safetensors"


def add_command(commands: Commands) -> None:
    """Add `transfer` to the parser."""
    parser = new_command(
        commands,
        "transfer",
        SUMMARIES["transfer"],
        "rhytid transfer face.safetensors face.obj film.obj --out film.safetensors",
    )
    add = parser.add_argument
    add("graph", type=readable, metavar="GRAPH.safetensors", help="wrinkles of FROM")
    add("old", type=readable, metavar="FROM", help=f"its mesh: {MESH_FILES} of one mesh")
    add("new", type=readable, metavar="TO", help="the other mesh, in the same place and unit")
    out = "the file to write"
    add("--out", type=Path, required=True, metavar="G.safetensors", help=out)
    reach = "how far a pore may be from TO, mesh units (default: 1/50 of the longest side of FROM)"
    add("--reach", type=float, metavar="D", help=reach)
    add_unit(parser, "both meshes")
    add_prim(parser)
    to_prim = "the same for TO (default: that of --prim)"
    add("--to-prim", metavar="PATH", help=to_prim)
    add_device(parser, ", for a graph that does not name the triangles of its pores")
    add_force(parser)
    add_strict(parser)
    add_json(parser)
    parser.set_defaults(run=run)


@with_warnings
def run(arguments: argparse.Namespace, warnings: RunWarnings) -> None:
    """Carry the graph over, write it, and report the figures."""
    from rhytid.baking.input_files import graph_file, mesh_file
    from rhytid.cli.graph_output import open_device, placed_graph, whole_file
    from rhytid.formats.graphs import graph_pieces
    from rhytid.meshes.transfer import transfer

    out: Path = arguments.out
    check_suffix(out, _GRAPH, "the graph")
    if arguments.reach is not None and not arguments.reach > 0:
        raise InputError(f"--reach is {arguments.reach:g}: must be above 0")
    old = mesh_file(arguments.old, prim_clip(arguments.prim)).mesh
    read = mesh_file(arguments.new, prim_clip(arguments.to_prim or arguments.prim))
    new, resolution = read.mesh, AssetSettings().resolution
    unit = length_unit(arguments, read)
    warnings.inputs(new, arguments.new.name, unit, resolution)
    make_place(out)
    graph = placed_graph(
        lambda: open_device(arguments), old, graph_file(arguments.graph), force=arguments.force
    )
    with working("carrying the graph over"):
        moved = transfer(graph, old, new, arguments.reach)
    whole_file(out, graph_pieces(moved.graph))
    figures = {"file": str(out), **_figures(graph, moved), "warnings": warnings.figures()}
    rows = [(name, _text(value)) for name, value in figures.items() if name != "warnings"]
    report(figures, table(("figure", "value"), rows), arguments.json)


def _figures(graph: WrinkleGraph, moved: Transfer) -> dict[str, Any]:
    """Numbers of pores and wrinkles before and after, and how many were lost for each reason."""
    names = ("pores", "wrinkles")
    before = {f"{name} before": n for name, n in zip(names, graph.counts(), strict=True)}
    after = dict(zip(names, moved.graph.counts(), strict=True))
    mean, most = moved.distance
    lost = {name: n for name, n in asdict(moved).items() if isinstance(n, int)}
    return before | after | {"mean distance": mean, "most distance": most} | lost


def _text(value: object) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)
