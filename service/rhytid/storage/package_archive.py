"""A skin package as one file: a zip whose files are stored as they are, one after the other.

Who reads a file of the package reads a part of the archive: one open file is enough for all of
them, and it stays whole when the archive is removed meanwhile.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import BinaryIO
from zipfile import ZIP_STORED, BadZipFile, ZipFile, ZipInfo

from rhytid.storage.canonical import damaged
from rhytid.support import cancellation

# Of a file's local header: its bytes, the place of the lengths of name and further fields in it.
_HEADER, _LENGTHS = 30, struct.Struct("<26xHH")
# Files of up to so many bytes are compared with their checksums when an archive is read.
CHECKED = 1 << 18


def write_archive(folder: Path, archive: Path, between: Callable[[], None]) -> None:
    """Move the files of `folder` into the new file `archive`, which is on the disk when this
    returns. The same files give the same bytes.  between: called before each file."""
    with archive.open("xb") as out:
        with ZipFile(out, "w", ZIP_STORED) as zipped:
            for name, file in files(folder):
                between()
                about = ZipInfo(name)
                about.file_size, about.external_attr = file.stat().st_size, 0o644 << 16
                with file.open("rb") as source, zipped.open(about, "w") as member:
                    for piece in cancellation.check_each(iter(partial(source.read, 1 << 20), b"")):
                        member.write(piece)
                file.unlink()  # so that a package takes its room on the disk once
        out.flush()
        os.fsync(out.fileno())


def read_archive(archive: BinaryIO, path: Path) -> dict[str, range]:
    """Where the bytes of each file are, by its path in the package.

    Raises StorageError where the archive is not as it was written: cut short, or with other sizes;
    of small files the bytes are checked, too.
    """
    try:
        with ZipFile(archive) as zipped:
            found: dict[str, range] = {}
            end = 0
            for about in zipped.infolist():
                if about.header_offset != end:
                    raise BadZipFile(f"{about.filename} is not where it was written")
                with zipped.open(about) as member:  # raises where its header says other things
                    if about.file_size <= CHECKED:
                        member.read()  # raises where its checksum is another
                start = _start(archive, end)
                end = start + about.file_size
                found[about.filename] = range(start, end)
            if zipped.start_dir != end:
                raise BadZipFile("its files end elsewhere")
    except (BadZipFile, struct.error, EOFError, RuntimeError, ValueError) as error:
        raise damaged(path, str(error)) from error
    return found


def files(folder: Path) -> list[tuple[str, Path]]:
    """The files of a folder, by path in it, ascending."""
    found = sorted(file for file in folder.rglob("*") if file.is_file())
    return [(file.relative_to(folder).as_posix(), file) for file in found]


def _start(archive: BinaryIO, header: int) -> int:
    """Where the bytes of a file begin, whose local header is there."""
    archive.seek(header)
    name, further = _LENGTHS.unpack(archive.read(_HEADER))
    return header + _HEADER + int(name) + int(further)
