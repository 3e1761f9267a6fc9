"""`rhytid synthesize`: a wrinkle graph for a mesh, as a file."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from rhytid.cli.options import Commands, add_json, add_wrinkles, new_command, readable
from rhytid.cli.reporting import report, share_bar, table
from rhytid.domain.asset_settings import AssetSettings, GraphSettings


def add_command(commands: Commands) -> None:
    """Add `synthesize` to the parser."""
    parser = new_command(
        commands,
        "synthesize",
        "Grow pores and wrinkles on a neutral mesh and write them as safetensors.",
        "rhytid synthesize face.obj --out face.safetensors --wrinkles 300000",
    )
    parser.add_argument("mesh", type=readable, metavar="MESH", help="OBJ, PLY, glTF, GLB or npz")
    parser.add_argument(
        "--out", type=Path, required=True, metavar="GRAPH.safetensors", help="the file to write"
    )
    add_wrinkles(parser)
    parser.add_argument("--seed", type=int, metavar="S", help="another seed, another skin")
    parser.add_argument("--device", metavar="D", help="number or part of the name of a device")
    add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Read, synthesise, write, and tell figures of what came out."""
    # Imported here, so that --help needs no OpenCL.
    from rhytid.cli.input_files import mesh_file
    from rhytid.device.runtime import Device
    from rhytid.device.select import choose
    from rhytid.formats.graphs import write_graph
    from rhytid.settings import ServiceSettings
    from rhytid.storage.durable import install, workplace, write_file
    from rhytid.synthesis.generate import synthesize
    from rhytid.synthesis.statistics import statistics

    settings = graph_settings(arguments.wrinkles, arguments.seed)
    mesh = mesh_file(arguments.mesh).mesh
    service = ServiceSettings.from_environment()
    device = Device(choose(arguments.device or service.device), service.device_memory)
    out: Path = arguments.out
    out.parent.mkdir(parents=True, exist_ok=True)
    with workplace(out.parent) as place:
        with share_bar("synthesis") as show:
            graph = synthesize(mesh, settings, device, show).graph
        aside = place / out.name
        write_file(aside, write_graph(graph))
        install(aside, out)
    figures = {"file": str(out), **statistics(mesh, graph, device)}
    report(figures, table(("figure", "value"), _rows(figures)), arguments.json)


def graph_settings(wrinkles: int | None, seed: int | None) -> GraphSettings:
    """Settings of the synthesis, defaults where None; raises SettingsError."""
    given = {"wrinkles": wrinkles, "seed": seed}
    return AssetSettings.parse({"graph": {k: v for k, v in given.items() if v is not None}}).graph


def _rows(figures: dict[str, Any]) -> list[tuple[str, str]]:
    rows = []
    for name, value in figures.items():
        parts = value.items() if isinstance(value, dict) else [("", value)]
        rows += [(f"{name} {part}".strip(), _text(v)) for part, v in parts]
    return rows


def _text(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
