"""Frames of an animation by their names and numbers: `1-10,15,20-30:2`."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from rhytid.domain.frame import NEUTRAL, counted_frame, frame_label
from rhytid.errors import FrameError, InputError

_FILE_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}", re.ASCII)
_NUMBER = re.compile(r"[0-9]+$", re.ASCII)
_PART = re.compile(r"(-?\d+)(?:-(-?\d+)(?::(\d+))?)?", re.ASCII)
_LABEL = re.compile(r"-?\d+", re.ASCII)
_DIGEST = re.compile(r"h[0-9a-f]{16}")
# Numbers in one range, and characters of its text in the name of a file.
_MOST, _LONGEST = 1_000_000, 64


@dataclass(frozen=True)
class FramePlace:
    """The name of a frame, and its place: the `index`-th of a file, None for the file of the
    mesh."""

    label: str
    file: Path | None
    index: int

    @property
    def name(self) -> str:
        """Its label, and the file that holds the frame."""
        return self.label if self.file is None else f"{self.label} of {self.file.name}"


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
        second. Raises InputError naming the part that is no range."""
        return cls.of(number for part in text.split(",") for number in _numbers(part))

    def text(self) -> str:
        """The range as `parse` reads it."""
        return ",".join(map(_run, _runs(self.numbers)))

    def file_text(self) -> str:
        """The range as part of the name of a file; a long one as a digest."""
        text = self.text().replace(":", "x")  # which names of files may have everywhere
        return text if len(text) <= _LONGEST else f"h{_hash(text)}"

    @classmethod
    def of_file_text(cls, text: str) -> FrameRange | None:
        """The inverse of `file_text`; None of a digest."""
        if _DIGEST.fullmatch(text):
            return None
        try:
            return cls.parse(text.replace("x", ":"))
        except InputError:
            return None

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


def own_labels(
    files: Sequence[Path | None], numbers: Sequence[tuple[int, ...] | None]
) -> list[str] | None:
    """The frame numbers that the files themselves give; None where one gives none.

    Raises FrameError where two files have frames of one number.
    """
    seen: dict[int, Path | None] = {}
    for file, own in zip(files, numbers, strict=True):
        if own is None:
            return None
        for number in own:
            if seen.setdefault(number, file) is not file:
                raise FrameError(f"{seen[number]} and {file} both hold frame {number}")
    return [frame_label(number) for number in seen]


def frame_labels(files: Sequence[Path | None], counts: Sequence[int]) -> list[str]:
    """A name for every frame of files that hold `counts` frames each.

    Where every file holds one frame: the digits at the end of the files' names, or, where not all
    have them, the names. Else, and where names are the same or cannot serve, 0001, 0002, …
    Raises FrameError where two files have the same number.
    """
    if not all(file is not None and count == 1 for file, count in zip(files, counts, strict=True)):
        return _counted(sum(counts))
    stems = [file.stem for file in files if file]
    found = [_NUMBER.search(stem) for stem in stems]
    numbers = [int(match[0]) for match in found if match]
    if len(numbers) == len(files):
        return _numbered(files, numbers)
    usable = all(is_file_name(stem) and stem != NEUTRAL for stem in stems)
    return stems if usable and len(set(stems)) == len(stems) else _counted(len(files))


def is_file_name(text: str) -> bool:
    """Whether a text may be a part of the names of written files, which dots divide."""
    return _FILE_NAME.fullmatch(text) is not None


def check_file_name(text: str) -> str:
    """The text; raises InputError where it cannot be a part of the names of written files."""
    if not is_file_name(text):
        rule = "a letter or digit, then up to 63 letters, digits, '_' or '-'"
        raise InputError(f"{text!r}: use {rule}")
    return text


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _numbers(part: str) -> range:
    match = _PART.fullmatch(part.strip())
    if match is None:
        raise InputError(f"{part!r}: write a range of frames as 1-10,15,20-30:2")
    first = int(match[1])
    numbers = range(first, int(match[2] or first) + 1, int(match[3] or 1) or 1)
    if not numbers or match[3] == "0":
        raise InputError(f"{part!r}: a range of no frames")
    if len(numbers) > _MOST:
        raise InputError(f"{part!r}: more than {_MOST} frames")
    return numbers


def _runs(numbers: Sequence[int]) -> Iterator[Sequence[int]]:
    """Numbers in even steps, as many as there are of each; two are a run in steps of 1 alone."""
    start = 0
    while start < len(numbers):
        rest = numbers[start : start + 2]
        step, end = rest[-1] - rest[0], start + len(rest)
        while end < len(numbers) and numbers[end] - numbers[end - 1] == step:
            end += 1
        if end - start == 2 and step > 1:
            end -= 1
        yield numbers[start:end]
        start = end


def _run(numbers: Sequence[int]) -> str:
    if len(numbers) == 1:
        return str(numbers[0])
    step = numbers[1] - numbers[0]
    return f"{numbers[0]}-{numbers[-1]}{f':{step}' if step > 1 else ''}"


def _counted(frames: int) -> list[str]:
    return [counted_frame(index) for index in range(frames)]


def _numbered(files: Sequence[Path | None], numbers: Sequence[int]) -> list[str]:
    first: dict[int, Path | None] = {}
    for number, file in zip(numbers, files, strict=True):
        if first.setdefault(number, file) is not file:
            raise FrameError(f"{first[number]} and {file} are both frame {number}")
    return [frame_label(number) for number in numbers]
