"""`rhytid graph`: a wrinkle graph on its mesh as figures, curves and a picture."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from rhytid.cli.graph_output import (
    add_outputs,
    check_outputs,
    open_device,
    placed_graph,
    write_outputs,
)
from rhytid.cli.options import (
    MESH_FILES,
    add_force,
    add_prim,
    add_strict,
    add_unit,
    length_unit,
    prim_clip,
    readable,
    with_warnings,
)
from rhytid.cli.parser import Commands, new_command
from rhytid.cli.summaries import SUMMARIES
from rhytid.domain.asset_settings import AssetSettings

if TYPE_CHECKING:
    from rhytid.baking.run_warnings import RunWarnings


def add_command(commands: Commands) -> None:
    """Add `graph` to the parser."""
    parser = new_command(
        commands,
        "graph",
        SUMMARIES["graph"],
        "rhytid graph face.obj face.safetensors --curves face.usda",
    )
    parser.add_argument("mesh", type=readable, metavar="MESH", help=f"{MESH_FILES} of one mesh")
    parser.add_argument("graph", type=readable, metavar="GRAPH.safetensors", help="its wrinkles")
    add_unit(parser, "MESH")
    add_prim(parser)
    add_force(parser)
    add_strict(parser)
    add_outputs(parser)
    parser.set_defaults(run=run)


@with_warnings
def run(arguments: argparse.Namespace, warnings: RunWarnings) -> None:
    """Read both files, find the pores on the mesh, write the outputs, and report the figures."""
    from rhytid.baking.input_files import graph_file, mesh_file

    read = mesh_file(arguments.mesh, prim_clip(arguments.prim))
    mesh, unit = read.mesh, length_unit(arguments, read)
    warnings.inputs(mesh, arguments.mesh.name, unit, AssetSettings().resolution)
    check_outputs(arguments, mesh)
    device = open_device(arguments)
    graph = placed_graph(lambda: device, mesh, graph_file(arguments.graph), force=arguments.force)
    facts = {"file": str(arguments.graph), "warnings": warnings.figures()}
    write_outputs(arguments, device, mesh, graph, facts)
