"""The statements of an OBJ file, and the lines that they are on."""

from __future__ import annotations

import io
import re
from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field

from rhytid.errors import MeshError
from rhytid.formats.decimals import show

# They change neither the vertices nor the triangles. What points to a file is never opened; `call`
# and `csh`, which would bring in another file's vertices, are not among them.
_PASSED_OVER = frozenset(
    # normals, points, lines, groups, display
    b"vn vp l p o g s mg lod bevel c_interp d_interp "
    b"mtllib usemtl maplib usemap shadow_obj trace_obj "
    # curves and surfaces, their attributes and bodies; the last row is of older files
    b"cstype deg bmat step curv curv2 surf parm trim hole scrv sp end con ctech stech "
    b"bsp bzp cdc cdp res".split()
)
_CONTINUATION = re.compile(rb"\\ *\n")


class Texts:
    """Texts one behind the other: a Python object for each would take several times the memory."""

    def __init__(self) -> None:
        self._all, self._ends = bytearray(), array("q", [0])

    def __len__(self) -> int:
        return len(self._ends) - 1

    def __getitem__(self, index: int) -> bytes:
        if index >= len(self):
            raise IndexError(index)
        return bytes(self._all[self._ends[index] : self._ends[index + 1] - 1])

    def __iter__(self) -> Iterator[bytes]:
        view, start = memoryview(self._all), 0
        for end in self._ends[1:]:
            yield bytes(view[start : end - 1])
            start = end

    def append(self, text: bytes) -> None:
        """Put a text at the end."""
        self._all += text
        self._all += b" "
        self._ends.append(len(self._all))

    def joined(self) -> bytes:
        """All of them, a space behind each."""
        return bytes(self._all)


@dataclass
class Statements:
    """All statements of one keyword: the lines they stand on, and what follows the keyword."""

    lines: array[int] = field(default_factory=lambda: array("q"))
    texts: Texts = field(default_factory=Texts)


def split_statements(data: bytes) -> dict[bytes, Statements]:
    """The statements `v`, `vt` and `f`; MeshError naming the line of a keyword unknown here."""
    found = {key: Statements() for key in (b"v", b"vt", b"f")}
    for number, line in enumerate(_plain_lines(data), 1):
        parts = line.split(None, 1)
        if not parts:
            continue
        statements = found.get(parts[0])
        if statements is not None:
            statements.lines.append(number)
            statements.texts.append(parts[1] if len(parts) > 1 else b"")
        elif parts[0] not in _PASSED_OVER:
            raise MeshError(f"line {number}: {show(parts[0])} is not a statement known here")
    return found


def _plain_lines(data: bytes) -> Iterator[bytes]:
    """Lines without comments and tabs; continued lines are joined at the first."""
    text = data.removeprefix(b"\xef\xbb\xbf").replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    text = text.replace(b"\t", b" ")
    if b"#" in text:
        text = re.sub(rb"#[^\n]*", b"", text)
    if b"\\" in text:
        text = _join_continued(text)
    for line in io.BytesIO(text):  # not split at once, into an object for each
        yield line.removesuffix(b"\n")


def _join_continued(text: bytes) -> bytes:
    first, *others = _CONTINUATION.split(text)
    joined, owed = [first], 0
    for other in others:
        line, end, rest = other.partition(b"\n")
        joined += [b" ", line]
        owed += 1
        if end:
            # The empty lines keep the numbers of those that follow.
            joined += [b"\n" * owed, end, rest]
            owed = 0
    return b"".join(joined)
