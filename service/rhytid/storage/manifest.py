"""Sealed folders: files beside a manifest of their sizes and SHA-256, checked on every read.

The manifest is canonical JSON and every value in it is compared with what is there, so a change
of any byte of any file in the folder, its own included, is seen.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rhytid.storage.canonical import canonical, check_format, damaged, parse_canonical
from rhytid.storage.homes import MANIFEST
from rhytid.support import cancellation
from rhytid.support.atomic_files import storage_errors, sync_folder, write_file, write_pieces

# The bytes of a file, or pieces of them, which may be views of what they are made of.
Content = bytes | Sequence[bytes | memoryview]
FORMAT = 1
# Bytes that are in memory at a time.
_PIECE = 1 << 20


@dataclass(frozen=True)
class StoredFile:
    """Size and SHA-256 of a file."""

    nbytes: int
    sha256: str

    @classmethod
    def of(cls, content: Content) -> StoredFile:
        """The size and SHA-256 of a file with this content."""
        digest, nbytes = hashlib.sha256(), 0
        for piece in _pieces(content):
            digest.update(piece)
            nbytes += len(piece)
        return cls(nbytes, digest.hexdigest())

    @classmethod
    def read(cls, path: Path) -> StoredFile:
        """The size and SHA-256 of the file at a path, which is read piece by piece; raises
        OSError."""
        # hashlib.file_digest came with Python 3.11.
        digest, nbytes = hashlib.sha256(), 0
        with path.open("rb") as file:
            while piece := file.read(_PIECE):
                cancellation.check()
                digest.update(piece)
                nbytes += len(piece)
        return cls(nbytes, digest.hexdigest())

    def as_json(self) -> dict[str, Any]:
        """The entry of the file in a manifest."""
        return {"bytes": self.nbytes, "sha256": self.sha256}

    @classmethod
    def parse(cls, fact: Any) -> StoredFile:
        """The inverse of `as_json`; raises KeyError, TypeError or ValueError."""
        return cls(int(fact["bytes"]), str(fact["sha256"]))


def write_with_manifest(folder: Path, label: str, files: Mapping[str, Content]) -> None:
    """Write `files` and their manifest into the new folder `folder` and sync all of it.

    `label` names the folder, so that one that was moved to a wrong place is detected.
    """
    folder.mkdir()
    for name, content in files.items():
        write_pieces(folder / name, _pieces(content))
    seal(folder, label, {name: StoredFile.of(content) for name, content in files.items()})


def _pieces(content: Content) -> Iterator[memoryview]:
    """Some bytes at a time, unless the work of this thread is to stop."""
    views = [memoryview(one) for one in ([content] if isinstance(content, bytes) else content)]
    return cancellation.check_each(
        view[at : at + _PIECE] for view in views for at in range(0, len(view), _PIECE)
    )


def seal(folder: Path, label: str, files: Mapping[str, StoredFile]) -> None:
    """Write the manifest of `files`, which are in `folder` already, and sync their names."""
    facts = {name: file.as_json() for name, file in files.items()}
    write_file(folder / MANIFEST, canonical({"format": FORMAT, "label": label, "files": facts}))
    sync_folder(folder)


def read_verified(folder: Path, label: str) -> dict[str, bytes]:
    """The files of a sealed folder, verified; raises StorageError naming the first file that is not
    what was written."""
    facts = _manifest(folder, label)
    _check_names(folder, set(facts))
    return {name: _verified(folder / name, expected) for name, expected in facts.items()}


def read_file(folder: Path, label: str, name: str) -> bytes:
    """One file of a sealed folder, verified; raises StorageError where the file or the manifest is
    damaged."""
    facts = _manifest(folder, label)
    if name not in facts:
        raise damaged(folder / name, "the manifest does not name this file")
    return _verified(folder / name, facts[name])


def read_manifest(folder: Path, label: str) -> dict[str, StoredFile]:
    """The sizes and digests of the files of a sealed folder, as they were written; raises
    StorageError where the manifest is damaged."""
    path = folder / MANIFEST
    try:
        return {name: StoredFile.parse(fact) for name, fact in _manifest(folder, label).items()}
    except (KeyError, TypeError, ValueError) as exc:
        raise damaged(path, f"not a manifest of {label}: {exc}") from exc


def _manifest(folder: Path, label: str) -> dict[str, Any]:
    path = folder / MANIFEST
    manifest = parse_canonical(_bytes(path), path)
    facts = manifest.get("files") if isinstance(manifest, dict) else None
    check_format(manifest, FORMAT, path)
    expected = {"format": FORMAT, "label": label, "files": facts}
    if manifest != expected or not isinstance(facts, dict):
        raise damaged(path, f"not a manifest of {label}, format {FORMAT}")
    return facts


def _check_names(folder: Path, named: set[str]) -> None:
    with storage_errors(f"{folder} cannot be read"):
        present = {entry.name for entry in folder.iterdir()} - {MANIFEST}
    for name in sorted(named - present):
        raise damaged(folder / name, "the file is missing")
    for name in sorted(present - named):
        raise damaged(folder / name, "the manifest does not name this file")


def _verified(path: Path, expected: Any) -> bytes:
    data = _bytes(path)
    found = StoredFile.of(data).as_json()
    if found != expected:
        raise damaged(path, f"it has {found}, the manifest says {expected}")
    return data


def _bytes(path: Path) -> bytes:
    with storage_errors(f"{path} cannot be read"):
        return path.read_bytes()
