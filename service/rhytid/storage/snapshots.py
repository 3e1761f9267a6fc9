"""Snapshots: an asset as one file, written and read piece by piece.

A snapshot is an uncompressed tar. Its first file, `snapshot.json`, names all others in the order in
which they come. Headers of the tar hold nothing but a name and a size, so that the same asset gives
the same bytes everywhere, and each header that is read is compared with the only one there may be.
"""

from __future__ import annotations

import hashlib
import os
import re
import tarfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, BinaryIO, Protocol

from rhytid.errors import SnapshotError, StorageError
from rhytid.storage.canonical import damaged, hashed, parse_hashed
from rhytid.storage.homes import ASSET, ID, OVERLAY, SHAPES
from rhytid.storage.manifest import StoredFile, seal
from rhytid.storage.records import (
    FACTS,
    GRAPH,
    MESH,
    RESIDUAL,
    SHAPE_ARRAYS,
    SHAPE_NAMES,
    STIFFNESS,
)
from rhytid.support.atomic_files import storage_errors, sync_folder, write_pieces

# Raise it when an older version could not read a new snapshot rightly. Format 2 has named shapes,
# format 3 a residual; what has neither is of format 1, so that versions that know none read it.
FORMAT = 3
INDEX = "snapshot.json"
LONGEST_INDEX = 1 << 16
BLOCK = 512
# Two empty blocks end a tar.
END = bytes(2 * BLOCK)
NEEDED = (*(f"{ASSET}/{name}" for name in (FACTS, GRAPH, MESH)), OVERLAY)
NAMED_SHAPES = tuple(f"{SHAPES}/{name}" for name in (SHAPE_ARRAYS, SHAPE_NAMES))
_OF_SCAN = f"{ASSET}/{RESIDUAL}"
ALLOWED = {*NEEDED, f"{ASSET}/{STIFFNESS}", _OF_SCAN, *NAMED_SHAPES}
_SHA256 = re.compile(r"[0-9a-f]{64}", re.ASCII)
_KIND = "rhytid snapshot"
_FOREIGN = "this is no snapshot of rhytid"
# Bytes that are in memory at a time.
PIECE = 1 << 18


class Readable(Protocol):
    """A stream of bytes."""

    def read(self, size: int, /) -> bytes:
        """The next bytes, at most `size`; empty at the end."""
        ...


class OpenFile:
    """A file that is read from its start, by a descriptor, which stays the caller's.

    The position of the descriptor itself is left alone: others read it beside this one."""

    def __init__(self, descriptor: int) -> None:
        self.descriptor, self._at = descriptor, 0

    def read(self, size: int, /) -> bytes:
        """The next bytes, at most `size`; empty at the end."""
        data = os.pread(self.descriptor, size, self._at)
        self._at += len(data)
        return data


class Snapshot:
    """An asset to be written as one file.

    It holds the files of the asset open, so that it stays whole when the asset is removed; close
    it.  index: at the beginning of the file.  nbytes: of the whole file.
    """

    def __init__(self, index: SnapshotIndex, paths: Mapping[str, Path], overlay: bytes) -> None:
        self.index, self.nbytes = index, index.nbytes
        self._paths, self._overlay = paths, overlay
        self._files: dict[str, BinaryIO] = {}
        with ExitStack() as opened:
            for name, path in paths.items():
                with storage_errors(f"{path} cannot be read"):
                    self._files[name] = opened.enter_context(path.open("rb"))
            self._opened = opened.pop_all()

    @property
    def parts(self) -> tuple[SnapshotIndex, Mapping[str, Path], bytes]:
        """The index, the paths of its files by name, and the bytes of its overlay."""
        return self.index, self._paths, self._overlay

    def check(self) -> None:
        """Read all files; raises StorageError where one is not what was written."""
        for name in self._paths:
            self.check_file(name)

    def check_file(self, name: str) -> None:
        """Read one file that is not the overlay; raises as `check` does."""
        for _ in self._content(name, self.index.files[name]):
            pass

    def pieces(self) -> Iterator[bytes]:
        """The bytes of the file; raises StorageError as `check` does, before the last of them."""
        yield from _member(INDEX, [self.index.encode()])
        for name, file in self.index.files.items():
            yield header(name, file.nbytes)
            yield from [self._overlay] if name not in self._paths else self._content(name, file)
            yield bytes(padding(file.nbytes))
        yield END

    def close(self) -> None:
        """Close the files; a second call does nothing."""
        self._opened.close()

    def __enter__(self) -> Snapshot:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def _content(self, name: str, expected: StoredFile) -> Iterator[bytes]:
        file, path = self._files[name], self._paths[name]
        digest, size = hashlib.sha256(), 0
        with storage_errors(f"{path} cannot be read"):
            file.seek(0)
            while piece := file.read(PIECE):
                digest.update(piece)
                size += len(piece)
                if size > expected.nbytes:
                    break
                yield piece
        if StoredFile(size, digest.hexdigest()) != expected:
            raise damaged(path, "it is not what the manifest says")


def unpack(stream: Readable, nbytes: int, place: Path) -> SnapshotIndex:
    """Write the files of a snapshot into the folder `place`, as sealed folders and an overlay.

    nbytes: of the snapshot; no more than that is written. Raises SnapshotError naming the byte
    where a snapshot is damaged, cut off, of a newer format or none; files that were written by then
    stay in `place`. The bytes are compared with their digests; their meaning is not checked.
    """
    source = _Source(stream)
    size = index_size(source.exactly(BLOCK, "its first block"))
    index = SnapshotIndex.decode(source.exactly(size, INDEX))
    if index.nbytes != nbytes:
        more = "is cut off" if nbytes < index.nbytes else "goes on after its end"
        raise SnapshotError(f"it {more}: it has {nbytes} bytes, {INDEX} says {index.nbytes}")
    source.expect(bytes(padding(size)), INDEX)
    with sealed(index, place):
        for name, file in index.files.items():
            source.expect(header(name, file.nbytes), f"the header of {name}")
            write_pieces(place / name, source.content(name, file))
            source.expect(bytes(padding(file.nbytes)), f"the end of {name}")
        source.expect(END, "the end")
    return index


@contextmanager
def sealed(index: SnapshotIndex, place: Path) -> Iterator[None]:
    """Within the block the files of a snapshot are written into the folder `place`; then its
    folders are sealed. The files are not compared with the index."""
    kinds = (ASSET, SHAPES) if index.has_shapes else (ASSET,)
    for kind in kinds:
        (place / kind).mkdir()
    yield
    for kind in kinds:
        own = {Path(name).name: f for name, f in index.files.items() if name.startswith(f"{kind}/")}
        seal(place / kind, f"{kind} {index.asset}", own)
    sync_folder(place)


def asset_of(stream: Readable) -> str:
    """The id of the asset of a snapshot, of which only the beginning is read; raises
    SnapshotError."""
    source = _Source(stream)
    size = index_size(source.exactly(BLOCK, "its first block"))
    return SnapshotIndex.decode(source.exactly(size, INDEX)).asset


class _Source:
    """A stream that knows where it is."""

    def __init__(self, stream: Readable) -> None:
        self._stream, self._at = stream, 0

    def exactly(self, size: int, what: str) -> bytes:
        """The next `size` bytes, at most a piece."""
        return b"".join(self._pieces(size, what))

    def expect(self, expected: bytes, what: str) -> None:
        """Pass by bytes that can only be these."""
        at = self._at
        if self.exactly(len(expected), what) != expected:
            raise SnapshotError(f"it is damaged from byte {at} on: that is not {what}")

    def content(self, name: str, file: StoredFile) -> Iterator[bytes]:
        """The bytes of a file, piece by piece; raises SnapshotError after the last of them where
        they are not those that were written."""
        at, digest = self._at, hashlib.sha256()
        for piece in self._pieces(file.nbytes, name):
            digest.update(piece)
            yield piece
        if digest.hexdigest() != file.sha256:
            end = self._at - 1
            raise SnapshotError(f"{name} is damaged, bytes {at} to {end}: not the SHA-256 it had")

    def _pieces(self, size: int, what: str) -> Iterator[bytes]:
        left = size
        while left:
            piece = self._stream.read(min(left, PIECE))
            if not piece:
                raise SnapshotError(f"it is cut off at byte {self._at}, within {what}")
            self._at += len(piece)
            left -= len(piece)
            yield piece


def _member(name: str, pieces: list[bytes]) -> Iterator[bytes]:
    size = sum(map(len, pieces))
    yield header(name, size)
    yield from pieces
    yield bytes(padding(size))


@dataclass(frozen=True)
class SnapshotIndex:
    """The index of a snapshot: its asset, and its files by name, in their order."""

    asset: str
    files: Mapping[str, StoredFile]

    @classmethod
    def of(cls, asset: str, files: Mapping[str, StoredFile]) -> SnapshotIndex:
        """The index of these files, in the order that they have in every snapshot."""
        return cls(asset, MappingProxyType({name: files[name] for name in sorted(files)}))

    def encode(self) -> bytes:
        """The text of `snapshot.json`."""
        files = [{"name": name, **file.as_json()} for name, file in self.files.items()]
        named = FORMAT if _OF_SCAN in self.files else 2 if self.has_shapes else 1
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
    """The block of a tar that precedes a file."""
    about = tarfile.TarInfo(name)
    about.size = nbytes
    return about.tobuf(tarfile.GNU_FORMAT, "ascii", "strict")


def index_size(block: bytes) -> int:
    """The size of `snapshot.json`, by the first block of a file; raises SnapshotError where the
    block is not the first of a snapshot."""
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
    """How many bytes fill the last block of a file."""
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
