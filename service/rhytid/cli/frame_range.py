"""Some of the frames of an animation: `1-10,15,20-30:2`."""

from __future__ import annotations

import argparse
import hashlib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING

from rhytid.errors import InputError

if TYPE_CHECKING:
    from rhytid.cli.frame_files import FramePlace

_PART = re.compile(r"(-?\d+)(?:-(-?\d+)(?::(\d+))?)?", re.ASCII)
_LABEL = re.compile(r"-?\d+", re.ASCII)
# Numbers in one range, and characters of its text in the name of a file.
_MOST, _LONGEST = 1_000_000, 64


@dataclass(frozen=True)
class FrameRange:
    """Numbers of frames, ascending and each once."""

    numbers: tuple[int, ...]

    @classmethod
    def of(cls, numbers: Iterable[int]) -> FrameRange:
        """A range of numbers in any order."""
        return cls(tuple(sorted(set(numbers))))

    @classmethod
    def parse(cls, text: str) -> FrameRange:
        """Numbers and ranges with commas between them, as OpenJD writes them; `:2` takes every
        second. Raises argparse.ArgumentTypeError naming the part that is no range."""
        return cls.of(number for part in text.split(",") for number in _numbers(part))

    def text(self) -> str:
        """The range as `parse` reads it."""
        runs = groupby(enumerate(self.numbers), lambda at: at[1] - at[0])
        return ",".join(_run([number for _, number in run]) for _, run in runs)

    def file_text(self) -> str:
        """The range as part of the name of a file; a long one as a digest."""
        text = self.text()
        return text if len(text) <= _LONGEST else hashlib.sha256(text.encode()).hexdigest()[:16]

    def chunks(self, frames: int) -> list[FrameRange]:
        """The range in ranges of so many frames; the last may have fewer."""
        starts = range(0, len(self.numbers), frames)
        return [FrameRange(self.numbers[start : start + frames]) for start in starts]

    def select(self, places: Sequence[FramePlace]) -> list[FramePlace]:
        """The frames of these numbers, in their order; raises InputError for one that there is
        not."""
        numbered = dict(zip(frame_numbers(places), places, strict=True))
        missing = FrameRange(tuple(n for n in self.numbers if n not in numbered))
        if missing.numbers:
            there = FrameRange.of(numbered).text()
            raise InputError(f"--frame-range: no frame {missing.text()}; there are {there}")
        return [numbered[number] for number in self.numbers]


def frame_numbers(places: Sequence[FramePlace]) -> list[int]:
    """The number of each frame: its name, or its position from 1 where one of them has a name that
    is no number."""
    if all(_LABEL.fullmatch(place.label) for place in places):
        return [int(place.label) for place in places]
    return list(range(1, len(places) + 1))


def _numbers(part: str) -> range:
    match = _PART.fullmatch(part.strip())
    if match is None:
        raise argparse.ArgumentTypeError(f"{part!r}: write a range of frames as 1-10,15,20-30:2")
    first = int(match[1])
    numbers = range(first, int(match[2] or first) + 1, int(match[3] or 1) or 1)
    if not numbers or match[3] == "0":
        raise argparse.ArgumentTypeError(f"{part!r}: a range of no frames")
    if len(numbers) > _MOST:
        raise argparse.ArgumentTypeError(f"{part!r}: more than {_MOST} frames")
    return numbers


def _run(numbers: Sequence[int]) -> str:
    first, last = numbers[0], numbers[-1]
    return str(first) if first == last else f"{first}-{last}"
