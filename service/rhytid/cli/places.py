"""Where a command writes, looked at before long work."""

from __future__ import annotations

from pathlib import Path

from rhytid.cli.options import STDOUT
from rhytid.errors import InputError
from rhytid.support.atomic_files import working_folder


def make_place(file: Path | None) -> None:
    """The folder of a file that will be written; raises InputError where that cannot be. Nothing
    for stdout, or where there is no file."""
    if file in (None, STDOUT):
        return
    assert file is not None
    if file.is_dir():
        raise InputError(f"{file} is a folder, not a file")
    if file.exists() and not file.is_file():  # the file would take its place
        raise InputError(f"{file} is a device or a pipe, not a plain file")
    _make(file.parent, file)


def make_folder(folder: Path) -> None:
    """A folder that files will be written to; raises InputError where that cannot be."""
    _make(folder, folder)


def _make(folder: Path, written: Path) -> None:
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{written} cannot be written: {folder} is a file, not a folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with working_folder(folder):
            pass
    except OSError as error:
        raise InputError(f"{written} cannot be written: {error.strerror}") from error
