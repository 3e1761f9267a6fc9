"""`rhytid displace`: a mesh moved by displacement that there is already."""

from __future__ import annotations

import argparse
from pathlib import Path

from rhytid.cli.options import (
    add_json,
    add_mesh,
    add_prim,
    add_strict,
    add_unit,
    length_unit,
    map_file,
    prim_clip,
)
from rhytid.cli.parser import Commands, new_command
from rhytid.cli.scan_options import (
    SCAN_FILES,
    add_scan_settings,
    checked_scan,
)
from rhytid.cli.summaries import SUMMARIES
from rhytid.errors import InputError
from rhytid.support.console import make_place, report, working

_FORMATS = ("glb", "ply")
SUMMARY = SUMMARIES["displace"]
DETAILS = """
Each triangle is cut in four, once or more, and each vertex is moved along the normal by the height
that its map has there, as `bake --geometry` does it: with the maps that bake wrote it writes the
same surface. Sides of UV seams stay closed. No device is needed."""


def add_command(commands: Commands) -> None:
    """Add `displace` to the parser."""
    example = "rhytid displace head.obj disp.1001.tif --scale 2 --scan-unit mm --out head.glb"
    parser = new_command(commands, "displace", SUMMARY, example)
    parser.description = SUMMARY + DETAILS
    add = parser.add_argument
    add_mesh(parser, "MESH", required=False)
    add("maps", nargs="+", type=map_file, metavar="MAP", help=SCAN_FILES)
    add_scan_settings(parser)
    add_unit(parser, "MESH", "that of a USD file which names one, else cm")
    fine = parser.add_mutually_exclusive_group()
    levels = "how many times each triangle is cut in four, 0 to 8"
    fine.add_argument(
        "--subdivide", type=int, choices=range(9), default=2, metavar="N", help=levels
    )
    edge = "cut until edges are no longer than this, mesh units; a twentieth of them may be"
    fine.add_argument("--edge", type=float, metavar="LENGTH", help=edge)
    curved = "curve the surface between the vertices of MESH, so that its facets do not show"
    add("--curved", action="store_true", help=curved)
    add_prim(parser)
    out = "the file to write: .glb or .ply"
    add("--out", type=Path, required=True, metavar="FILE", help=out)
    add_json(parser)
    add_strict(parser)
    parser.set_defaults(run=run, usage_error=parser.refuse)


def run(arguments: argparse.Namespace) -> None:
    """Write the displaced surface, and report how large it is."""
    if arguments.mesh is None:
        # One name alone is taken for a map.
        only = f"there is {arguments.maps[0]} alone"
        arguments.usage_error(f"give a mesh and, after it, its maps: {only}")
    from rhytid.baking.input_files import mesh_file
    from rhytid.baking.map_sources import Geometry
    from rhytid.baking.run_warnings import RunWarnings
    from rhytid.exports.displaced import levels_for

    out: Path = arguments.out
    format = out.suffix.lower().removeprefix(".")
    if format not in _FORMATS:
        raise InputError(f"{out}: the surface is written as .glb or .ply")
    read = mesh_file(arguments.mesh, prim_clip(arguments.prim))
    mesh, unit = read.mesh, length_unit(arguments, read)
    levels = arguments.subdivide if arguments.edge is None else levels_for(mesh, arguments.edge)
    with RunWarnings("displace", arguments.strict, arguments.allow) as warnings:
        warnings.file(read)
        geometry = Geometry(mesh, format, levels)
        scan = checked_scan(arguments, arguments.maps, mesh, unit, warnings).scan
        warnings.refuse()
        make_place(out)
        with working(f"writing {out.name}"):
            maps = {udim: scan.relief(udim) for udim in scan.maps}
            geometry.write(out, mesh.positions, maps, curved=arguments.curved)
        figures = {
            "file": str(out),
            "triangles": len(mesh.faces) * 4**levels,
            "levels": levels,
            "unit": unit,
            "udims": sorted(scan.maps),
            **warnings.all_figures(),
        }
    times = f"cut {levels} times" if levels != 1 else "cut once"
    report(figures, f"{out}: {figures['triangles']} triangles, {times}", arguments.json)
