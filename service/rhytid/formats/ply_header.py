"""The header of a PLY file: which tables follow, and of which columns."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from rhytid.errors import MeshError
from rhytid.formats.decimals import show

_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"},
}
_BYTE_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
_END = re.compile(rb"^end_header[ \t]*\r?\n", re.MULTILINE)
_LONGEST = 1 << 20


@dataclass(frozen=True)
class Property:
    """A number of every row, or a list of them where `count` is the dtype of the list's length."""

    name: str
    dtype: str
    count: str | None = None


@dataclass
class Element:
    """A table of the file: `rows` rows of the same properties."""

    name: str
    rows: int
    properties: list[Property] = field(default_factory=list)


@dataclass(frozen=True)
class Header:
    """The tables in the order of the file; `order` is numpy's sign of the byte order."""

    text: bool
    order: str
    elements: list[Element]
    start: int


def read_header(data: bytes) -> Header:
    """The header of a PLY file; raises MeshError naming the line."""
    end = _END.search(data, 0, _LONGEST)
    if not data.startswith(b"ply") or end is None:
        raise MeshError("not a PLY file: it must begin with 'ply' and hold an end_header line")
    formats: list[str] = []
    elements: list[Element] = []
    for number, line in enumerate(data[: end.start()].splitlines(), 1):
        if not _read_line(line.decode("ascii", "backslashreplace").split(), formats, elements):
            raise MeshError(f"line {number}: {show(line)} is no header line, or out of place")
    if len(formats) != 1:
        raise MeshError(f"the PLY header has {len(formats)} format lines, not 1")
    _check_names("the PLY header", [element.name for element in elements])
    for element in elements:
        _check_names(f"element {element.name}", [p.name for p in element.properties])
    return Header(formats[0] == "ascii", _BYTE_ORDERS[formats[0]], elements, end.end())


def _read_line(words: list[str], formats: list[str], elements: list[Element]) -> bool:
    """Note what a header line says; whether it says anything."""
    match words:
        case ["ply"] | [] | ["comment" | "obj_info", *_]:
            pass
        case ["format", name, "1.0"] if name in _BYTE_ORDERS:
            formats.append(name)
        case ["element", name, rows] if rows.isdecimal() and len(rows) < 16:
            elements.append(Element(name, int(rows)))
        case ["property", "list", count, kind, name] if elements and {count, kind} <= set(_TYPES):
            elements[-1].properties.append(Property(name, _TYPES[kind], _TYPES[count]))
        case ["property", kind, name] if elements and kind in _TYPES:
            elements[-1].properties.append(Property(name, _TYPES[kind]))
        case _:
            return False
    return True


def _check_names(where: str, names: list[str]) -> None:
    for name in names:
        if names.count(name) > 1:
            raise MeshError(f"{where} declares {name!r} twice")
