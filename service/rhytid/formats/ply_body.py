"""The body of a PLY file: tables of numbers, and of lists of numbers."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.wording import plural
from rhytid.errors import MeshError
from rhytid.formats.limits import check_size
from rhytid.formats.ply_header import Element, Header, Property


@dataclass(frozen=True)
class Table:
    """An element: `numbers` (rows,) by name; `lists` as their lengths (rows,) and all items.

    Where an element has lists, its plain numbers are passed over.
    """

    element: Element
    numbers: dict[str, NDArray[Any]] = field(default_factory=dict)
    lists: dict[str, tuple[NDArray[np.int64], NDArray[Any]]] = field(default_factory=dict)


def read_tables(header: Header, data: bytes) -> dict[str, Table]:
    """All elements by name; MeshError where the body is shorter or longer than promised."""
    tables: dict[str, Table] = {}
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


def _numbers(element: Element, order: str, data: bytes, start: int) -> tuple[Table, int]:
    row = np.dtype([(p.name, order + p.dtype) for p in element.properties])
    end = start + element.rows * row.itemsize
    if end > len(data):
        held = (len(data) - start) // row.itemsize
        raise MeshError(
            f"element {element.name}: {plural(element.rows, 'row')} promised, {held} there"
        )
    if not row.itemsize:
        return Table(element), start
    check_size(f"element {element.name}", element.rows * len(element.properties))
    rows = np.frombuffer(data, row, element.rows, start)
    return Table(element, {p.name: rows[p.name] for p in element.properties}), end


def _lists(element: Element, order: str, data: bytes, start: int) -> tuple[Table, int]:
    columns = [_ListColumn(p, order) for p in element.properties]
    for row in range(element.rows):
        for column in columns:
            start = column.step(data, start)
            if start > len(data):
                where = f"element {element.name}, row {row} of {element.rows}"
                raise MeshError(f"{where}: the list {column.name} goes past the end of the file")
    lists = {c.name: c.collected(data) for c in columns if c.count}
    return Table(element, lists=lists), start


class _ListColumn:
    """Reads one property of a table with lists row by row, and records where its lists are."""

    def __init__(self, declared: Property, order: str) -> None:
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
