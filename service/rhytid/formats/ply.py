"""PLY, ASCII and binary: texture coordinates per vertex as `u, v` or `s, t`, v up.

Read here rather than by trimesh, which renumbers vertices that carry texture coordinates, takes
text that holds other things than numbers and no binary file that mixes triangles with quads.

The file keeps one texture coordinate per vertex: a writer has split vertices along UV seams, and
they stay as they are. An ASCII body becomes an array of doubles and is then read as a binary one.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh
from rhytid.domain.validation import first_bad_row
from rhytid.domain.wording import plural
from rhytid.errors import MeshError
from rhytid.formats.decimals import is_number, show, strict_floats
from rhytid.formats.limits import check_size
from rhytid.formats.polygons import fan

_UV_NAMES = (("u", "v"), ("s", "t"))
_CORNER_LISTS = ("vertex_indices", "vertex_index")
_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"},
}
_BYTE_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
_END = re.compile(rb"^end_header[ \t]*\r?\n", re.MULTILINE)
_LONGEST_HEADER = 1 << 20


def read_ply(data: bytes) -> Mesh:
    """The triangle mesh of a PLY file; raises MeshError naming the element, or LimitError."""
    header = _read_header(data)
    _check_elements(header)
    if header.text:
        header, data = _as_binary(header, data)
    tables = _read_tables(header, data)
    vertices = tables["vertex"]
    positions = _columns(vertices, ("x", "y", "z"))
    uv = _columns(vertices, next(n for n in _UV_NAMES if set(n) <= set(vertices.numbers)))
    faces = _faces(tables["face"], len(positions))
    return Mesh.centred(positions, faces, uv, faces)


def _check_elements(header: _Header) -> None:
    """Refuse a file without what a mesh needs, before its body is read."""
    names = {e.name: {p.name for p in e.properties if not p.count} for e in header.elements}
    lists = {e.name: {p.name for p in e.properties if p.count} for e in header.elements}
    for name in ("vertex", "face"):
        if name not in names:
            raise MeshError(f"the PLY file has no element {name!r}")
    if lists["vertex"] or not {"x", "y", "z"} <= names["vertex"]:
        raise MeshError("element vertex must hold the numbers x, y, z and no lists")
    if not any(set(pair) <= names["vertex"] for pair in _UV_NAMES):
        raise MeshError(
            "element vertex has no texture coordinates: u and v, or s and t; unwrap the mesh, and "
            "export its UV"
        )
    if not lists["face"] & set(_CORNER_LISTS):
        raise MeshError("element face has no list vertex_indices or vertex_index")


def _as_binary(header: _Header, data: bytes) -> tuple[_Header, bytes]:
    """The same tables as a binary file of doubles, exact for every index that a mesh can hold."""
    body = data[header.start :]
    try:
        numbers = strict_floats(body)
    except ValueError as exc:
        raise _bad_number(data[: header.start].count(b"\n"), body) from exc
    elements = [
        _Element(e.name, e.rows, [_Property(p.name, "f8", p.count and "f8") for p in e.properties])
        for e in header.elements
    ]
    return replace(header, elements=elements, start=0), numbers.tobytes()


def _bad_number(before: int, body: bytes) -> MeshError:
    for number, line in enumerate(body.splitlines(), before + 1):
        for token in line.split():
            if not is_number(token):
                return MeshError(f"line {number}: {show(token)} is not a plain decimal number")
    return MeshError("the PLY body holds other characters than plain decimal numbers")


def _columns(table: _Table, names: tuple[str, ...]) -> NDArray[np.float64]:
    return np.stack([table.numbers[name].astype(np.float64) for name in names], axis=1)


def _faces(table: _Table, vertices: int) -> NDArray[np.int32]:
    counts, items = next(table.lists[name] for name in _CORNER_LISTS if name in table.lists)
    few = first_bad_row(counts >= 3)
    if few is not None:
        raise MeshError(f"face {few} has {plural(int(counts[few]), 'corner')}: at least 3")
    check_size("element face", 3 * len(items))
    bad = first_bad_row((items >= 0) & (items < vertices) & (items % 1 == 0))
    if bad is not None:
        face = int(np.searchsorted(np.cumsum(counts), bad, side="right"))
        corner = bad - int(counts[:face].sum()) + 1
        raise MeshError(f"face {face} corner {corner}: no vertex {items[bad]:g} of {vertices}")
    return items.astype(np.int32)[fan(counts)]


@dataclass(frozen=True)
class _Property:
    """A number of every row, or a list of them where `count` is the dtype of the list's length."""

    name: str
    dtype: str
    count: str | None = None


@dataclass
class _Element:
    """A table of the file: `rows` rows of the same properties."""

    name: str
    rows: int
    properties: list[_Property] = field(default_factory=list)


@dataclass(frozen=True)
class _Header:
    """The tables in the order of the file; `order` is numpy's sign of the byte order."""

    text: bool
    order: str
    elements: list[_Element]
    start: int


def _read_header(data: bytes) -> _Header:
    """The header of a PLY file; raises MeshError naming the line."""
    end = _END.search(data, 0, _LONGEST_HEADER)
    if not data.startswith(b"ply") or end is None:
        raise MeshError("not a PLY file: it must begin with 'ply' and hold an end_header line")
    formats: list[str] = []
    elements: list[_Element] = []
    for number, line in enumerate(data[: end.start()].splitlines(), 1):
        if not _read_line(line.decode("ascii", "backslashreplace").split(), formats, elements):
            raise MeshError(f"line {number}: {show(line)} is no header line, or out of place")
    if len(formats) != 1:
        raise MeshError(f"the PLY header has {len(formats)} format lines, not 1")
    _check_names("the PLY header", [element.name for element in elements])
    for element in elements:
        _check_names(f"element {element.name}", [p.name for p in element.properties])
    return _Header(formats[0] == "ascii", _BYTE_ORDERS[formats[0]], elements, end.end())


def _read_line(words: list[str], formats: list[str], elements: list[_Element]) -> bool:
    """Note what a header line says; whether it says anything."""
    match words:
        case ["ply"] | [] | ["comment" | "obj_info", *_]:
            pass
        case ["format", name, "1.0"] if name in _BYTE_ORDERS:
            formats.append(name)
        case ["element", name, rows] if rows.isdecimal() and len(rows) < 16:
            elements.append(_Element(name, int(rows)))
        case ["property", "list", count, kind, name] if elements and {count, kind} <= set(_TYPES):
            elements[-1].properties.append(_Property(name, _TYPES[kind], _TYPES[count]))
        case ["property", kind, name] if elements and kind in _TYPES:
            elements[-1].properties.append(_Property(name, _TYPES[kind]))
        case _:
            return False
    return True


def _check_names(where: str, names: list[str]) -> None:
    for name in names:
        if names.count(name) > 1:
            raise MeshError(f"{where} declares {name!r} twice")


@dataclass(frozen=True)
class _Table:
    """An element: `numbers` (rows,) by name; `lists` as their lengths (rows,) and all items.

    Where an element has lists, its plain numbers are passed over.
    """

    element: _Element
    numbers: dict[str, NDArray[Any]] = field(default_factory=dict)
    lists: dict[str, tuple[NDArray[np.int64], NDArray[Any]]] = field(default_factory=dict)


def _read_tables(header: _Header, data: bytes) -> dict[str, _Table]:
    """All elements by name; MeshError where the body is shorter or longer than promised."""
    tables: dict[str, _Table] = {}
    start = header.start
    for element in header.elements:
        if any(p.count for p in element.properties):
            table, start = _lists(element, header.order, data, start)
        else:
            table, start = _numbers(element, header.order, data, start)
        tables[element.name] = table
    if start != len(data):
        raise MeshError("the PLY body is longer than its header says")
    return tables


def _numbers(element: _Element, order: str, data: bytes, start: int) -> tuple[_Table, int]:
    row = np.dtype([(p.name, order + p.dtype) for p in element.properties])
    end = start + element.rows * row.itemsize
    if end > len(data):
        held = (len(data) - start) // row.itemsize
        raise MeshError(
            f"element {element.name}: {plural(element.rows, 'row')} promised, {held} there"
        )
    if not row.itemsize:
        return _Table(element), start
    check_size(f"element {element.name}", element.rows * len(element.properties))
    rows = np.frombuffer(data, row, element.rows, start)
    return _Table(element, {p.name: rows[p.name] for p in element.properties}), end


def _lists(element: _Element, order: str, data: bytes, start: int) -> tuple[_Table, int]:
    columns = [_ListColumn(p, order) for p in element.properties]
    for row in range(element.rows):
        for column in columns:
            start = column.step(data, start)
            if start > len(data):
                where = f"element {element.name}, row {row} of {element.rows}"
                raise MeshError(f"{where}: the list {column.name} goes past the end of the file")
    lists = {c.name: c.collected(data) for c in columns if c.count}
    return _Table(element, lists=lists), start


class _ListColumn:
    """Reads one property of a table with lists row by row, and records where its lists are."""

    def __init__(self, declared: _Property, order: str) -> None:
        self.name = declared.name
        self.count = declared.count and struct.Struct(order + np.dtype(declared.count).char)
        self._dtype = np.dtype(order + declared.dtype)
        self._spans: list[tuple[int, int]] = []

    def step(self, data: bytes, start: int) -> int:
        """The place after the value that begins at `start`; beyond the end where it is cut."""
        if not self.count:
            return start + self._dtype.itemsize
        begin = start + self.count.size
        if begin > len(data):
            return begin
        (length,) = self.count.unpack_from(data, start)
        if not (0 <= length <= len(data) and length % 1 == 0):
            raise MeshError(f"list {self.name} {len(self._spans)} has length {length}")
        end = begin + int(length) * self._dtype.itemsize
        self._spans.append((begin, end))
        return end

    def collected(self, data: bytes) -> tuple[NDArray[np.int64], NDArray[Any]]:
        """The lengths of the lists, and the items of all."""
        begin, end = np.array(self._spans, np.int64).reshape(-1, 2).T
        items = b"".join([data[b:e] for b, e in self._spans])
        return (end - begin) // self._dtype.itemsize, np.frombuffer(items, self._dtype)
