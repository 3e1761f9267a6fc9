"""Bodies that are files: read while they are sent, written while they come."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO
from uuid import uuid4

CHUNK = 1 << 18


@dataclass(frozen=True)
class FileBody:
    """A file as a body that can be sent more than once.

    `progress(sent, total)` is called, in bytes, after each piece was taken.
    """

    path: Path
    media_type: str
    progress: Callable[[int, int], None] | None = None

    def headers(self) -> dict[str, str]:
        """Content-Type and Content-Length; raises OSError where the file cannot be read."""
        size = self.path.stat().st_size
        return {"Content-Type": self.media_type, "Content-Length": str(size)}

    def chunks(self) -> Iterator[bytes]:
        """The body in pieces, from its start."""
        total, sent = self.path.stat().st_size, 0
        with self.path.open("rb") as file:
            while chunk := file.read(CHUNK):
                yield chunk
                sent += len(chunk)
                if self.progress is not None:
                    self.progress(sent, total)


class Arriving:
    """A file that is there once all of it came: used by `with`, and ended by `done`.

    It is written beside its place under another name, which is removed where it was not ended.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._aside = path.with_name(f".{path.name}.{uuid4().hex}")
        self._file: BinaryIO = self._aside.open("xb")
        self._size = 0

    def write(self, chunk: bytes) -> None:
        """Put bytes at the end."""
        self._file.write(chunk)
        self._size += len(chunk)

    def done(self, declared: str | None) -> None:
        """Move it into its place.

        declared: Content-Length of the answer. Raises EOFError where fewer bytes came.
        """
        if declared is not None and int(declared) != self._size:
            raise EOFError(f"{self._size} of {declared} bytes came")
        self._file.close()
        self._aside.replace(self._path)

    def __enter__(self) -> Arriving:
        return self

    def __exit__(self, *exc: object) -> None:
        self._file.close()
        self._aside.unlink(missing_ok=True)
