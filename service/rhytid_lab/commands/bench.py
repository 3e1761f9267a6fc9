"""`rhytid bench`: the cost of a frame on a device, in seconds and in copies of its map."""

from __future__ import annotations

import argparse
import sys
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
from rhytid.errors import FrameError, InputError, RhytidError
from rhytid.support.console import STDOUT, counted, report, table, write_json
from rhytid_lab.commands import SUMMARIES, check_client

if TYPE_CHECKING:
    from rhytid.device.runtime import Device
    from rhytid_lab.bench.bake import BakeCost
    from rhytid_lab.bench.comparison import Results
    from rhytid_lab.bench.frame import FrameBench
    from rhytid_lab.bench.service import Latency
    from rhytid_lab.commands.demo_face import Animation

# As bench.frame and bench.comparison have them, which are not imported for --help.
CASES = ("stretch", "redraw", "precompute", "binned", "convolved", "neutral", "tile")
IMPLEMENTATIONS = ("rhytid", "opengl", "numba", "numpy", "opencv")
SERVICE_HEADER = (
    "method", "clients", "p50 ms", "p99 ms", "tiles/s", "kernel ms", "not kernel"
)  # fmt: skip
BAKE_HEADER = (
    "method", "files", "UDIMs", "kernels s (processor)", "drawn", "written", "bake", "ratio",
    "work",
)  # fmt: skip
# Of a bake whose first ones are not timed.
LEAST_FRAMES = 5
HEADER = ("case", "implementation", "seconds", "map copies", "max difference", "note")


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
    parser.add_argument("--repeats", type=_count, default=5, metavar="N", help="runs per case")
    add_device(parser)
    add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Put a face on the device, time its cases and print them."""
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
    scaling = Scaling(device, mesh, deformed, arguments.size, wrinkles, arguments.repeats)
    found = []
    for series in counted(tuple(SERIES), "scaling", "series"):
        grown = scaling.run(series)
        plot(grown).savefig(arguments.scaling / f"scaling_{series}.png")
        found += grown
    rows = [(g.series, str(g.x), g.case, f"{g.seconds:.4f}", _copies(g.map_copies)) for g in found]
    figures = {
        "device": device.info.name,
        "size": arguments.size,
        "wrinkles": wrinkles,
        "results": [asdict(g) for g in found],
    }
    write_json(figures, arguments.scaling / "scaling.json")
    report(figures, table(("series", "x", "case", "seconds", "map copies"), rows), arguments.json)


def _run_bake(arguments: argparse.Namespace) -> None:
    from rhytid.support.cores import core_count
    from rhytid.support.settings import ServiceSettings
    from rhytid_lab.bench.bake import METHODS, WRITTEN, BakeCost, bake_bench, four_udims
    from rhytid_lab.commands.bench_skin import frame_settings
    from rhytid_lab.commands.demo_face import animation

    found = animation(arguments.mesh, ())
    frames = np.stack([found.frames.read(place) for place in found.frames.places])
    if len(frames) < LEAST_FRAMES:
        raise FrameError(f"--bake needs {LEAST_FRAMES} frames or more, {len(frames)} are there")
    service, costs = ServiceSettings.from_environment(), list[BakeCost]()
    service = replace(service, device=arguments.device or service.device)
    for udims in WRITTEN:
        mesh, moved = (found.mesh, frames) if udims == 1 else four_udims(found.mesh, frames)
        with bake_bench(service, mesh, moved, frame_settings(arguments)) as bench:
            wanted = [(method, files) for method in METHODS for files in WRITTEN[udims]]
            costs += [bench.cost(*one) for one in counted(wanted, f"{udims} UDIM", "case")]
    figures = {
        "size": arguments.size,
        "cores": core_count(),
        "frames": len(frames),
        "results": [{**asdict(c), "ratio": c.ratio, "work": c.work} for c in costs],
    }
    report(figures, table(BAKE_HEADER, map(_bake_row, costs)), arguments.json)


def _bake_row(cost: BakeCost) -> tuple[str, ...]:
    parts = (cost.kernels, cost.drawn, cost.files, cost.bake)
    spent = [f"{part.seconds:.3f} ({part.processor:.3f})" for part in parts]
    ratios = f"{cost.ratio:.2f}", f"{cost.work:.2f}"
    return cost.method, cost.written, str(cost.udims), *spent, *ratios


def _copies(map_copies: float | None) -> str:
    return "" if map_copies is None else f"{map_copies:.1f}"


def _run_service(bench: FrameBench, arguments: argparse.Namespace) -> None:
    from rhytid_lab.bench.service import CLIENTS, METHODS, service_bench

    with service_bench(bench) as service:
        first = service.first_tile()
        wanted = [(method, clients) for method in METHODS for clients in CLIENTS]
        rows = [service.latency(*one) for one in counted(wanted, "service", "load")]
    figures = {
        "device": bench.device.info.name,
        "size": bench.settings.resolution,
        "tile_size": bench.settings.tile_size,
        "wrinkles": bench.wrinkles,
        "first_tile": asdict(first),
        "results": [asdict(row) for row in rows],
    }
    milliseconds = (
        f"{1000 * first.seconds:.1f} ms, its kernels {1000 * first.kernel_seconds:.1f} ms"
    )
    line = f"frame in, first tile out: {milliseconds}: {first.ratio:.1f} times"
    report(figures, f"{line}\n{table(SERVICE_HEADER, map(_latency_row, rows))}", arguments.json)


def _latency_row(row: Latency) -> tuple[str, ...]:
    seconds = (row.p50_seconds, row.p99_seconds, row.kernel_seconds)
    p50, p99, kernel = (f"{1000 * s:.1f}" for s in seconds)
    rate, share = f"{row.tiles_per_second:.0f}", f"{row.not_kernel:.2f}"
    return row.method, str(row.clients), p50, p99, rate, kernel, share


def _run_cases(bench: FrameBench, arguments: argparse.Namespace) -> None:
    from rhytid_lab.bench.comparison import OURS, Comparison

    names = tuple(n for n in IMPLEMENTATIONS if n in {OURS, *arguments.implementations})
    cases = [case for case in CASES if case in arguments.methods]
    results = Comparison(bench, names, arguments.repeats).run(counted(cases, "bench", "case"))
    figures = {
        "device": bench.device.info.name,
        "size": arguments.size,
        "wrinkles": bench.wrinkles,
        "copy_seconds": results.copy_seconds,
        "results": [asdict(timing) for timing in results.timings],
    }
    report(figures, table(HEADER, _rows(results)), arguments.json)
    _print_untimed(results, to_stderr=arguments.json == STDOUT)


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


def _rows(results: Results) -> list[tuple[str, ...]]:
    timed = [
        (e.case, e.implementation, f"{e.seconds:.4f}", f"{e.map_copies:.1f}",
         f"{e.max_difference:.1e}" if e.max_difference else "0", "")
        for e in results.timings
    ]  # fmt: skip
    left = [(e.case, e.implementation, "", "", "", e.reason) for e in results.untimed]
    copy = ("copy", "rhytid", f"{results.copy_seconds:.4f}", "1.0", "", "")
    rows = [*timed, *left]
    return [copy, *sorted(rows, key=lambda row: CASES.index(row[0]))]


def _print_untimed(results: Results, *, to_stderr: bool) -> None:
    """Print which implementations were not timed, where no table shows them; raises RhytidError
    where a result was wrong."""
    if to_stderr:
        for left in results.untimed:
            print(f"{left.case}: {left.implementation}: {left.reason}", file=sys.stderr)
    off = [f"{left.implementation} in {left.case}" for left in results.untimed if left.off]
    if off:
        raise RhytidError(f"the results differ from rhytid's: {', '.join(off)}")


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
