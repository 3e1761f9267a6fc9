"""The frames of an animation: which files hold them and which names they get."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rhytid.cli.argument_types import is_file_name
from rhytid.cli.input_files import frame_set
from rhytid.domain.frame import NEUTRAL, counted_frame, frame_label
from rhytid.domain.wording import plural
from rhytid.errors import FrameError
from rhytid.formats.frame_set import Clip, FrameSet
from rhytid.formats.meshes import MeshFile

Frames = NDArray[np.float32]
_NUMBER = re.compile(r"[0-9]+$", re.ASCII)


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


class FrameFiles:
    """The frames of some files, or of the mesh file where no files are given; or those that are
    listed one by one, whose files are then not looked into before they are read.

    Frames are read when they are asked for; one file is kept, of a geometry cache one frame. Raises
    FrameError naming the file that cannot be used, or where there is no frame at all.
    """

    def __init__(
        self,
        mesh: MeshFile,
        files: Sequence[Path] | Sequence[FramePlace],
        clip: Clip | None = None,
    ) -> None:
        self._vertices, self._centre = len(mesh.mesh.positions), mesh.mesh.centre
        self._clip = clip
        nothing = FrameSet.of(np.empty((0, self._vertices, 3), np.float32))
        own_frames = None if files else mesh.frame_set
        self._kept: tuple[Path | None, FrameSet] = (None, own_frames or nothing)
        listed = [place for place in files if isinstance(place, FramePlace)]
        self.places = listed or self._found([file for file in files if isinstance(file, Path)])
        if not self.places:
            raise FrameError(
                "no frames: name files of frames, the neutral's own for skin at rest, or a mesh "
                "file that holds frames"
            )

    def _found(self, files: Sequence[Path]) -> list[FramePlace]:
        sources: list[Path | None] = [*files] or [None]
        counts, own = zip(*[self._facts(source) for source in sources], strict=True)
        labels = own_labels(sources, own) or frame_labels(sources, counts)
        where = [(f, i) for f, n in zip(sources, counts, strict=True) for i in range(n)]
        return [FramePlace(n, f, i) for n, (f, i) in zip(labels, where, strict=True)]

    def read(self, place: FramePlace) -> Frames:
        """(V, 3) float32 positions of one frame, less the centre of its mesh; raises FrameError
        where its file holds fewer."""
        frames = self._file(place.file)
        if place.index >= len(frames):
            held = plural(len(frames), "frame")
            raise FrameError(f"frame {place.name}: index {place.index}, the file holds {held}")
        return frames.read(place.index)

    def _facts(self, file: Path | None) -> tuple[int, tuple[int, ...] | None]:
        """How many frames a file holds, and the numbers that it gives them."""
        # An OBJ is one frame, however long it takes to read.
        if file is not None and file.suffix.lower() == ".obj":
            return 1, None
        frames = self._file(file)
        return len(frames), frames.numbers

    def _file(self, file: Path | None) -> FrameSet:
        kept, frames = self._kept
        if file is not None and kept != file:
            frames = frame_set(file, self._vertices, self._centre, self._clip)
            self._kept = (file, frames)
        return frames


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


def _counted(frames: int) -> list[str]:
    return [counted_frame(index) for index in range(frames)]


def _numbered(files: Sequence[Path | None], numbers: Sequence[int]) -> list[str]:
    first: dict[int, Path | None] = {}
    for number, file in zip(numbers, files, strict=True):
        if first.setdefault(number, file) is not file:
            raise FrameError(f"{first[number]} and {file} are both frame {number}")
    return [frame_label(number) for number in numbers]
