"""Text files that list frames: `--frames-list`.

A line is a file of frames, or one frame as LABEL, its index in its file and the file, with tabs
between them. Of frames that are listed so, only the files of those that are baked are opened.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from rhytid.cli.argument_types import is_file_name
from rhytid.cli.frame_files import FramePlace
from rhytid.errors import InputError


def read_frames_list(listing: Path, folder: Path) -> list[Path] | list[FramePlace]:
    """The files of a list, or its frames where all lines are frames; names are relative to the
    folder.

    Raises InputError naming the list and the line of what cannot be used, as a file that is not
    there; files of single frames are not looked for.
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


def frames_list(places: Iterable[FramePlace], folder: Path) -> str:
    """The text of a list of frames, all of which are in files in or below the folder.

    Raises InputError naming a file whose name a list cannot hold.
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


def check_sources(places: Sequence[FramePlace]) -> None:
    """Raise InputError naming the first frame whose file is not there."""
    there = {file for file in frame_sources(places) if file.is_file()}
    for place in places:
        if place.file is not None and place.file not in there:
            raise InputError(f"frame {place.label}: no such file: {place.file}")


def frame_sources(places: Sequence[FramePlace]) -> list[Path]:
    """The files of frames, each once."""
    return [*dict.fromkeys(place.file for place in places if place.file is not None)]


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
