"""What a command reports: tables and figures, on stdout or in a file."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from rhytid.cli.options import STDOUT
from rhytid.support.atomic_files import atomic_write


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
        with atomic_write(destination) as aside:
            aside.write_text(f"{content}\n", encoding="utf-8")


def _is_number(cell: str) -> bool:
    mantissa, _, exponent = cell.partition("e")
    digits = mantissa.replace(".", "").replace(",", "").lstrip("-") + exponent.lstrip("+-")
    return not cell or digits.isdigit()
