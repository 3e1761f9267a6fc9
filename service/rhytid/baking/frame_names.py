"""Names and numbers of the frames of an animation, and ranges of them: `1-10,15,20-30:2`."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from rhytid.domain.frame import NEUTRAL, counted_frame, frame_label
from rhytid.errors import FrameError, InputError

# In the name of a map: that of every UDIM which is there.
ANY_UDIM = "<UDIM>"
_FILE_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}", re.ASCII)
_NUMBER = re.compile(r"[0-9]+$", re.ASCII)
_PART = re.compile(r"(-?\d+)(?:-(-?\d+)(?::(\d+))?)?", re.ASCII)
_LABEL = re.compile(r"-?\d+", re.ASCII)
_DIGEST = re.compile(r"h[0-9a-f]{16}")
# Numbers in one range, and characters of its text in the name of a file.
_MOST, _LONGEST = 1_000_000, 64


@dataclass(frozen=True)
class FramePlace:
    """A frame and where it is stored.

    label: its name in names of files.  file: None for the file of the mesh.  index: its position in
    the file, from 0.
    """

    label: str
    file: Path | None
    index: int

    @property
    def name(self) -> str:
        """The label, and the file if there is one."""
        return self.label if self.file is None else f"{self.label} of {self.file.name}"


@dataclass(frozen=True)
class FrameRange:
    """A set of frame numbers, in ascending order."""

    numbers: tuple[int, ...]

    @classmethod
    def of(cls, numbers: Iterable[int]) -> FrameRange:
        """The range of numbers in any order."""
        return cls(tuple(sorted(set(numbers))))

    @classmethod
    def parse(cls, text: str) -> FrameRange:
        """Read numbers and ranges with commas between them, as OpenJD writes them; `1-9:2` takes
        every second. Raises InputError naming the part that is no range."""
        return cls.of(number for part in text.split(",") for number in _numbers(part))

    def text(self) -> str:
        """The range as `parse` reads it."""
        return ",".join(map(_run, _runs(self.numbers)))

    def file_text(self) -> str:
        """The range as part of the name of a file. A long one becomes a digest."""
        text = self.text().replace(":", "x")  # which names of files may have everywhere
        return text if len(text) <= _LONGEST else f"h{_hash(text)}"

    @classmethod
    def of_file_text(cls, text: str) -> FrameRange | None:
        """The inverse of `file_text`; None for a digest."""
        if _DIGEST.fullmatch(text):
            return None
        try:
            return cls.parse(text.replace("x", ":"))
        except InputError:
            return None

    def chunks(self, frames: int) -> list[FrameRange]:
        """Split the range into ranges of `frames` numbers; the last one may have fewer."""
        starts = range(0, len(self.numbers), frames)
        return [FrameRange(self.numbers[start : start + frames]) for start in starts]

    def select(self, places: Sequence[FramePlace]) -> list[FramePlace]:
        """The frames of these numbers, in ascending order. Raises InputError naming numbers that no
        frame has."""
        numbered = dict(zip(frame_numbers(places), places, strict=True))
        missing = FrameRange(tuple(n for n in self.numbers if n not in numbered))
        if missing.numbers:
            there = FrameRange.of(numbered).text()
            raise InputError(f"--frame-range: no frame {missing.text()}; there are {there}")
        return [numbered[number] for number in self.numbers]


def frame_numbers(places: Sequence[FramePlace]) -> list[int]:
    """The number of each frame: its label, or, where not all labels are numbers, its position from
    1."""
    if all(_LABEL.fullmatch(place.label) for place in places):
        return [int(place.label) for place in places]
    return list(range(1, len(places) + 1))


def own_labels(
    files: Sequence[Path | None], numbers: Sequence[tuple[int, ...] | None]
) -> list[str] | None:
    """Labels of frames whose files number them; None where a file does not.

    files, numbers: each file, and the numbers of its frames. Raises FrameError where two files have
    a frame of the same number.
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
    """Labels of frames whose files do not number them.

    files, counts: each file, and how many frames it holds. Where every file holds one frame, its
    label is the number at the end of the name of the file; where not all names have one, the name
    itself. In all other cases, and where names are equal or cannot be labels, frames are counted
    from 0001. Raises FrameError where two files have the same number.
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
    """Whether a text may be a part of the names of written files, whose parts are divided by
    dots."""
    return _FILE_NAME.fullmatch(text) is not None


def check_file_name(text: str) -> str:
    """Return the text. Raises InputError where it cannot be a part of the names of written
    files."""
    if not is_file_name(text):
        rule = "an ASCII letter or digit, then up to 63 of these, '_' or '-'"
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
    """Split numbers into runs of even steps. Two numbers are a run only where the step is 1."""
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
