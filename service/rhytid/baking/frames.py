"""The frames of an animation: files that hold them, and text files that list them.

A line of a list is a file of frames, or one frame: its LABEL, its index in its file and the file,
with tabs between them. Where a list names frames, only the files of frames that are baked are
opened.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rhytid.baking.frame_names import FramePlace, frame_labels, is_file_name, own_labels
from rhytid.baking.input_files import frame_set
from rhytid.domain.wording import plural
from rhytid.errors import FrameError, InputError
from rhytid.formats.frame_set import Clip, FrameSet
from rhytid.formats.meshes import MeshFile

Frames = NDArray[np.float32]


class FrameFiles:
    """The frames of some files; of the mesh file, where no files are given.

    Frames are read when they are asked for. The last file is kept, of a geometry cache its last
    frame. Frames that are given one by one, as places, are not looked for until they are read.

    places: the frames, in order. Raises FrameError naming the file that cannot be used, or where
    there is no frame.
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
                "no frames: give a mesh file that holds frames, or files of them with --frames; "
                "skin at rest is --frames with the mesh file itself"
            )

    def _found(self, files: Sequence[Path]) -> list[FramePlace]:
        sources: list[Path | None] = [*files] or [None]
        counts, own = zip(*[self._facts(source) for source in sources], strict=True)
        labels = own_labels(sources, own) or frame_labels(sources, counts)
        where = [(f, i) for f, n in zip(sources, counts, strict=True) for i in range(n)]
        return [FramePlace(n, f, i) for n, (f, i) in zip(labels, where, strict=True)]

    def read(self, place: FramePlace) -> Frames:
        """(V, 3) float32 positions of one frame, relative to the centre of the mesh. Raises
        FrameError where the file does not hold the frame."""
        frames = self._file(place.file)
        if place.index >= len(frames):
            held = plural(len(frames), "frame")
            raise FrameError(f"frame {place.name}: index {place.index}, the file holds {held}")
        return frames.read(place.index)

    def _facts(self, file: Path | None) -> tuple[int, tuple[int, ...] | None]:
        """How many frames a file holds, and their numbers if it has any."""
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


def read_frames_list(listing: Path, folder: Path) -> list[Path] | list[FramePlace]:
    """The files that a list names, or the frames where its lines are frames.

    folder: names in the list are relative to it. Raises InputError naming the list and the line
    that cannot be used; a file of frames must exist, that of a single frame is not looked for.
    """
    try:
        text = listing.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as exc:
        raise InputError(f"{listing} is no text in UTF-8") from exc
    # Not `splitlines`: names may have what it takes for ends of lines.
    lines = {number: line for number, line in enumerate(text.split("\n"), 1) if line.strip()}
    if not lines:
        raise InputError(f"{listing} lists no frames")
    if any("\t" in line for line in lines.values()):
        return _frames(listing, folder, lines)
    files = {number: folder / line.strip() for number, line in lines.items()}
    for number, file in files.items():
        if not file.is_file():
            raise InputError(f"{listing}, line {number}: no such file: {file}")
    return [*files.values()]


def _frames(listing: Path, folder: Path, lines: Mapping[int, str]) -> list[FramePlace]:
    found: dict[str, FramePlace] = {}
    for number, line in lines.items():
        label, _, rest = line.partition("\t")
        index, _, name = rest.partition("\t")
        if not (is_file_name(label) and index.isascii() and index.isdigit() and name.strip()):
            raise InputError(
                f"{listing}, line {number}: write a frame as LABEL, its index in its file and the "
                "file, with tabs between them"
            )
        place = FramePlace(label, folder / name.strip(), int(index))
        if found.setdefault(label, place) is not place:
            raise InputError(f"{listing}, line {number}: frame {label} is listed twice")
    return [*found.values()]


def frames_list(places: Iterable[FramePlace], folder: Path) -> str:
    """The text of a list of frames. Frames of the mesh file are left out.

    folder: names in the list are relative to it. Raises InputError naming a file whose name a list
    cannot hold.
    """
    return "".join(
        f"{place.label}\t{place.index}\t{_listed(place.file, folder)}\n"
        for place in places
        if place.file is not None
    )


def _listed(file: Path, folder: Path) -> str:
    name = Path(os.path.relpath(file, folder)).as_posix()
    if name != name.strip() or set(name) & set("\t\n\r"):
        raise InputError(f"{file!r}: a list of frames cannot hold this name; rename the file")
    try:
        name.encode()
    except UnicodeEncodeError as exc:
        raise InputError(f"{file!r}: this name is no text in UTF-8; rename the file") from exc
    return name


def frame_sources(places: Sequence[FramePlace]) -> list[Path]:
    """The files of frames, each once."""
    return [*dict.fromkeys(place.file for place in places if place.file is not None)]


def check_sources(places: Sequence[FramePlace]) -> None:
    """Raise InputError naming the first frame whose file does not exist."""
    there = {file for file in frame_sources(places) if file.is_file()}
    for place in places:
        if place.file is not None and place.file not in there:
            raise InputError(f"frame {place.label}: no such file: {place.file}")
