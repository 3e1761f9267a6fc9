"""Output of commands: progress and notes on stderr, results on stdout or in files.

Progress is a bar on a terminal, elsewhere a line every ten seconds. For a task of a render farm the
same is printed on stdout, as the worker agents of Open Job Description read it.
"""

# ruff: noqa: T201  commands print here

from __future__ import annotations

import json
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rhytid.errors import InputError
from rhytid.support.atomic_files import atomic_write, working_folder

# In place of a file: results go to stdout.
STDOUT = Path("-")
_SHARE_FORMAT = "{desc}: {percentage:3.0f}%|{bar}| {elapsed}{postfix}"
_COUNT_FORMAT = "{desc}: {percentage:3.0f}%|{bar}| {n_fmt}/{total_fmt} [{elapsed}{postfix}]"
_STEP_FORMAT = "{desc}: {elapsed}"
# Seconds between lines where there is no terminal, and between two looks of a bar on one.
_EVERY, _LOOK = 10.0, 1.0
# Steps by which the time of the next ones is estimated.
_LAST = 9
# The share and the seconds after which a share says how long all of it takes. Before, what is done
# once weighs too much, and so does what no step of the work has told yet.
_TELLING_SHARE, _TELLING_SECONDS = 0.05, 2.0
_STEP_TABLE = ("step", "times", "total s", "mean ms")


@dataclass(frozen=True)
class Verbosity:
    """How much a command says beside its results, warnings and errors.

    for_job: whether a worker agent of Open Job Description reads the output, not a person.
    """

    quiet: bool = False
    verbose: bool = False
    for_job: bool = False


_verbosity = Verbosity()


@contextmanager
def use_verbosity(level: Verbosity) -> Iterator[None]:
    """Set the verbosity of this process within the block."""
    global _verbosity
    before, _verbosity = _verbosity, level
    try:
        yield
    finally:
        _verbosity = before


def verbosity() -> Verbosity:
    """The verbosity that is set now."""
    return _verbosity


def note(line: str) -> None:
    """Print a line on stderr, above a progress bar if there is one. Prints nothing where quiet."""
    if not _verbosity.quiet:
        print_above(line)


def print_above(line: str) -> None:
    """Print a line on stderr, above a progress bar if there is one."""
    # Imported by the first bar; another thread may be about it.
    bar = getattr(sys.modules.get("tqdm"), "tqdm", None)
    if bar is None:
        print(line, file=sys.stderr)
    else:
        bar.write(line, file=sys.stderr)


def detail(line: str) -> None:
    """Print a line on stderr where verbose."""
    if _verbosity.verbose:
        note(f"rhytid: {line}")


def openjd_line(kind: str, text: str) -> None:
    """Print a line for a worker agent of Open Job Description.  kind: `progress` (0 to 100),
    `status` or `fail`. Line breaks in the text become spaces, because a line break would end the
    message."""
    print(f"openjd_{kind}: {' '.join(text.split())}", flush=True)


@contextmanager
def share_bar(what: str) -> Iterator[Callable[[float, str], None]]:
    """Show the progress of work that knows its share. Call the result with the share, from 0 to 1,
    and the name of the stage."""
    last, pace = (0.0, ""), _Pace()

    def line(seconds: float) -> str:
        share, stage = last
        left = pace.left(seconds)
        return f"{what}: {100 * share:.0f} %{', ' if stage else ''}{stage}, {seconds:.0f} s{left}"

    def beside(seconds: float) -> str:
        return f"{last[1]}{pace.left(seconds)}".removeprefix(", ")

    with _shown(line, beside, total=1.0, desc=what, bar_format=_SHARE_FORMAT) as bar:

        def show(share: float, stage: str) -> None:
            nonlocal last
            if stage != last[1]:
                if verbosity().for_job:
                    openjd_line("status", f"{what}: {stage}")
                detail(f"{what}: {stage}, after {pace.seconds():.1f} s")
            last = share, stage
            pace.reached(share)
            bar.set_postfix_str(beside(pace.seconds()), refresh=False)
            bar.update(share - bar.n)

        yield show


def counted(
    things: Sequence[Any],
    what: str,
    unit: str,
    opening: str = "",
    worked: Callable[[], bool] = lambda: True,
) -> Iterable[Any]:
    """Yield the items, and show how many of them are done.

    what, unit: words of the line, as in "baking: frame 3 of 10".  opening: words in place of the
    number until the first item is done, where it is not the item itself that takes the time.
    worked: asked when an item is done whether there was anything to do for it. The time that is
    left is estimated from such items alone.
    """
    many, steps = len(things), _Steps(len(things))

    def line(seconds: float) -> str:
        return f"{what}: {step()}, {seconds:.0f} s{steps.left()}"

    def beside(seconds: float) -> str:
        return opening if opening and not steps.done else steps.left().removeprefix(", ")

    def step() -> str:
        if opening and not steps.done:
            return opening
        return f"{unit} {steps.done + 1} of {many}"

    with _shown(line, beside, total=many, desc=what, unit=unit, bar_format=_COUNT_FORMAT) as bar:
        bar.set_postfix_str(opening)
        for thing in things:
            if verbosity().for_job:
                openjd_line("status", f"{what}: {step()}")
            yield thing
            steps.ended(worked())
            bar.set_postfix_str(beside(0.0), refresh=False)
            bar.update()
            if verbosity().for_job:
                openjd_line("progress", f"{100 * steps.done / many:.1f}")


@contextmanager
def working(what: str) -> Iterator[None]:
    """Show how long a step takes that does not know its share."""
    detail(what)
    bar = {"desc": what, "bar_format": _STEP_FORMAT, "leave": False}
    with _shown(lambda s: f"{what}, {s:.0f} s", lambda s: "", **bar):
        yield


@contextmanager
def _shown(
    line: Callable[[float], str], beside: Callable[[float], str], **bar: Any
) -> Iterator[_Bar]:
    """A bar on a terminal; elsewhere lines. A thread refreshes either, because a step may take
    long.

    line, beside: make of the seconds since the start a line, and what stands behind a bar.
    """
    terminal, silent = sys.stderr.isatty(), verbosity().quiet or verbosity().for_job
    ended, start = threading.Event(), time.monotonic()
    with nullcontext(_Bar()) if silent or not terminal else _drawn(bar) as shown:

        def tell() -> None:
            while not ended.wait(_LOOK if terminal else _EVERY):
                seconds = time.monotonic() - start
                if terminal:
                    shown.set_postfix_str(beside(seconds))
                else:
                    said = line(seconds)
                    print(f"rhytid: {said}", file=sys.stderr, flush=True)

        teller = threading.Thread(target=tell, daemon=True)
        if not silent:
            teller.start()
        try:
            yield shown
        finally:
            ended.set()
            if teller.is_alive():
                teller.join()


class _Bar:
    """What is asked of a bar, where none is drawn."""

    n = 0.0

    def update(self, more: float = 1.0) -> None:
        """Note that so much more is done."""

    def set_postfix_str(self, text: str, refresh: bool = True) -> None:
        """Write a text behind the bar, and draw it again."""


def _drawn(bar: dict[str, Any]) -> Any:
    from tqdm import tqdm  # type: ignore[import-untyped]

    return tqdm(**bar)


class _Pace:
    """Estimates how long the rest of the work will take, from the time and the share so far; not
    before these say anything."""

    def __init__(self) -> None:
        self._start, self._all = time.monotonic(), 0.0

    def seconds(self) -> float:
        """Seconds since the start."""
        return time.monotonic() - self._start

    def reached(self, share: float) -> None:
        """Record the share that is done, from 0 to 1."""
        seconds = self.seconds()
        if share >= _TELLING_SHARE and seconds >= _TELLING_SECONDS:
            self._all = seconds / share

    def left(self, seconds: float) -> str:
        """Words for the time that is left after so many seconds; empty before there is an
        estimate."""
        return _left(self._all - seconds) if self._all else ""


class _Steps:
    """Estimates how long the rest of similar steps will take. It uses the median of the last steps
    that had anything to do: the first one includes work that is done once."""

    def __init__(self, many: int) -> None:
        self.done, self._many = 0, many
        self._last, self._start = deque[float](maxlen=_LAST), time.monotonic()

    def ended(self, worked: bool = True) -> None:
        """Record that a step is done, and that the next one begins.  worked: whether there was
        anything to do."""
        now = time.monotonic()
        if worked:
            self._last.append(now - self._start)
        self.done, self._start = self.done + 1, now

    def left(self) -> str:
        """Words for the time that is left now; empty before a step took time."""
        if not self._last:
            return ""
        from statistics import median  # which a command without steps need not import

        usual, after = median(self._last), self._many - self.done - 1
        here = max(usual - (time.monotonic() - self._start), 0.0)
        return _left(here + after * usual)


def _left(left: float) -> str:
    """Words for these seconds; none once the estimate has run out, for then it was wrong."""
    if left < 0.5:
        return ""
    return f", {left:.0f} s left" if left < 100 else f", {left / 60:.0f} min left"


def report(figures: Any, text: str, destination: Path | None) -> None:
    """Print `text`, and write `figures` as JSON to the destination, if there is one. With STDOUT as
    the destination the JSON is printed in place of the text."""
    if destination != STDOUT:
        print(text)
    if destination is not None:
        write_json(figures, destination)


def write_json(figures: Any, destination: Path) -> None:
    """Write figures as JSON to a file, whose folder is made where needed, or to stdout."""
    content = json.dumps(figures, indent=2)
    if destination == STDOUT:
        print(content)
    else:
        destination.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(destination) as aside:
            aside.write_text(f"{content}\n", encoding="utf-8")


def table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Text in columns. Columns of numbers are aligned right, the first one and columns with text
    left. Cells may be empty."""
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


def _is_number(cell: str) -> bool:
    mantissa, _, exponent = cell.partition("e")
    digits = mantissa.replace(".", "").replace(",", "").lstrip("-") + exponent.lstrip("+-")
    return not cell or digits.isdigit()


def check_suffix(file: Path, suffix: str, what: str) -> None:
    """Raise InputError where the name of a file that will be written ends otherwise.

    what: words for what it holds, as in "the picture".
    """
    if file.suffix.lower() != suffix:
        raise InputError(f"{file}: {what} is written as {suffix}")


def make_place(file: Path | None) -> None:
    """Make the folder of a file that will be written, and check that the file can be. Does nothing
    for STDOUT or None. Raises InputError naming the file."""
    if file in (None, STDOUT):
        return
    assert file is not None
    if file.is_dir():
        raise InputError(f"{file} is a folder, not a file")
    if file.exists() and not file.is_file():  # the file would take its place
        raise InputError(f"{file} is a device or a pipe, not a plain file")
    _make(file.parent, file)


def make_folder(folder: Path) -> None:
    """Make a folder, and check that files can be written to it. Raises InputError naming it."""
    _make(folder, folder)


def _make(folder: Path, written: Path) -> None:
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{written} cannot be written: {folder} is a file, not a folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with working_folder(folder):
            pass
    except OSError as error:
        raise InputError(f"{written} cannot be written: {error.strerror}") from error


@dataclass
class Stopwatch:
    """Seconds of each call of a step, by the name of the step, in the order of first use."""

    seconds: dict[str, list[float]] = field(default_factory=dict)

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        """Time the block as one call of a step. A block that raises is not counted."""
        start = time.perf_counter()
        yield
        self.add(name, time.perf_counter() - start)

    def add(self, name: str, seconds: float) -> None:
        """Add one call of a step."""
        self.seconds.setdefault(name, []).append(seconds)

    def figures(self) -> dict[str, dict[str, float]]:
        """Calls and total seconds of each step, for JSON."""
        return {
            name: {"calls": len(spent), "seconds": round(sum(spent), 6)}
            for name, spent in self.seconds.items()
        }

    def table(self) -> str:
        """The same as text in columns."""
        rows = [
            (name, len(spent), f"{sum(spent):.2f}", f"{1000 * sum(spent) / len(spent):.0f}")
            for name, spent in self.seconds.items()
        ]
        return table(_STEP_TABLE, rows)
