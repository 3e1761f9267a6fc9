"""The tables of docs/scaling.md, made from the figures beside this module."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from rhytid.errors import InputError
from rhytid_lab.scaling import examples
from rhytid_lab.scaling.capacity import Shared
from rhytid_lab.scaling.check import check
from rhytid_lab.scaling.fleet import Outcome
from rhytid_lab.scaling.tables import CHECK_HEADER, OUTCOME_HEADER, check_row, outcome_row

_PLACE = re.compile(r"(<!-- table: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)
_PLACEMENT = Path(__file__).parent / "measured" / "placement.json"
_DAY = 86400.0
# What the film is computed for: device, method, processes that share a device.
_FILMS = (("redraw", 1), ("redraw", 16), ("binned", 1), ("binned", 16))


def rewritten(text: str) -> str:
    """The page with every table between `<!-- table: NAME -->` and `<!-- end -->` made anew; raises
    InputError for an unknown name, and where there is none."""
    if not _PLACE.search(text):
        raise InputError("the page has no place for a table")
    return _PLACE.sub(lambda found: found[1] + _table(found[2]) + found[3], text)


def outcomes() -> list[Outcome]:
    """The simulation as it was run with the defaults of `placement`."""
    rows = json.loads(_PLACEMENT.read_bytes())["outcomes"]
    return [Outcome(**row) for row in rows]


def _table(name: str) -> str:
    if name not in _TABLES:
        raise InputError(f"no table {name!r}: one of {', '.join(_TABLES)}")
    return _TABLES[name]()


def _markdown(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _constants() -> str:
    known = examples.one_core().constants
    nano = 1e9
    rows = [
        ("`redraw`, a texel", f"{known.redraw[0] * nano:.1f} ns"),
        ("`redraw`, a wrinkle", f"{known.redraw[1] * nano:.0f} ns"),
        ("`precompute`, a texel", f"{known.precompute[0] * nano:.0f} ns"),
        ("`precompute`, a wrinkle", f"{known.precompute[1] * nano:.0f} ns"),
        ("`binned`, a texel", f"{known.binned * nano:.1f} ns"),
        ("put: a frame", f"{1000 * known.put:.0f} ms"),
        ("beyond: a frame, in pieces and read back", f"{1000 * known.beyond:.0f} ms"),
        ("write: a texel of `float`", f"{known.write * nano:.0f} ns"),
        ("start: a process", f"{known.start[0]:.1f} s"),
        ("a texel in a file", f"{known.file_bytes:.2f} bytes"),
        ("a wrinkle in the store", f"{known.asset_bytes:.0f} bytes"),
    ]
    return _markdown(("constant", "value"), rows)


def _checks() -> str:
    found = check(examples.one_core(), examples.measured_runs())
    return _markdown(CHECK_HEADER, map(check_row, found))


def _errors() -> str:
    """A sentence, without the run that constants are taken from."""
    found = check(examples.one_core(), examples.measured_runs())[1:]
    ranges = [
        f"{min(errors):+d} to {max(errors):+d} %"
        for errors in (
            [round(100 * one.error) for one in found],
            [round(100 * one.wall_error) for one in found],
        )
    ]
    return f"The others: {ranges[0]} off processor time, {ranges[1]} off the clock.\n"


def _film_frame() -> str:
    rows = []
    for model in (examples.one_core(), examples.paper_device()):
        for method in ("redraw", "binned"):
            known, head = model.constants, examples.FILM
            host = model.host(head)
            whole = model.frame(head, method)
            film = examples.film_cost(model, method, 1, 1).nbytes
            rows.append(
                (known.device, method, f"{model.draw(head, method):.2f}", f"{host:.1f}",
                 f"{whole:.1f}", f"{model.file_bytes(head) / 1e9:.2f}", f"{film / 1e12:,.0f}")
            )  # fmt: skip
    header = ("device", "method", "drawing s", "host s", "frame s", "file GB", "film TB")
    return _markdown(header, rows)


def _film_jobs() -> str:
    rows = []
    model = examples.paper_device()
    for method, processes in _FILMS:
        for devices in (1, *examples.DEVICES):
            cost = examples.film_cost(model, method, devices, processes)
            row = (method, str(processes), f"{devices:,}", f"{cost.seconds / _DAY:,.1f}")
            rows.append((*row, f"{cost.device_seconds / 3600:,.0f}", f"{cost.frame_money:.2g}"))
    header = ("method", "processes", "devices", "days", "device hours", "money a frame")
    return _markdown(header, rows)


def _film_limits() -> str:
    model = examples.paper_device()
    return _limits(
        [
            (f"{method}, {processes}", examples.film_shared(model, method, processes))
            for method, processes in _FILMS
        ]
    )


def _film_breaks() -> str:
    model = examples.paper_device()
    return _breaks(
        [
            (f"{method}, {processes}", examples.film_shared(model, method, processes))
            for method, processes in _FILMS
        ]
    )


def _studio() -> list[tuple[str, list[Shared]]]:
    best = next(one for one in outcomes() if "replicated" in one.policy)
    return [("replicated", examples.studio_shared(1.0 - best.hits))]


def _limits(cases: Iterable[tuple[str, Sequence[Shared]]]) -> str:
    rows = [
        (case, one.name, f"{one.per_device:.3g} {one.unit}", f"{one.capacity:.3g} {one.unit}",
         f"{one.full_at:,.3g}" if one.full_at < 1000 else f"{one.full_at:,.0f}")
        for case, shared in cases
        for one in shared
    ]  # fmt: skip
    header = ("case", "what is shared", "a device asks", "there is", "full at devices")
    return _markdown(header, rows)


def _breaks(cases: Iterable[tuple[str, Sequence[Shared]]]) -> str:
    rows = [(case, *examples.breaking(shared)) for case, shared in cases]
    return _markdown(("case", *(f"{devices:,}" for devices in examples.DEVICES)), rows)


_TABLES: dict[str, Callable[[], str]] = {
    "constants": _constants,
    "checks": _checks,
    "errors": _errors,
    "film_frame": _film_frame,
    "film_jobs": _film_jobs,
    "film_limits": _film_limits,
    "film_breaks": _film_breaks,
    "studio_limits": lambda: _limits(_studio()),
    "studio_breaks": lambda: _breaks(_studio()),
    "placement": lambda: _markdown(OUTCOME_HEADER, map(outcome_row, outcomes())),
}
