"""Reading multipart/mixed (RFC 2046, section 5.1): many tiles in one answer."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from email.message import Message

from rhytid_client.errors import BadAnswer


@dataclass(frozen=True)
class MixedPart:
    """Headers (names in lower case) and content of one part; the content is not copied."""

    headers: dict[str, str]
    content: memoryview


def boundary_of(content_type: str) -> str:
    """The boundary of a multipart/mixed Content-Type; raises BadAnswer for any other type."""
    message = Message()
    message["Content-Type"] = content_type
    boundary = message.get_param("boundary")
    if message.get_content_type() != "multipart/mixed" or not isinstance(boundary, str):
        raise BadAnswer(f"Content-Type is {content_type!r}: expected multipart/mixed")
    return boundary


def read_mixed(body: bytes, boundary: str) -> list[MixedPart]:
    """The parts in order; raises BadAnswer where the body is cut or malformed.

    A part that says its Content-Length is taken by it, so it may hold the boundary itself.
    """
    return list(_parts(body, f"--{boundary}".encode("latin-1")))


def _parts(body: bytes, fence: bytes) -> Iterator[MixedPart]:
    if not body.startswith(fence) and b"\r\n" + fence not in body:
        raise BadAnswer("multipart answer without its boundary")
    at = 0 if body.startswith(fence) else body.index(b"\r\n" + fence) + 2
    number = 0
    while not body.startswith(b"--", at + len(fence)):
        start = _line_end(body, at + len(fence), number)
        head = _head_end(body, start, number)
        headers = _headers(body[start:head])
        content = head + 2 if head == start else head + 4
        end = _content_end(body, content, headers, fence, number)
        yield MixedPart(headers, memoryview(body)[content:end])
        at, number = end + 2, number + 1


def _line_end(body: bytes, at: int, number: int) -> int:
    """Past the line of a boundary, which may end in blanks."""
    end = body.find(b"\r\n", at)
    if end < 0 or body[at:end].strip(b" \t"):
        raise BadAnswer(f"part {number} of the multipart answer has a broken boundary")
    return end + 2


def _head_end(body: bytes, start: int, number: int) -> int:
    """Where the headers end: at `start` itself where there are none."""
    end = start if body.startswith(b"\r\n", start) else body.find(b"\r\n\r\n", start)
    if end < 0:
        raise BadAnswer(f"part {number} of the multipart answer has no end of its headers")
    return end


def _headers(head: bytes) -> dict[str, str]:
    pairs = (line.partition(":") for line in head.decode("latin-1").split("\r\n") if line)
    return {name.strip().lower(): value.strip() for name, _, value in pairs}


def _content_end(
    body: bytes, start: int, headers: dict[str, str], fence: bytes, number: int
) -> int:
    length = headers.get("content-length", "")
    counted = length.isascii() and length.isdigit()
    end = start + int(length) if counted else body.find(b"\r\n" + fence, start)
    if end < 0 or not body.startswith(b"\r\n" + fence, end):
        raise BadAnswer(f"part {number} of the multipart answer is cut")
    return end
