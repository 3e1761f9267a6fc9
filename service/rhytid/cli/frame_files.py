"""The frames of an animation: which files hold them and which numbers they get."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rhytid.cli.input_files import frame_file
from rhytid.errors import FrameError
from rhytid.formats.meshes import MeshFile

Frames = NDArray[np.float32]
_NUMBER = re.compile(r"[0-9]+$", re.ASCII)


@dataclass(frozen=True)
class FramePlace:
    """Where a frame lies: the `index`-th of a file, None for the file of the mesh."""

    number: int
    file: Path | None
    index: int

    @property
    def label(self) -> str:
        """The number as files carry it: at least four digits."""
        return f"{self.number:04d}"

    @property
    def name(self) -> str:
        """The number, and the file that the frame lies in."""
        return self.label if self.file is None else f"{self.label} of {self.file.name}"


class FrameFiles:
    """The frames of some files, or of the mesh file where no files are given.

    Frames are read when they are asked for; one file is kept in memory. Raises FrameError naming
    the file that cannot be used, or where there is no frame at all.
    """

    def __init__(self, mesh: MeshFile, files: Sequence[Path]) -> None:
        self._vertices, self._centre = len(mesh.mesh.positions), mesh.mesh.centre
        self._kept: tuple[Path | None, Frames | None] = (None, mesh.frames)
        sources: list[Path | None] = [*files] or [None]
        counts = [self._count(source) for source in sources]
        numbers = frame_numbers(sources, counts)
        where = [(f, i) for f, n in zip(sources, counts, strict=True) for i in range(n)]
        self.places = [FramePlace(n, f, i) for n, (f, i) in zip(numbers, where, strict=True)]
        if not self.places:
            raise FrameError("no frames: name files of frames, or a .npz mesh that holds frames")

    def read(self, place: FramePlace) -> Frames:
        """(V, 3) float32 positions of one frame, less the centre of its mesh."""
        frame: Frames = self._file(place.file)[place.index]
        return frame

    def _count(self, file: Path | None) -> int:
        if file is None:
            return 0 if self._kept[1] is None else len(self._kept[1])
        # An OBJ is one frame, however long it takes to read.
        return 1 if file.suffix.lower() == ".obj" else len(self._file(file))

    def _file(self, file: Path | None) -> Frames:
        kept, frames = self._kept
        if frames is None or kept != file:
            assert file is not None
            frames = frame_file(file, self._vertices, self._centre)
            self._kept = (file, frames)
        return frames


def frame_numbers(files: Sequence[Path | None], counts: Sequence[int]) -> list[int]:
    """A number for every frame of files that hold `counts` frames each.

    The digits at the end of the files' names, where every file is one frame and has them; else
    1, 2, 3, … Raises FrameError where two files have the same number.
    """
    found = [_NUMBER.search(file.stem) if file else None for file in files]
    if not all(found) or any(count != 1 for count in counts):
        return list(range(1, sum(counts) + 1))
    numbers = [int(match[0]) for match in found if match]
    first: dict[int, Path | None] = {}
    for number, file in zip(numbers, files, strict=True):
        if first.setdefault(number, file) is not file:
            raise FrameError(f"{first[number]} and {file} are both frame {number}")
    return numbers
