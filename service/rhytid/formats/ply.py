"""PLY, ASCII and binary: texture coordinates per vertex as `u, v` or `s, t`, v up.

Read here rather than by trimesh, which renumbers vertices that carry texture coordinates, takes
text that holds other things than numbers and no binary file that mixes triangles with quads.

The file keeps one texture coordinate per vertex: a writer has split vertices along UV seams, and
they stay as they are. An ASCII body becomes an array of doubles and is then read as a binary one.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh
from rhytid.domain.validation import first_bad_row
from rhytid.domain.wording import plural
from rhytid.errors import MeshError
from rhytid.formats.decimals import is_number, show, strict_floats
from rhytid.formats.limits import check_size
from rhytid.formats.ply_body import Table, read_tables
from rhytid.formats.ply_header import Element, Header, Property, read_header
from rhytid.formats.polygons import fan

_UV_NAMES = (("u", "v"), ("s", "t"))
_CORNER_LISTS = ("vertex_indices", "vertex_index")


def read_ply(data: bytes) -> Mesh:
    """The triangle mesh of a PLY file; raises MeshError naming the element, or LimitError."""
    header = read_header(data)
    _check_elements(header)
    if header.text:
        header, data = _as_binary(header, data)
    tables = read_tables(header, data)
    vertices = tables["vertex"]
    positions = _columns(vertices, ("x", "y", "z"))
    uv = _columns(vertices, next(n for n in _UV_NAMES if set(n) <= set(vertices.numbers)))
    faces = _faces(tables["face"], len(positions))
    return Mesh.centred(positions, faces, uv, faces)


def _check_elements(header: Header) -> None:
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


def _as_binary(header: Header, data: bytes) -> tuple[Header, bytes]:
    """The same tables as a binary file of doubles, exact for every index that a mesh can hold."""
    body = data[header.start :]
    try:
        numbers = strict_floats(body)
    except ValueError as exc:
        raise _bad_number(data[: header.start].count(b"\n"), body) from exc
    elements = [
        Element(e.name, e.rows, [Property(p.name, "f8", p.count and "f8") for p in e.properties])
        for e in header.elements
    ]
    return replace(header, elements=elements, start=0), numbers.tobytes()


def _bad_number(before: int, body: bytes) -> MeshError:
    for number, line in enumerate(body.splitlines(), before + 1):
        for token in line.split():
            if not is_number(token):
                return MeshError(f"line {number}: {show(token)} is not a plain decimal number")
    return MeshError("the PLY body holds other characters than plain decimal numbers")


def _columns(table: Table, names: tuple[str, ...]) -> NDArray[np.float64]:
    return np.stack([table.numbers[name].astype(np.float64) for name in names], axis=1)


def _faces(table: Table, vertices: int) -> NDArray[np.int32]:
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
