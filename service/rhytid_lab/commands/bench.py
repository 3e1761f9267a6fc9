"""`rhytid bench`: the cost of a frame on a device, in seconds and in copies of its map."""

from __future__ import annotations

import argparse
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rhytid.cli.options import add_force, add_json, readable
from rhytid.cli.parser import Commands, new_command
from rhytid.cli.service_options import add_device
from rhytid.cli.skin_options import add_density
from rhytid.domain.asset_settings import PRESETS
from rhytid.domain.mesh import Mesh
from rhytid.errors import FrameError, InputError
from rhytid.processes.interpreter import begin_again_as_device
from rhytid.support.console import STDOUT, counted, note
from rhytid_lab.commands import SUMMARIES, check_client
from rhytid_lab.commands.bench_report import (
    bake_table,
    case_table,
    print_untimed,
    refuse_wrong,
    reported,
    scaling_table,
    service_table,
)

if TYPE_CHECKING:
    from rhytid.device.runtime import Device
    from rhytid_lab.bench.frame import FrameBench
    from rhytid_lab.bench.scaling import Growth
    from rhytid_lab.bench.service import Latency
    from rhytid_lab.commands.demo_face import Animation

# As bench.frame and bench.comparison have them, which are not imported for --help.
CASES = ("stretch", "redraw", "precompute", "binned", "convolved", "neutral", "tile")
IMPLEMENTATIONS = ("rhytid", "opengl", "numba", "numpy", "opencv")
USUAL_REPEATS = 5


def add_command(commands: Commands) -> None:
    """Add `bench` to the parser."""
    parser = new_command(
        commands,
        "bench",
        SUMMARIES["bench"],
        "rhytid bench --size 4096 --wrinkles 1250000 --json figures.json",
    )
    parser.add_argument("--mesh", type=readable, metavar="NPZ", help="a neutral mesh with frames")
    frame = "the frame, from 1 (default: the one farthest from the neutral)"
    parser.add_argument("--frame", type=int, metavar="I", help=frame)
    parser.add_argument("--graph", type=readable, metavar="FILE", help="wrinkles of --mesh")
    parser.add_argument("--size", type=int, default=4096, metavar="R", help="texels per side")
    add_density(parser)
    add_force(parser)
    preset = "bins of `binned` (default: paper, which the other implementations blend, too)"
    parser.add_argument("--preset", choices=tuple(PRESETS), default="paper", help=preset)
    _add_names(parser, "--methods", CASES, "what to time")
    _add_names(parser, "--implementations", IMPLEMENTATIONS, "by whom")
    service = "time tiles through the service instead, under 1, 8 and 64 clients"
    parser.add_argument("--service", action="store_true", help=service)
    bake = "time frames of a bake instead, and its kernels and its files alone"
    parser.add_argument("--bake", action="store_true", help=bake)
    scaling = "draw instead how costs grow with texels, wrinkles, triangles and bins"
    parser.add_argument("--scaling", type=Path, metavar="DIR", help=scaling)
    repeats = f"runs per case (default: {USUAL_REPEATS}); of --bake frames that are timed (all)"
    parser.add_argument("--repeats", type=_count, metavar="N", help=repeats)
    add_device(parser)
    add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Put a face on the device, time its cases and print them."""
    begin_again_as_device()
    check_client()
    if arguments.scaling is not None:
        _run_scaling(arguments)
        return
    if arguments.bake:
        _run_bake(arguments)
        return
    bench = frame_bench(arguments)
    (_run_service if arguments.service else _run_cases)(bench, arguments)
    bench.release()


def _run_scaling(arguments: argparse.Namespace) -> None:
    from rhytid.support.console import make_folder
    from rhytid_lab.bench.scaling import SERIES, Scaling, plot
    from rhytid_lab.bench.subject import USUAL_WRINKLES
    from rhytid_lab.commands.bench_skin import print_need, scaled_settings

    make_folder(arguments.scaling)
    if arguments.spacing is not None:
        raise InputError("--spacing: series are counted in wrinkles: give --wrinkles")
    device, mesh, deformed = _frame_on_device(arguments)
    wrinkles = arguments.wrinkles or USUAL_WRINKLES
    print_need(device, mesh, scaled_settings(arguments), CASES, wrinkles)
    scaling = Scaling(device, mesh, deformed, arguments.size, wrinkles, _repeats(arguments))
    found: list[Growth] = []

    def figures() -> dict[str, Any]:
        about = {"device": device.info.name, "size": arguments.size, "wrinkles": wrinkles}
        return {**about, "results": [asdict(one) for one in found]}

    file = arguments.scaling / "scaling.json"
    with reported(arguments.json, figures, lambda: scaling_table(found), file):
        for series in counted(tuple(SERIES), "scaling", "series"):
            before = len(found)
            found.extend(scaling.run(series))  # one by one: none is lost that has ended
            plot(found[before:]).savefig(arguments.scaling / f"scaling_{series}.png")


def _run_bake(arguments: argparse.Namespace) -> None:
    from rhytid.support.cores import core_count
    from rhytid.support.settings import ServiceSettings
    from rhytid_lab.bench.bake import METHODS, WRITTEN, BakeCost, bake_bench, four_udims
    from rhytid_lab.commands.bench_skin import frame_settings
    from rhytid_lab.commands.demo_face import animation

    methods = [method for method in METHODS if method in arguments.methods]
    if not methods:
        raise InputError(f"--bake: --methods names neither of {' and '.join(METHODS)}")
    found = animation(arguments.mesh, ())
    frames = _differing_frames(found, arguments.repeats)
    service, costs = ServiceSettings.from_environment(), list[BakeCost]()
    service = replace(service, device=arguments.device or service.device)

    def figures() -> dict[str, Any]:
        about = {"size": arguments.size, "cores": core_count(), "frames": len(frames)}
        return {
            **about,
            "results": [{**asdict(c), "ratio": c.ratio, "work": c.work} for c in costs],
        }

    with reported(arguments.json, figures, lambda: bake_table(costs)):
        for udims in WRITTEN:
            mesh, moved = (found.mesh, frames) if udims == 1 else four_udims(found.mesh, frames)
            with bake_bench(service, mesh, moved, frame_settings(arguments)) as bench:
                wanted = [(method, files) for method in methods for files in WRITTEN[udims]]
                costs.extend(bench.cost(*one) for one in counted(wanted, f"{udims} UDIM", "case"))


def _differing_frames(found: Animation, repeats: int | None) -> NDArray[np.float32]:
    """The frames of an animation that a bake is measured by: those that differ from all before
    them, of which `repeats` are timed. Raises FrameError where there are too few."""
    from rhytid_lab.bench.bake import BEFORE, LEAST_FRAMES, that_differ

    every = np.stack([found.frames.read(place) for place in found.frames.places])
    kept = that_differ(every)
    copied = "a bake copies the files of a frame that repeats another"
    if len(kept) < LEAST_FRAMES:
        raise FrameError(
            f"--bake needs {LEAST_FRAMES} frames that differ, {len(kept)} of {len(every)} do: "
            f"{copied}, which takes no kernels"
        )
    if (same := len(every) - len(kept)) > 0:
        note(f"rhytid bench: notice: {same} of {len(every)} frames left out: {copied}")
    return kept if repeats is None else kept[: BEFORE + repeats]


def _repeats(arguments: argparse.Namespace) -> int:
    return USUAL_REPEATS if arguments.repeats is None else int(arguments.repeats)


def _run_service(bench: FrameBench, arguments: argparse.Namespace) -> None:
    from rhytid_lab.bench.service import CLIENTS, METHODS, service_bench

    rows: list[Latency] = []
    with service_bench(bench) as service:
        first = service.first_tile()

        def figures() -> dict[str, Any]:
            return {
                "device": bench.device.info.name,
                "size": bench.settings.resolution,
                "tile_size": bench.settings.tile_size,
                "wrinkles": bench.wrinkles,
                "first_tile": asdict(first),
                "results": [asdict(row) for row in rows],
            }

        with reported(arguments.json, figures, lambda: service_table(first, rows)):
            wanted = [(method, clients) for method in METHODS for clients in CLIENTS]
            rows.extend(service.latency(*one) for one in counted(wanted, "service", "load"))


def _run_cases(bench: FrameBench, arguments: argparse.Namespace) -> None:
    from rhytid_lab.bench.comparison import OURS, Comparison

    names = tuple(n for n in IMPLEMENTATIONS if n in {OURS, *arguments.implementations})
    cases = [case for case in CASES if case in arguments.methods]
    comparison = Comparison(bench, names, _repeats(arguments))

    def figures() -> dict[str, Any]:
        results = comparison.results
        return {
            "device": bench.device.info.name,
            "size": arguments.size,
            "wrinkles": bench.wrinkles,
            "copy_seconds": results.copy_seconds,
            "results": [asdict(timing) for timing in results.timings],
        }

    with reported(arguments.json, figures, lambda: case_table(comparison.results, CASES)):
        try:
            comparison.run(counted(cases, "bench", "case"))
        finally:
            if arguments.json == STDOUT:  # no table shows them then
                print_untimed(comparison.results)
    refuse_wrong(comparison.results)


def _add_names(
    parser: argparse.ArgumentParser, option: str, known: tuple[str, ...], what: str
) -> None:
    """An option that takes some of a few names, apart or with commas between."""

    def named(text: str) -> list[str]:
        names = text.split(",")
        for name in names:
            if name not in known:
                raise argparse.ArgumentTypeError(f"{name!r}: one of {', '.join(known)}")
        return names

    parser.add_argument(
        option,
        nargs="+",
        action=_Flat,
        type=named,
        default=list(known),
        metavar="NAME",
        help=f"{what}: some of {', '.join(known)} (default: all)",
    )


class _Flat(argparse.Action):
    """Lists of names become one."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option: Any = None) -> None:
        setattr(namespace, self.dest, [name for names in values for name in names])


def _count(text: str) -> int:
    if not (text.isascii() and text.isdigit() and int(text) > 0):
        raise argparse.ArgumentTypeError(f"{text!r}: a whole number above 0")
    return int(text)


def frame_bench(arguments: argparse.Namespace) -> FrameBench:
    """The face and the frame of the arguments on their device, with wrinkles."""
    # Imported here, so that --help needs no OpenCL.
    from rhytid_lab.bench.frame import FrameBench
    from rhytid_lab.commands.bench_skin import skin

    device, mesh, deformed = _frame_on_device(arguments)
    graph, settings = skin(device, mesh, arguments)
    return FrameBench(device, mesh, graph, deformed, settings)


def _frame_on_device(arguments: argparse.Namespace) -> tuple[Device, Mesh, NDArray[np.float32]]:
    """A device, and the mesh and the frame of the arguments."""
    from rhytid.engine.engine import open_device
    from rhytid.support.settings import ServiceSettings
    from rhytid_lab.commands.demo_face import animation

    if arguments.graph is not None and arguments.mesh is None:
        raise InputError("--graph: its wrinkles belong to a mesh: name it with --mesh")
    service = ServiceSettings.from_environment()
    found = animation(arguments.mesh, ())
    index = _frame(found, arguments.frame)
    device = open_device(service, arguments.device)
    return device, found.mesh, found.frames.read(found.frames.places[index])


def _frame(found: Animation, index: int | None) -> int:
    """The frame of an animation; the one whose vertices moved farthest where None is named."""
    places = found.frames.places
    if index is None:
        neutral = found.mesh.positions
        moved = [float(np.linalg.norm(found.frames.read(p) - neutral)) for p in places]
        return int(np.argmax(moved))
    if not 1 <= index <= len(places):
        raise FrameError(f"--frame {index}: the animation has frames 1 to {len(places)}")
    return index - 1
