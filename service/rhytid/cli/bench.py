"""`rhytid bench`: what a frame costs on a device, in seconds and in copies of its map."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from rhytid.cli.options import Commands, add_json, add_wrinkles, new_command, readable
from rhytid.cli.reporting import counted, report, share_bar, table
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.errors import FrameError

if TYPE_CHECKING:
    from rhytid.bench.frame import Cost, FrameBench
    from rhytid.device.runtime import Device


def add_command(commands: Commands) -> None:
    """Add `bench` to the parser."""
    parser = new_command(
        commands,
        "bench",
        "Time a frame on a device, in seconds and in map copies: a copy reads and writes R² "
        "float32 in the same run. On the built-in face, or on one of your own with its frames.",
        "rhytid bench --size 4096 --wrinkles 1250000",
    )
    parser.add_argument("--mesh", type=readable, metavar="NPZ", help="a neutral mesh with frames")
    parser.add_argument("--frame", type=int, metavar="I", help="the frame, from 0 (the middle one)")
    parser.add_argument("--graph", type=readable, metavar="FILE", help="wrinkles of --mesh")
    parser.add_argument("--size", type=int, default=4096, metavar="R", help="texels a side (4096)")
    add_wrinkles(parser)
    parser.add_argument("--repeats", type=int, default=5, metavar="N", help="runs a case (5)")
    parser.add_argument("--device", metavar="D", help="number or part of the name of a device")
    add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Put a face on the device, time its cases and tell them."""
    bench = frame_bench(arguments)
    cases = bench.cases()
    costs = [bench.cost(case, arguments.repeats) for case in counted(cases, "bench", "case")]
    figures = {
        "device": bench.device.info.name,
        "size": arguments.size,
        "wrinkles": bench.wrinkles,
        "copy_seconds": costs[0].seconds,
        "results": [_result(cost) for cost in costs[1:]],
    }
    rows = [(c.case, f"{c.seconds:.4f}", f"{c.map_copies:.1f}") for c in costs]
    report(figures, table(("case", "seconds", "map copies"), rows), arguments.json)


def frame_bench(arguments: argparse.Namespace) -> FrameBench:
    """The face and the frame of the arguments on their device."""
    # Imported here, so that --help needs no OpenCL.
    from rhytid.bench.frame import FrameBench
    from rhytid.cli.demo_face import animation
    from rhytid.device.runtime import Device
    from rhytid.device.select import choose
    from rhytid.settings import ServiceSettings

    service = ServiceSettings.from_environment()
    found = animation(arguments.mesh, ())
    places = found.frames.places
    index = len(places) // 2 if arguments.frame is None else arguments.frame
    if not 0 <= index < len(places):
        raise FrameError(f"--frame {index}: the animation has frames 0 to {len(places) - 1}")
    device = Device(choose(arguments.device or service.device), service.device_memory)
    graph, settings = _skin(device, found.mesh, arguments)
    return FrameBench(device, found.mesh, graph, found.frames.read(places[index]), settings)


def _skin(
    device: Device, mesh: Mesh, arguments: argparse.Namespace
) -> tuple[WrinkleGraph, AssetSettings]:
    """The wrinkles of the arguments, given or synthesised, and the settings to draw them with."""
    from rhytid.cli.input_files import graph_file
    from rhytid.synthesis.generate import synthesize

    sizes = {"resolution": arguments.size, "tile_size": min(512, arguments.size)}
    data: dict[str, Any] = {**sizes, "preset": "paper"}
    if arguments.wrinkles is not None:
        data["graph"] = {"wrinkles": arguments.wrinkles}
    settings = AssetSettings.parse(data)
    if arguments.graph is not None:
        return graph_file(arguments.graph), settings
    with share_bar("synthesis") as show:
        made = synthesize(mesh, settings.graph, device, show)
    return made.graph, settings.resolved(made.spacing)


def _result(cost: Cost) -> dict[str, Any]:
    return {
        "case": cost.case,
        "implementation": "rhytid",
        "seconds": cost.seconds,
        "map_copies": cost.map_copies,
    }
