"""Snapshots: an asset as one file, written and read piece by piece (`snapshot_index` has the
format)."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import BinaryIO, Protocol

from rhytid.errors import SnapshotError
from rhytid.storage.canonical import damaged
from rhytid.storage.homes import ASSET, SHAPES
from rhytid.storage.manifest import StoredFile, seal
from rhytid.storage.snapshot_index import (
    BLOCK,
    END,
    INDEX,
    SnapshotIndex,
    header,
    index_size,
    padding,
)
from rhytid.support.atomic_files import storage_errors, sync_folder, write_pieces

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
    it.  index: what the file begins with.  nbytes: of the whole file.
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
        """What it is made of: its index, the paths of its files and its overlay."""
        return self.index, self._paths, self._overlay

    def check(self) -> None:
        """Read all of it; raises StorageError where a file is not what was written."""
        for name in self._paths:
            self.check_file(name)

    def check_file(self, name: str) -> None:
        """As `check`, of one of its files that is not the overlay."""
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

    def _content(self, name: str, wanted: StoredFile) -> Iterator[bytes]:
        file, path = self._files[name], self._paths[name]
        digest, size = hashlib.sha256(), 0
        with storage_errors(f"{path} cannot be read"):
            file.seek(0)
            while piece := file.read(PIECE):
                digest.update(piece)
                size += len(piece)
                if size > wanted.nbytes:
                    break
                yield piece
        if StoredFile(size, digest.hexdigest()) != wanted:
            raise damaged(path, "it is not what the manifest says")


def unpack(stream: Readable, nbytes: int, place: Path) -> SnapshotIndex:
    """Write the files of a snapshot into the folder `place`, as sealed folders and an overlay.

    nbytes: of the snapshot. No more than that is written. Raises SnapshotError naming the byte
    where a snapshot is damaged, cut off, of a newer format or none; what is written by then is left
    in `place`. The bytes are those that were written; what they mean is not looked at.
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
    """The block writes the files of a snapshot into the folder `place`; then its folders are
    sealed. What is written is not compared with the index."""
    kinds = (ASSET, SHAPES) if index.has_shapes else (ASSET,)
    for kind in kinds:
        (place / kind).mkdir()
    yield
    for kind in kinds:
        own = {Path(name).name: f for name, f in index.files.items() if name.startswith(f"{kind}/")}
        seal(place / kind, f"{kind} {index.asset}", own)
    sync_folder(place)


def asset_of(stream: Readable) -> str:
    """The id of the asset of a snapshot, of which the beginning is read; raises SnapshotError."""
    source = _Source(stream)
    size = index_size(source.exactly(BLOCK, "its first block"))
    return SnapshotIndex.decode(source.exactly(size, INDEX)).asset


class _Source:
    """A stream that knows where it is."""

    def __init__(self, stream: Readable) -> None:
        self._stream, self._at = stream, 0

    def exactly(self, size: int, what: str) -> bytes:
        """So many bytes, fewer than a piece."""
        return b"".join(self._pieces(size, what))

    def expect(self, wanted: bytes, what: str) -> None:
        """Pass by bytes that can only be these."""
        at = self._at
        if self.exactly(len(wanted), what) != wanted:
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
