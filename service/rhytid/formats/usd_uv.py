"""Texture coordinates of a USD mesh: the primvar `st`, or the only one that could be."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.wording import plural
from rhytid.errors import MeshError
from rhytid.formats.limits import check_size
from rhytid.formats.usd_stage import usd_modules

_TYPES = ("texCoord2f[]", "texCoord2h[]", "texCoord2d[]", "float2[]", "half2[]", "double2[]")
_BY_CORNER, _BY_VERTEX = ("faceVarying",), ("vertex", "varying")


def read_uv(
    mesh: Any, corners: NDArray[np.int64], vertices: int
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """(T, 2) texture coordinates and (C,) which of them each corner has.

    corners: (C,) the vertex of each. Values that are not indexed are shared by the corners of one
    vertex that have the same, so that charts hang together. Raises MeshError naming the primvar.
    """
    primvar = _chosen(mesh)
    name, interpolation = str(primvar.GetPrimvarName()), str(primvar.GetInterpolation())
    time = usd_modules()[0].TimeCode.EarliestTime()
    values = primvar.Get(time)
    uv = np.array([] if values is None else values, np.float64).reshape(-1, 2)
    check_size(f"primvar {name}", 2 * len(uv))
    if interpolation not in _BY_CORNER + _BY_VERTEX:
        raise MeshError(f"primvar {name} is {interpolation}: must be faceVarying or vertex")
    rows = len(corners) if interpolation in _BY_CORNER else vertices
    places = _places(primvar, time, name, len(uv), rows)
    if interpolation in _BY_VERTEX:
        return uv, places[corners]
    return (uv, places) if primvar.IsIndexed() else _shared(uv, corners)


def _chosen(mesh: Any) -> Any:
    api = usd_modules()[1].PrimvarsAPI(mesh.GetPrim())
    fit = {
        str(primvar.GetPrimvarName()): primvar
        for primvar in api.FindPrimvarsWithInheritance()
        if primvar.HasValue() and str(primvar.GetTypeName()) in _TYPES
    }
    if "st" in fit:
        return fit["st"]
    if len(fit) == 1:
        return next(iter(fit.values()))
    listed = ", ".join(sorted(fit)) or "none"
    raise MeshError(f"no primvar st of texture coordinates; pairs of numbers there: {listed}")


def _places(primvar: Any, time: Any, name: str, values: int, rows: int) -> NDArray[np.int64]:
    """(rows,) which value each corner or vertex has."""
    if not primvar.IsIndexed():
        if values != rows:
            raise MeshError(f"primvar {name} has {plural(values, 'value')}, not {rows}")
        return np.arange(rows)
    places = np.array(primvar.GetIndices(time), np.int64)
    if len(places) != rows:
        raise MeshError(f"primvar {name} has {plural(len(places), 'index', 'indices')}, not {rows}")
    wrong = (places < 0) | (places >= values)
    if wrong.any():
        bad = int(np.argmax(wrong))
        raise MeshError(f"primvar {name}, index {bad}: no value {places[bad]} of {values}")
    return places


def _shared(
    uv: NDArray[np.float64], corners: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """The values that differ at a vertex, by vertex, and which of them each corner has."""
    rows = np.column_stack([corners, uv])
    _, first, places = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    return uv[first], places.reshape(-1)
