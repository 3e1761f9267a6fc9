"""Names of files, and files that are there when they are whole."""

from __future__ import annotations

import re
from pathlib import Path
from zlib import crc32

from rhytid_client.hosts.trouble import Trouble
from rhytid_client.saving import write_whole

# Characters of a name: the server takes 64 for a frame, some of which `Server.drawn` adds.
_LONGEST = 40


def slug(name: str) -> str:
    """A name of a file, and of a frame of the server, of at most 40 characters; other names have
    other ones."""
    plain = re.sub(r"[^A-Za-z0-9_-]+", "_", name)[:_LONGEST]
    return plain if plain == name else f"{plain[: _LONGEST - 9]}-{crc32(name.encode()):08x}"


def replaced(path: Path, data: bytes) -> None:
    """Write a file that is there when it is whole; raises Trouble."""
    try:
        write_whole(path, data)
    except OSError as exc:
        raise Trouble(f"{path} cannot be written: {exc}") from exc


def folder_at(path: Path) -> Path:
    """The folder, made where it is not there; raises Trouble."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as exc:
        raise Trouble(f"Maps cannot be written to {path}: {exc}") from exc
    return path
