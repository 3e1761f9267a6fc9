"""multipart/form-data bodies (RFC 7578), written piece by piece: files are never held whole."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

CHUNK = 1 << 18


@dataclass(frozen=True)
class Part:
    """One field of a form; a `Path` is read while it is sent."""

    name: str
    source: bytes | memoryview | Path
    media_type: str = "application/octet-stream"
    filename: str | None = None

    def head(self) -> bytes:
        """The headers of the part, up to its first byte."""
        disposition = f'form-data; name="{self.name}"'
        if self.filename is not None:
            disposition += f'; filename="{_quoted(self.filename)}"'
        lines = (f"Content-Disposition: {disposition}", f"Content-Type: {self.media_type}")
        return "\r\n".join([*lines, "", ""]).encode()

    def size(self) -> int:
        """Bytes of the content; raises OSError where the file cannot be read."""
        return self.source.stat().st_size if isinstance(self.source, Path) else len(self.source)

    def chunks(self) -> Iterator[bytes]:
        """The content in pieces."""
        if isinstance(self.source, Path):
            with self.source.open("rb") as file:
                yield from iter(lambda: file.read(CHUNK), b"")
        else:
            view = memoryview(self.source)
            yield from (bytes(view[at : at + CHUNK]) for at in range(0, len(view), CHUNK))


@dataclass(frozen=True)
class Form:
    """A body that can be sent more than once.

    `progress(sent, total)` is called, in bytes of the body, after each piece was taken.
    """

    parts: tuple[Part, ...]
    progress: Callable[[int, int], None] | None = None
    boundary: str = field(default_factory=lambda: secrets.token_hex(16), compare=False)

    def headers(self) -> dict[str, str]:
        """Content-Type and Content-Length."""
        return {
            "Content-Type": f"multipart/form-data; boundary={self.boundary}",
            "Content-Length": str(self.size()),
        }

    def size(self) -> int:
        """Bytes of the whole body."""
        fence = len(f"--{self.boundary}\r\n")
        parts = sum(fence + len(part.head()) + part.size() + 2 for part in self.parts)
        return parts + fence + 2

    def chunks(self) -> Iterator[bytes]:
        """The body in pieces, from its start."""
        total, sent = self.size(), 0
        for chunk in self._pieces():
            yield chunk
            sent += len(chunk)
            if self.progress is not None:
                self.progress(sent, total)

    def _pieces(self) -> Iterator[bytes]:
        for part in self.parts:
            yield f"--{self.boundary}\r\n".encode() + part.head()
            yield from part.chunks()
            yield b"\r\n"
        yield f"--{self.boundary}--\r\n".encode()


def _quoted(filename: str) -> str:
    """As browsers write it: what would end the quotes or the line is percent-encoded."""
    return filename.replace("\r", "%0D").replace("\n", "%0A").replace('"', "%22")
