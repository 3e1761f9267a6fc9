"""Multipart bodies: multipart/form-data is read, multipart/mixed is written.

Reading is strict: known parts, each at most once but for maps, and the closing boundary seen.
"""

from __future__ import annotations

import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from fastapi import Response
from python_multipart.exceptions import FormParserError
from python_multipart.multipart import MultipartParser, parse_options_header
from starlette.exceptions import HTTPException

from rhytid.api.spool import Spool
from rhytid.domain.painted_maps import CONTROLS
from rhytid.domain.wording import plural
from rhytid.errors import InputError, LimitError

REPEATED = ("stiffness", "scan", "scan_mask", *CONTROLS)
PARTS = ("mesh", "settings", "graph", "force", "shapes", *REPEATED)
MOST_REPEATED = 512
HEADER_LIMIT = 8192
LONGEST_BOUNDARY = 70  # RFC 2046, section 5.1.1
CRLF = b"\r\n"


@dataclass(frozen=True)
class Part:
    """One part of a form.

    filename: None for a plain field.  start, size: where its bytes lie in the spool.  again: later
    parts of the same name.
    """

    name: str
    filename: str | None
    spool: Spool
    start: int
    size: int
    again: tuple[Part, ...] = ()

    @property
    def data(self) -> bytes:
        """The bytes, read anew."""
        return self.spool.read(self.start, self.size)


def boundary(content_type: str) -> bytes:
    """Return the boundary of a multipart/form-data Content-Type; raises HTTPException, a 415, for
    any other type, and InputError for a boundary of a wrong length."""
    media_type, options = parse_options_header(content_type)
    if media_type != b"multipart/form-data":
        shown = media_type.decode("latin-1")
        raise HTTPException(415, f"Content-Type is {shown!r}: must be multipart/form-data")
    found = options.get(b"boundary", b"")
    if not 0 < len(found) <= LONGEST_BOUNDARY:
        rule = f"1 to {LONGEST_BOUNDARY} characters"
        raise InputError(f"multipart boundary has {plural(len(found), 'character')}: {rule}")
    return found


class PartReader:
    """Reads the parts of a body that arrives in chunks; their bytes go to a spool."""

    def __init__(self, boundary: bytes, spool: Spool) -> None:
        self._spool = spool
        self._parts: dict[str, list[Part]] = {}
        self._ended = False
        self._begin()
        self._parser = MultipartParser(
            boundary,
            {
                "on_part_begin": self._begin,
                "on_header_field": self._on_field,
                "on_header_value": self._on_value,
                "on_header_end": self._on_header,
                "on_headers_finished": self._on_headers,
                "on_part_data": self._on_data,
                "on_part_end": self._on_part,
                "on_end": self._on_end,
            },
        )

    def feed(self, chunk: bytes) -> None:
        """Read the next chunk. Raises InputError naming the part, or the position of a bad byte,
        and LimitError above MOST_REPEATED parts of a name."""
        try:
            self._parser.write(chunk)
        except FormParserError as error:
            raise InputError(f"multipart body: {error}") from error

    def finish(self) -> dict[str, Part]:
        """Return the parts by name; raises InputError where the body was cut."""
        if not self._ended:
            raise InputError("multipart body ends before its closing boundary")
        return {
            name: replace(first, again=tuple(again))
            for name, (first, *again) in self._parts.items()
        }

    def _begin(self) -> None:
        self._field, self._value = bytearray(), bytearray()
        self._name = ""
        self._filename: str | None = None
        self._disposition = b""
        self._start = self._spool.size

    def _on_field(self, data: bytes, start: int, end: int) -> None:
        self._grow(self._field, data[start:end])

    def _on_value(self, data: bytes, start: int, end: int) -> None:
        self._grow(self._value, data[start:end])

    def _grow(self, text: bytearray, more: bytes) -> None:
        if len(text) + len(more) > HEADER_LIMIT:
            raise InputError(f"multipart body: a part's header is above {HEADER_LIMIT} bytes")
        text += more

    def _on_header(self) -> None:
        if self._field.lower() == b"content-disposition":
            self._disposition = bytes(self._value)
        self._field.clear()
        self._value.clear()

    def _on_headers(self) -> None:
        _, options = parse_options_header(self._disposition)
        if b"name" not in options:
            raise InputError("multipart body: a part has no name in its Content-Disposition")
        self._name = options[b"name"].decode("utf-8", "replace")
        filename = options.get(b"filename")
        self._filename = None if filename is None else filename.decode("utf-8", "replace")
        if self._name not in PARTS:
            raise InputError(f"unknown part {self._name!r}: one of {', '.join(PARTS)}")
        if self._name in self._parts and self._name not in REPEATED:
            raise InputError(f"part {self._name} was sent twice")
        if len(self._parts.get(self._name, ())) == MOST_REPEATED:
            times = f"{MOST_REPEATED + 1} times: at most {MOST_REPEATED}"
            raise LimitError(f"part {self._name} was sent {times}")

    def _on_data(self, data: bytes, start: int, end: int) -> None:
        self._spool.write(memoryview(data)[start:end])

    def _on_part(self) -> None:
        size = self._spool.size - self._start
        part = Part(self._name, self._filename, self._spool, self._start, size)
        self._parts.setdefault(self._name, []).append(part)

    def _on_end(self) -> None:
        self._ended = True


@dataclass(frozen=True)
class MixedPart:
    """Headers and body of one part of multipart/mixed."""

    headers: Mapping[str, str]
    body: bytes


def mixed_response(
    parts: Sequence[MixedPart], headers: Mapping[str, str] | None = None
) -> Response:
    """Return the parts, in order, as one multipart/mixed response (RFC 2046, section 5.1)."""
    boundary = secrets.token_hex(16)
    media_type = f"multipart/mixed; boundary={boundary}"
    return Response(write(parts, boundary), headers=headers, media_type=media_type)


def write(parts: Sequence[MixedPart], boundary: str) -> bytes:
    """Return the body of a multipart/mixed message; every part has its Content-Length."""
    pieces: list[bytes] = []
    for part in parts:
        headers = {**part.headers, "Content-Length": str(len(part.body))}
        lines = [f"--{boundary}", *(f"{name}: {value}" for name, value in headers.items())]
        pieces += ["\r\n".join(lines).encode("latin-1"), CRLF, CRLF, part.body, CRLF]
    pieces.append(f"--{boundary}--\r\n".encode("latin-1"))
    return b"".join(pieces)
