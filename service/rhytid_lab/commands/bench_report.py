"""What `rhytid bench` prints: its tables, and what has ended where a bench is cancelled."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rhytid.errors import RhytidError
from rhytid.support.console import note, report, table, write_json

if TYPE_CHECKING:
    from rhytid_lab.bench.bake import BakeCost
    from rhytid_lab.bench.comparison import Results
    from rhytid_lab.bench.scaling import Growth
    from rhytid_lab.bench.service import FirstTile, Latency

_SERVICE = ("method", "clients", "p50 ms", "p99 ms", "tiles/s", "kernel ms", "not kernel")
_BAKE = (
    "method", "files", "UDIMs", "kernels s (processor)", "drawn", "written", "bake", "ratio",
    "work",
)  # fmt: skip
_CASES = ("case", "implementation", "seconds", "map copies", "max difference", "note")
_SCALING = ("series", "x", "case", "seconds", "map copies")


@contextmanager
def reported(
    destination: Path | None,
    figures: Callable[[], dict[str, Any]],
    text: Callable[[], str],
    also: Path | None = None,
) -> Iterator[None]:
    """Report what a bench has found when the block ends, also where it is cancelled or fails: then
    the cases that have ended, if there are any, and the figures say so by `cancelled`.

    destination, figures, text: as of `report`; `figures` has its cases as `results`.  also: another
    file for the figures.
    """
    try:
        yield
    except BaseException:
        if figures()["results"]:
            _report({**figures(), "cancelled": True}, text(), destination, also)
            note("rhytid bench: notice: it did not end: cases are missing above")
        raise
    _report(figures(), text(), destination, also)


def _report(figures: Any, text: str, destination: Path | None, also: Path | None) -> None:
    if also is not None:
        write_json(figures, also)
    report(figures, text, destination)
    sys.stdout.flush()


def scaling_table(found: Sequence[Growth]) -> str:
    """What `--scaling` found."""
    rows = [(g.series, str(g.x), g.case, f"{g.seconds:.4f}", _copies(g.map_copies)) for g in found]
    return table(_SCALING, rows)


def _copies(map_copies: float | None) -> str:
    return "" if map_copies is None else f"{map_copies:.1f}"


def bake_table(costs: Sequence[BakeCost]) -> str:
    """What `--bake` found."""
    return table(_BAKE, map(_bake_row, costs))


def _bake_row(cost: BakeCost) -> tuple[str, ...]:
    parts = (cost.kernels, cost.drawn, cost.files, cost.bake)
    spent = [f"{part.seconds:.3f} ({part.processor:.3f})" for part in parts]
    ratios = f"{cost.ratio:.2f}", f"{cost.work:.2f}"
    return cost.method, cost.written, str(cost.udims), *spent, *ratios


def service_table(first: FirstTile, rows: Sequence[Latency]) -> str:
    """What `--service` found."""
    milliseconds = (
        f"{1000 * first.seconds:.1f} ms, its kernels {1000 * first.kernel_seconds:.1f} ms"
    )
    line = f"frame in, first tile out: {milliseconds}: {first.ratio:.1f} times"
    return f"{line}\n{table(_SERVICE, map(_latency_row, rows))}"


def _latency_row(row: Latency) -> tuple[str, ...]:
    seconds = (row.p50_seconds, row.p99_seconds, row.kernel_seconds)
    p50, p99, kernel = (f"{1000 * s:.1f}" for s in seconds)
    rate, share = f"{row.tiles_per_second:.0f}", f"{row.not_kernel:.2f}"
    return row.method, str(row.clients), p50, p99, rate, kernel, share


def case_table(results: Results, cases: Sequence[str]) -> str:
    """What was found of a frame.  cases: all, in their order."""
    timed = [
        (e.case, e.implementation, f"{e.seconds:.4f}", f"{e.map_copies:.1f}",
         f"{e.max_difference:.1e}" if e.max_difference else "0", "")
        for e in results.timings
    ]  # fmt: skip
    left = [(e.case, e.implementation, "", "", "", e.reason) for e in results.untimed]
    copy = ("copy", "rhytid", f"{results.copy_seconds:.4f}", "1.0", "", "")
    rows = sorted([*timed, *left], key=lambda row: cases.index(row[0]))
    return table(_CASES, [copy, *rows])


def print_untimed(results: Results) -> None:
    """Print on stderr which implementations were not timed, where no table shows them."""
    for left in results.untimed:
        print(f"{left.case}: {left.implementation}: {left.reason}", file=sys.stderr)


def refuse_wrong(results: Results) -> None:
    """Raise RhytidError where a result was wrong."""
    off = [f"{left.implementation} in {left.case}" for left in results.untimed if left.off]
    if off:
        raise RhytidError(f"the results differ from rhytid's: {', '.join(off)}")
