"""What a command reports: progress on stderr, tables and figures on stdout or in a file."""

from __future__ import annotations

import json
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tqdm import tqdm  # type: ignore[import-untyped]

from rhytid.cli.options import STDOUT

_SHARE_FORMAT = "{desc}: {percentage:3.0f}%|{bar}| {elapsed}{postfix}"
# A bar shows on a terminal alone: None is tqdm's word for that.
_ON_TERMINAL = None
# Seconds between lines where there is no terminal.
_EVERY = 10.0


@contextmanager
def share_bar(what: str) -> Iterator[Callable[[float, str], None]]:
    """A bar for work that knows its share from 0 to 1: call with the share and the stage."""
    last = (0.0, "")

    def line() -> str:
        share, stage = last
        return f"{what}: {100 * share:.0f} %{', ' if stage else ''}{stage}"

    with (
        _lines(line),
        tqdm(total=1.0, desc=what, bar_format=_SHARE_FORMAT, disable=_ON_TERMINAL) as bar,
    ):

        def show(share: float, stage: str) -> None:
            nonlocal last
            last = share, stage
            bar.set_postfix_str(stage, refresh=False)
            bar.update(share - bar.n)

        yield show


def counted(things: Sequence[Any], what: str, unit: str) -> Iterable[Any]:
    """The things themselves, with a bar that counts them."""
    done = 0
    with _lines(lambda: f"{what}: {unit} {done + 1} of {len(things)}"):
        for thing in tqdm(things, desc=what, unit=unit, disable=_ON_TERMINAL):
            yield thing
            done += 1


@contextmanager
def _lines(line: Callable[[], str]) -> Iterator[None]:
    """While the block runs and stderr is no terminal, a line there every ten seconds, by a thread
    of its own: a step may take longer than that."""
    if sys.stderr.isatty():
        yield
        return
    ended, start = threading.Event(), time.monotonic()

    def tell() -> None:
        while not ended.wait(_EVERY):
            seconds = time.monotonic() - start
            print(f"rhytid: {line()}, {seconds:.0f} s", file=sys.stderr, flush=True)

    teller = threading.Thread(target=tell, daemon=True)
    teller.start()
    try:
        yield
    finally:
        ended.set()
        teller.join()


def table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Text in columns: the first is left-aligned, as is one with text; a cell may be empty."""
    cells = [[str(cell) for cell in row] for row in rows]
    columns = list(zip(header, *cells, strict=True))
    widths = [max(map(len, column)) for column in columns]
    left = [
        i == 0 or not all(_is_number(c) for c in column[1:]) for i, column in enumerate(columns)
    ]
    lines = [
        "  ".join(
            cell.ljust(width) if is_left else cell.rjust(width)
            for cell, width, is_left in zip(row, widths, left, strict=True)
        ).rstrip()
        for row in (header, ["-" * w for w in widths], *cells)
    ]
    return "\n".join(lines)


def report(figures: Any, text: str, destination: Path | None) -> None:
    """Print `text`; with a destination also write `figures` as JSON there, on stdout instead."""
    if destination != STDOUT:
        print(text)
    if destination is not None:
        write_json(figures, destination)


def write_json(figures: Any, destination: Path) -> None:
    """Write figures as JSON to a file, whose folder is made, or to stdout."""
    content = json.dumps(figures, indent=2)
    if destination == STDOUT:
        print(content)
    else:
        destination.parent.mkdir(parents=True, exist_ok=True)
        destination.write_text(f"{content}\n", encoding="utf-8")


def _is_number(cell: str) -> bool:
    mantissa, _, exponent = cell.partition("e")
    digits = mantissa.replace(".", "").replace(",", "").lstrip("-") + exponent.lstrip("+-")
    return not cell or digits.isdigit()
