"""How much commands say beside their results, warnings and errors, and the lines of it."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from tqdm import tqdm  # type: ignore[import-untyped]


@dataclass(frozen=True)
class Voice:
    """How much a command says beside its results, warnings and errors.

    for_job: whether progress goes to a worker agent of Open Job Description, not to a person.
    """

    quiet: bool = False
    verbose: bool = False
    for_job: bool = False


_voice = Voice()


@contextmanager
def speaking(voice: Voice) -> Iterator[None]:
    """Within the block, commands say so much."""
    global _voice
    before, _voice = _voice, voice
    try:
        yield
    finally:
        _voice = before


def voice() -> Voice:
    """How much to say now."""
    return _voice


def note(line: str) -> None:
    """Print a line on stderr, above a bar that is being drawn; nothing where quiet."""
    if not _voice.quiet:
        tqdm.write(line, file=sys.stderr)


def detail(line: str) -> None:
    """Print a line on stderr where verbose."""
    if _voice.verbose:
        note(f"rhytid: {line}")


def job_line(kind: str, text: str) -> None:
    """Tell a worker agent of Open Job Description something: `progress` (0 to 100), `status` or
    `fail`. A line break in the text would end it."""
    print(f"openjd_{kind}: {' '.join(text.split())}", flush=True)
