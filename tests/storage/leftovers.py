"""What programs leave on the disk that are killed."""

from __future__ import annotations

from pathlib import Path

from rhytid.support.atomic_files import UNFINISHED


def left_by_a_killed_writer(folder: Path, unique: str, *files: str) -> Path:
    """The hidden folder of a writer of these files.  unique: 32 hexadecimal digits."""
    place = folder / f".unfinished-{unique}"
    place.mkdir()
    (place / UNFINISHED.marker).write_bytes(UNFINISHED.text())
    for file in files:
        (place / file).touch()
    return place
