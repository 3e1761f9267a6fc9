"""Writing multipart/mixed (RFC 2046, section 5.1): many tiles in one response."""

from __future__ import annotations

import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from fastapi import Response

CRLF = b"\r\n"


@dataclass(frozen=True)
class MixedPart:
    """Headers and body of one part."""

    headers: Mapping[str, str]
    body: bytes


def mixed_response(
    parts: Sequence[MixedPart], headers: Mapping[str, str] | None = None
) -> Response:
    """The parts, in order, as one multipart/mixed response."""
    boundary = secrets.token_hex(16)
    media_type = f"multipart/mixed; boundary={boundary}"
    return Response(write(parts, boundary), headers=headers, media_type=media_type)


def write(parts: Sequence[MixedPart], boundary: str) -> bytes:
    """The body of a multipart/mixed message; every part says its Content-Length."""
    pieces: list[bytes] = []
    for part in parts:
        headers = {**part.headers, "Content-Length": str(len(part.body))}
        lines = [f"--{boundary}", *(f"{name}: {value}" for name, value in headers.items())]
        pieces += ["\r\n".join(lines).encode("latin-1"), CRLF, CRLF, part.body, CRLF]
    pieces.append(f"--{boundary}--\r\n".encode("latin-1"))
    return b"".join(pieces)
