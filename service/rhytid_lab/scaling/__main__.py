"""`python -m rhytid_lab.scaling`: costs of many devices, predicted, checked and simulated."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path

from rhytid.console import report, table
from rhytid.errors import RhytidError
from rhytid_lab.scaling.check import check
from rhytid_lab.scaling.constants import Constants
from rhytid_lab.scaling.figures import read_frame, read_runs
from rhytid_lab.scaling.fleet import Fleet, compare
from rhytid_lab.scaling.measure import Shot, measure
from rhytid_lab.scaling.model import METHODS, Head, Model
from rhytid_lab.scaling.page import rewritten
from rhytid_lab.scaling.tables import CHECK_HEADER, OUTCOME_HEADER, check_row, outcome_row

# Fields of a cost, as people read them.
_COSTS = {
    "seconds": "time of the job, s",
    "device_seconds": "all devices together, s",
    "nbytes": "files, bytes",
    "money": "money",
    "frame_money": "money a frame",
}


def main(words: Sequence[str] | None = None) -> int:
    """Run one of the commands; 1 where it fails, with the reason on stderr."""
    arguments = _parser().parse_args(words)
    try:
        arguments.run(arguments)
    except (RhytidError, OSError) as error:
        sys.stderr.write(f"rhytid_lab.scaling: {error}\n")
        return 1
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m rhytid_lab.scaling", description=__doc__)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    _add_measure(commands.add_parser("measure", help="time `rhytid bake` by 1 and more processes"))
    _add_check(commands.add_parser("check", help="compare the model with these runs"))
    _add_cost(commands.add_parser("cost", help="seconds, bytes and money of a job"))
    _add_placement(commands.add_parser("placement", help="simulate policies of placement"))
    page = commands.add_parser("page", help="write the tables of docs/scaling.md")
    page.add_argument("file", type=Path)
    page.set_defaults(run=lambda given: _page(given.file))
    return parser


def _add_measure(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--mesh", type=Path, required=True, help="a mesh file that holds frames")
    add("--store", type=Path, required=True, help="the store that holds the built asset")
    add("--asset", required=True, metavar="ID")
    add("--frames", type=int, default=60, metavar="N", help="frames 1 to N")
    add("--workers", type=int, nargs="+", default=[1, 2], metavar="N")
    add("--methods", nargs="+", choices=METHODS, default=list(METHODS))
    add("--scratch", type=Path, default=Path(), help="for maps and copies of the store")
    _add_json(parser)
    parser.set_defaults(run=_measure)


def _measure(given: argparse.Namespace) -> None:
    shot = Shot(given.mesh, given.store, given.asset, given.frames)
    runs = [
        measure(shot, method, workers, given.scratch)
        for method in given.methods
        for workers in given.workers
    ]
    rows = [
        (run.size, run.method, run.workers, f"{run.wall:.1f}", f"{run.processor:.1f}")
        for run in runs
    ]
    header = ("size", "method", "workers", "wall s", "processor s")
    report({"runs": [asdict(run) for run in runs]}, table(header, rows), given.json)


def _add_model(parser: argparse.ArgumentParser) -> None:
    bench = "of `rhytid bench --json`; two with other wrinkles tell texels and wrinkles apart"
    parser.add_argument("--bench", type=Path, nargs="+", required=True, help=bench)
    runs = "runs of `measure` that constants are taken from: one process, redraw"
    parser.add_argument("--runs", type=Path, nargs="+", required=True, help=runs)
    shared = "others used the machine meanwhile: take processor time, of devices of one core"
    parser.add_argument("--shared", action="store_true", help=shared)


def _model(given: argparse.Namespace) -> Model:
    frames = [read_frame(file) for file in given.bench]
    runs = [run for file in given.runs for run in read_runs(file)]
    return Model(Constants.of(frames, runs, shared=given.shared))


def _add_check(parser: argparse.ArgumentParser) -> None:
    _add_model(parser)
    parser.add_argument("--against", type=Path, nargs="+", required=True, help="runs to predict")
    _add_json(parser)
    parser.set_defaults(run=_check)


def _check(given: argparse.Namespace) -> None:
    model = _model(given)
    found = check(model, [run for file in given.against for run in read_runs(file)])
    figures = {"constants": asdict(model.constants), "checks": [asdict(one) for one in found]}
    report(figures, table(CHECK_HEADER, map(check_row, found)), given.json)


def _add_cost(parser: argparse.ArgumentParser) -> None:
    _add_model(parser)
    add = parser.add_argument
    add("--size", type=int, required=True, help="texels per side")
    add("--wrinkles", type=int, required=True)
    add("--method", choices=METHODS, default="redraw")
    add("--frames", type=int, required=True, help="of each head")
    add("--heads", type=int, default=1)
    add("--devices", type=int, default=1)
    add("--processes", type=int, default=1, help="that share a device")
    add("--price", type=float, default=1.0, help="of a device with its host for an hour")
    add("--store", type=float, default=float("inf"), help="bytes per second of the store")
    _add_json(parser)
    parser.set_defaults(run=_cost)


def _cost(given: argparse.Namespace) -> None:
    cost = _model(given).job(
        Head(given.size, given.wrinkles),
        given.method,
        given.frames,
        heads=given.heads,
        devices=given.devices,
        processes=given.processes,
        price=given.price,
        store=given.store,
    )
    rows = [(_COSTS[name], f"{value:.6g}") for name, value in asdict(cost).items()]
    report(asdict(cost), table(("what", "value"), rows), given.json)


def _add_placement(parser: argparse.ArgumentParser) -> None:
    for one in fields(Fleet):
        kind, usual = type(one.default), one.default
        parser.add_argument(f"--{one.name}", type=kind, default=usual, help=f"default: {usual}")
    parser.add_argument("--requests", type=int, default=200_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw it over heads held")
    _add_json(parser)
    parser.set_defaults(run=_placement)


def _placement(given: argparse.Namespace) -> None:
    fleet = Fleet(**{one.name: getattr(given, one.name) for one in fields(Fleet)})
    if given.plot is not None:
        from rhytid_lab.scaling.plot import plot, series

        plot(series(fleet, given.requests, given.seed)).savefig(given.plot)
    found = compare(fleet, given.requests, given.seed)
    figures = {"fleet": asdict(fleet), "outcomes": [asdict(one) for one in found]}
    report(figures, table(OUTCOME_HEADER, map(outcome_row, found)), given.json)


def _page(file: Path) -> None:
    file.write_text(rewritten(file.read_text(encoding="utf-8")), encoding="utf-8")


def _add_json(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", type=Path, metavar="FILE", help="figures as JSON")


if __name__ == "__main__":
    raise SystemExit(main())
