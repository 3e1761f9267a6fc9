"""Wavefront OBJ: `v`, `vt` and `f` with texture coordinates.

Accepted: relative indices, `vt` with a third component, `v` with a weight or colours, comments in
any encoding, CRLF, tabs, a byte-order mark, lines continued by a backslash, polygons. Materials,
groups, normals, points, lines, curves and surfaces are passed over; an unknown keyword is refused,
since a misspelt vertex would shift the order of all that follow.

Each statement is matched against its grammar once, then all numbers are converted together. In a
file that has what exporters usually write and nothing wrong, all of a kind are matched together;
any other file is read statement by statement, which finds the line of what is wrong.
"""

from __future__ import annotations

import io
import re
from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh
from rhytid.domain.validation import first_bad_row
from rhytid.domain.wording import plural
from rhytid.errors import LimitError, MeshError
from rhytid.formats.decimals import NUMBER, WHOLE, floats, is_number, show, wholes
from rhytid.formats.limits import MAX_NUMBERS, check_size
from rhytid.formats.polygons import fan

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
# Matching a face takes memory for every corner: no polygon of a real mesh comes near this.
_LONGEST_FACE = 1 << 20
# Statements that are matched and converted together: each match takes memory.
_AT_ONCE = 1 << 14
_CORNER = WHOLE + rb"/" + WHOLE + rb"(?:/" + WHOLE + rb")?"
_VERTEX = re.compile(rb"(N(?: +N){2})(?: +N|(?: +N){3,4})? *".replace(b"N", NUMBER))
_UV = re.compile(rb"(N +N)(?: +N)? *".replace(b"N", NUMBER))
_FACE = re.compile(rb"C(?: +C){2,} *".replace(b"C", _CORNER))
# Lines as exporters usually write them: corners have a normal in all of a file, or none.
_USUAL_VERTICES = re.compile(rb"(?:v(?: +N){3} *\n)*".replace(b"N", NUMBER))
_USUAL_UV = re.compile(rb"(?:vt(?: +N){2} *\n)*".replace(b"N", NUMBER))
_USUAL_FACES = {
    1: re.compile(rb"(?:f(?: +W/W){3,} *\n)*".replace(b"W", WHOLE)),
    2: re.compile(rb"(?:f(?: +W/W/W){3,} *\n)*".replace(b"W", WHOLE)),
}
# Bytes that are matched together: each line that is matched takes memory.
_BYTES_AT_ONCE = 1 << 16
_ONLY_NUMBERS = bytes.maketrans(b"vtf/", b"    ")
_WITHOUT_UV = re.compile(WHOLE + rb"(?://" + WHOLE + rb")?")
_NORMAL = re.compile(rb"(/[+-]?[0-9]+)/[+-]?[0-9]+")


def read_obj(data: bytes) -> Mesh:
    """The triangle mesh of an OBJ file; raises MeshError naming the line, or LimitError."""
    usual = _usual_mesh(data)
    if usual is not None:
        return usual
    found = split_statements(data)
    positions = _positions(found[b"v"])
    uv = _numbers(found[b"vt"], _UV, "vt", 2, "2 or 3")
    _require_finite(found[b"vt"], uv, "texture coordinate")
    counts, references = _references(found[b"f"])
    return _mesh(positions, uv, counts, _resolve(found, counts, references))


def read_obj_positions(data: bytes) -> NDArray[np.float64]:
    """The vertices (V, 3) of an OBJ file in their order; the file may have no faces. Raises
    MeshError naming the line, or LimitError."""
    usual = _usual_texts(data)
    values = None if usual is None else _usual_floats(usual[b"v"], _USUAL_VERTICES, 3)
    return _positions(split_statements(data)[b"v"]) if values is None else values


def _usual_mesh(data: bytes) -> Mesh | None:
    """The mesh of a usual file; None for any other."""
    texts = _usual_texts(data)
    if texts is None:
        return None
    positions = _usual_floats(texts[b"v"], _USUAL_VERTICES, 3)
    uv = _usual_floats(texts[b"vt"], _USUAL_UV, 2)
    faces = _usual_faces(texts[b"f"])
    if positions is None or uv is None or faces is None:
        return None
    counts, corners = faces
    if (corners < 0).any() or (corners >= (len(positions), len(uv))).any():
        return None
    return _mesh(positions, uv, counts, corners)


def _mesh(
    positions: NDArray[np.float64],
    uv: NDArray[np.float64],
    counts: NDArray[np.int64],
    corners: NDArray[np.int64],
) -> Mesh:
    """The mesh of polygons with `counts` corners (C, 2) each: indices of positions and of uv."""
    triangles = corners[fan(counts)].astype(np.int32)
    return Mesh.centred(positions, triangles[..., 0], uv, triangles[..., 1])


def _usual_texts(data: bytes) -> dict[bytes, bytes] | None:
    """The lines of each of `v`, `vt` and `f`, one behind the other, by how they begin; None where
    another line is not known."""
    text = _plain_text(data) + b"\n"
    every = np.frombuffer(text, np.uint8)
    ends = np.flatnonzero(every == ord("\n"))
    starts = np.concatenate([[0], ends[:-1] + 1])
    length = ends + 1 - starts
    first, second, third = (every[np.minimum(starts + k, len(every) - 1)] for k in range(3))
    vertex = first == ord("v")
    normal = vertex & (second == ord("n")) & (third == ord(" "))
    kinds = {
        b"v": vertex & (second == ord(" ")),
        b"vt": vertex & (second == ord("t")) & (third == ord(" ")),
        b"f": (first == ord("f")) & (second == ord(" ")),
    }
    others = np.flatnonzero(~np.logical_or.reduce([*kinds.values(), normal, length == 1]))
    for start, end in zip(starts[others].tolist(), ends[others].tolist(), strict=True):
        if text[start:end].partition(b" ")[0] not in _PASSED_OVER:
            return None
    return {key: every[np.repeat(chosen, length)].tobytes() for key, chosen in kinds.items()}


def _usual_floats(
    text: bytes, grammar: re.Pattern[bytes], width: int
) -> NDArray[np.float64] | None:
    """(N, width) numbers of lines; None where one is not usual, or too large."""
    if width * text.count(b"\n") > MAX_NUMBERS or not _all_match(text, grammar):
        return None
    values = floats(text.translate(_ONLY_NUMBERS)).reshape(-1, width)
    with np.errstate(over="ignore"):
        return values if np.isfinite(values.astype(np.float32)).all() else None


def _usual_faces(text: bytes) -> tuple[NDArray[np.int64], NDArray[np.int64]] | None:
    """(P,) corners of each polygon, and (C, 2) indices from 0 on; None as above."""
    each = text[2 : text.find(b"/") + 80].split(b" ", 1)[0].count(b"/") if text else 0
    grammar = _USUAL_FACES.get(each)
    if grammar is None or not _all_match(text, grammar):
        return None
    every = np.frombuffer(text, np.uint8)
    ends = np.flatnonzero(every == ord("\n"))
    slashes = np.searchsorted(np.flatnonzero(every == ord("/")), ends)
    counts = np.diff(slashes, prepend=0) // each
    if 3 * counts.sum() > MAX_NUMBERS:
        return None
    numbers = wholes(text.translate(_ONLY_NUMBERS)).reshape(-1, each + 1)
    return counts, numbers[:, :2] - 1


def _all_match(text: bytes, grammar: re.Pattern[bytes]) -> bool:
    """Whether all lines match, some at a time."""
    start = 0
    while start < len(text):
        end = text.rfind(b"\n", start, start + _BYTES_AT_ONCE) + 1
        if not end or not grammar.fullmatch(text, start, end):
            return False
        start = end
    return True


def _positions(found: _Statements) -> NDArray[np.float64]:
    values = _numbers(found, _VERTEX, "v", 3, "3, or 4, 6 or 7 with a weight or colours")
    with np.errstate(over="ignore"):
        narrow = values.astype(np.float32)
    _require_finite(found, narrow, "vertex")
    return values


def _numbers(
    found: _Statements, grammar: re.Pattern[bytes], key: str, width: int, rule: str
) -> NDArray[np.float64]:
    count = len(found.texts)
    check_size(f"'{key}'", width * count)
    values = np.empty((count, width))
    texts = iter(found.texts)
    for start in range(0, count, _AT_ONCE):
        matches = [grammar.fullmatch(text) for text in islice(texts, _AT_ONCE)]
        if None in matches:
            bad = start + matches.index(None)
            raise _bad_numbers(found.lines[bad], key, found.texts[bad].split(), rule)
        text = b" ".join([m[1] for m in matches if m])
        values[start : start + len(matches)] = floats(text).reshape(-1, width)
    return values


def _bad_numbers(line: int, key: str, tokens: list[bytes], rule: str) -> MeshError:
    for token in tokens:
        if not is_number(token):
            return MeshError(f"line {line}: {key} has {show(token)}: not a plain decimal number")
    return MeshError(f"line {line}: {key} has {plural(len(tokens), 'number')}: {rule}")


def _require_finite(found: _Statements, values: NDArray[np.floating], what: str) -> None:
    bad = first_bad_row(np.isfinite(values))
    if bad is not None:
        where = f"line {found.lines[bad]}: {what} {bad + 1}"
        raise MeshError(f"{where} is {values[bad].tolist()}: not finite as {values.dtype}")


def _references(found: _Statements) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(P,) corners of each polygon, and (C, 2) position and uv references as written."""
    if not found.texts:
        raise MeshError("the file has no faces")
    for line, text in zip(found.lines, found.texts, strict=True):
        if len(text) > _LONGEST_FACE:
            size = f"{len(text)} characters, at most {_LONGEST_FACE}"
            raise LimitError(f"line {line}: a face of {size}")
        if not _FACE.fullmatch(text):
            raise _bad_face(line, text.split())
    counts = np.fromiter((len(text.split()) for text in found.texts), np.int64, len(found.texts))
    corners = int(counts.sum())
    check_size("'f'", 3 * corners)
    joined = found.texts.joined()
    if joined.count(b"/") not in (corners, 2 * corners):  # normals on some corners only
        joined = _NORMAL.sub(rb"\1", joined)
    return counts, wholes(joined.replace(b"/", b" ")).reshape(corners, -1)[:, :2]


def _bad_face(line: int, tokens: list[bytes]) -> MeshError:
    if len(tokens) < 3:
        return MeshError(f"line {line}: face has {plural(len(tokens), 'corner')}: at least 3")
    corner, token = next((i, t) for i, t in enumerate(tokens, 1) if not re.fullmatch(_CORNER, t))
    where = f"line {line}: face corner {corner} {show(token)}"
    if _WITHOUT_UV.fullmatch(token):
        return MeshError(f"{where} has no texture coordinate: unwrap the mesh, and export its UV")
    return MeshError(f"{where} is not vertex/texture or vertex/texture/normal in whole numbers")


def _resolve(
    found: dict[bytes, _Statements], counts: NDArray[np.int64], references: NDArray[np.int64]
) -> NDArray[np.int64]:
    """(C, 2) indices from 0 on; a negative reference counts back from the line of its face."""
    faces = found[b"f"]
    indices = np.empty_like(references)
    for column, (key, what) in enumerate(((b"v", "vertex"), (b"vt", "texture coordinate"))):
        lines, written = found[key].lines, references[:, column]
        before = np.repeat(np.searchsorted(lines, faces.lines), counts)
        index = np.where(written < 0, written + before, written - 1)
        bad = first_bad_row((index >= 0) & (index < len(lines)))
        if bad is not None:
            known = f"{len(lines)} in the file, {before[bad]} before this line"
            raise MeshError(f"{_corner(faces, counts, bad)}: no such {what} ({known})")
        indices[:, column] = index
    return indices


def _corner(faces: _Statements, counts: NDArray[np.int64], corner: int) -> str:
    """The line, the face and the corner of an index in the flat list."""
    face = int(np.searchsorted(np.cumsum(counts), corner, side="right"))
    place = corner - int(counts[:face].sum())
    token = show(faces.texts[face].split()[place])
    return f"line {faces.lines[face]}: face corner {place + 1} {token}"


def split_statements(data: bytes) -> dict[bytes, _Statements]:
    """The statements `v`, `vt` and `f` of an OBJ file; raises MeshError naming the line of an
    unknown keyword."""
    found = {key: _Statements() for key in (b"v", b"vt", b"f")}
    # Not split at once, into an object for each line.
    for number, line in enumerate(io.BytesIO(_plain_text(data)), 1):
        parts = line.removesuffix(b"\n").split(None, 1)
        if not parts:
            continue
        statements = found.get(parts[0])
        if statements is not None:
            statements.lines.append(number)
            statements.texts.append(parts[1] if len(parts) > 1 else b"")
        elif parts[0] not in _PASSED_OVER:
            raise MeshError(f"line {number}: {show(parts[0])} is not a statement known here")
    return found


def _plain_text(data: bytes) -> bytes:
    """The text without comments and tabs; continued lines are joined at the first."""
    text = data.removeprefix(b"\xef\xbb\xbf").replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    text = text.replace(b"\t", b" ")
    if b"#" in text:
        text = re.sub(rb"#[^\n]*", b"", text)
    return _join_continued(text) if b"\\" in text else text


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


class _Texts:
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
class _Statements:
    """All statements of one keyword: the lines they stand on, and what follows the keyword."""

    lines: array[int] = field(default_factory=lambda: array("q"))
    texts: _Texts = field(default_factory=_Texts)
