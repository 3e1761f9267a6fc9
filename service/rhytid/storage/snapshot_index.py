"""What a snapshot begins with: which asset it is of, its files and their SHA-256.

A snapshot is an uncompressed tar. Its first file, `snapshot.json`, names all others in the order in
which they come. Headers of the tar hold nothing but a name and a size, so that the same asset gives
the same bytes everywhere, and each header that is read is compared with the only one there may be.
"""

from __future__ import annotations

import re
import tarfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from rhytid.errors import SnapshotError, StorageError
from rhytid.storage import kept_shapes
from rhytid.storage.canonical import hashed, parse_hashed
from rhytid.storage.homes import ASSET, ID, OVERLAY, SHAPES
from rhytid.storage.manifest import StoredFile
from rhytid.storage.records import FACTS, GRAPH, MESH, STIFFNESS

# Raise it when an older version could not read a new snapshot rightly. Format 2 has named shapes; a
# snapshot without any is of format 1, so that versions that do not know shapes read it.
FORMAT = 2
INDEX = "snapshot.json"
LONGEST_INDEX = 1 << 16
BLOCK = 512
# Two empty blocks end a tar.
END = bytes(2 * BLOCK)
NEEDED = (*(f"{ASSET}/{name}" for name in (FACTS, GRAPH, MESH)), OVERLAY)
NAMED_SHAPES = tuple(f"{SHAPES}/{name}" for name in (kept_shapes.SHAPES, kept_shapes.NAMES))
ALLOWED = {*NEEDED, f"{ASSET}/{STIFFNESS}", *NAMED_SHAPES}
_SHA256 = re.compile(r"[0-9a-f]{64}", re.ASCII)
_KIND = "rhytid snapshot"
_FOREIGN = "this is no snapshot of rhytid"


@dataclass(frozen=True)
class SnapshotIndex:
    """The asset of a snapshot, and its files in their order, by name."""

    asset: str
    files: Mapping[str, StoredFile]

    @classmethod
    def of(cls, asset: str, files: Mapping[str, StoredFile]) -> SnapshotIndex:
        """With the files in the order that they have in every snapshot."""
        return cls(asset, MappingProxyType({name: files[name] for name in sorted(files)}))

    def encode(self) -> bytes:
        """As the text of `snapshot.json`."""
        files = [{"name": name, **file.as_json()} for name, file in self.files.items()]
        named = FORMAT if self.has_shapes else 1
        return hashed({"kind": _KIND, "format": named, "asset": self.asset, "files": files})

    @classmethod
    def decode(cls, data: bytes) -> SnapshotIndex:
        """The inverse of `encode`; raises SnapshotError naming what is wrong."""
        try:
            found = parse_hashed(data, Path(INDEX))
        except StorageError as exc:
            raise SnapshotError(str(exc)) from exc
        if not isinstance(found, dict) or found.get("kind") != _KIND:
            raise SnapshotError(f"{_FOREIGN}: {INDEX} does not say so")
        named = found.get("format")
        if type(named) is not int or not 0 < named <= FORMAT:
            raise SnapshotError(
                f"a snapshot of format {named}, and this version of rhytid reads {FORMAT}: "
                "update rhytid, or make the snapshot with the version that reads it here"
            )
        index = cls.of(_asset(found.get("asset")), _files(found.get("files")))
        if index.encode() != data:
            raise SnapshotError(f"{INDEX} holds more than format {named} has, or in another order")
        return index

    @property
    def has_shapes(self) -> bool:
        """Whether named shapes are among the files."""
        return any(name in self.files for name in NAMED_SHAPES)

    @property
    def nbytes(self) -> int:
        """Bytes of the whole snapshot."""
        sizes = [len(self.encode()), *(file.nbytes for file in self.files.values())]
        return sum(BLOCK + size + padding(size) for size in sizes) + len(END)


def header(name: str, nbytes: int) -> bytes:
    """The block of a tar before a file."""
    about = tarfile.TarInfo(name)
    about.size = nbytes
    return about.tobuf(tarfile.GNU_FORMAT, "ascii", "strict")


def index_size(block: bytes) -> int:
    """The size of `snapshot.json` by the first block of a file; raises SnapshotError where that is
    not the first block of a snapshot."""
    try:
        about = tarfile.TarInfo.frombuf(block, "ascii", "strict")
    except (tarfile.TarError, ValueError) as exc:
        raise SnapshotError(f"{_FOREIGN}: byte 0 does not begin a tar ({exc})") from exc
    if about.name != INDEX or block != header(INDEX, about.size):
        raise SnapshotError(f"{_FOREIGN}: its first file is {about.name!r:.80}, not {INDEX}")
    if about.size > LONGEST_INDEX:
        raise SnapshotError(f"{INDEX} has {about.size} bytes: at most {LONGEST_INDEX}")
    return about.size


def padding(nbytes: int) -> int:
    """Bytes that fill the last block of a file."""
    return -nbytes % BLOCK


def _asset(named: Any) -> str:
    if not isinstance(named, str) or not ID.fullmatch(named):
        raise SnapshotError(f"{INDEX}: asset is {named!r:.80}, not 16 hexadecimal digits")
    return named


def _files(listed: Any) -> dict[str, StoredFile]:
    try:
        found = {str(entry["name"]): StoredFile.parse(entry) for entry in listed}
    except (KeyError, TypeError, ValueError) as exc:
        raise SnapshotError(f"{INDEX}: files are not listed as they should be: {exc}") from exc
    for name, file in found.items():
        if name not in ALLOWED:
            raise SnapshotError(f"{INDEX} names {name!r:.80}, which is no file of an asset")
        if file.nbytes < 0 or not _SHA256.fullmatch(file.sha256):
            raise SnapshotError(f"{INDEX}: {name} has no size and SHA-256")
    for name in NEEDED:
        if name not in found:
            raise SnapshotError(f"{INDEX} does not name {name}, which every asset has")
    if len(found.keys() & set(NAMED_SHAPES)) == 1:
        raise SnapshotError(f"{INDEX} names one of {' and '.join(NAMED_SHAPES)}: both or none")
    return found
