"""Polygons of a host as the arrays that the service takes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rhytid_client.hosts.trouble import Trouble, changed_count, no_uv

Floats = NDArray[np.float32]
Ints = NDArray[np.int32]
# positions (V, 3) and uv (T, 2), float32; faces and face_uv (F, 3), int32, rows of these.
MeshArrays = Mapping[str, NDArray[Any]]


def polygons(
    name: str,
    positions: ArrayLike,
    counts: ArrayLike,
    vertices: ArrayLike,
    uv: ArrayLike,
    uv_rows: ArrayLike,
    *,
    clockwise: bool = False,
) -> MeshArrays:
    """A mesh of polygons, cut as a fan from their first corner, as the service cuts those of files.

    name: for messages.  positions: (V, 3).  counts: (P,) corners of each polygon.  vertices,
    uv_rows: (C,) rows of positions and of uv (T, 2) at each corner, polygon by polygon.
    clockwise: corners run that way seen from outside, as in Houdini, and are turned round. Polygons
    of two corners or fewer are left out. Raises Trouble without faces or where corners have no UV.
    """
    sides, corners = np.asarray(counts, np.int64), np.asarray(vertices, np.int32)
    rows, coordinates = np.asarray(uv_rows, np.int32), np.asarray(uv, np.float32).reshape(-1, 2)
    if not len(coordinates) or len(rows) != len(corners) or (rows < 0).any():
        raise Trouble(no_uv(name))
    fan = _fan(sides)
    if not len(fan):
        raise Trouble(f"'{name}' has no faces")
    if clockwise:
        fan = fan[:, ::-1]
    return {
        "positions": np.asarray(positions, np.float32).reshape(-1, 3),
        "faces": corners[fan],
        "uv": coordinates,
        "face_uv": rows[fan],
    }


def _fan(sides: NDArray[np.int64]) -> NDArray[np.int64]:
    """(F, 3) corners of the triangles of polygons with so many sides each."""
    first = np.cumsum(sides) - sides
    each = np.maximum(sides - 2, 0)
    start = np.repeat(first, each)
    # 1, 2, … within each polygon.
    step = np.arange(each.sum()) - np.repeat(np.cumsum(each) - each, each) + 1
    return np.stack([start, start + step, start + step + 1], axis=1)


def welded(vertices: ArrayLike, uv: ArrayLike) -> tuple[Floats, Ints]:
    """UV of corners as uv (T, 2) and the row of each: corners at one vertex with one uv share it.

    vertices: (C,) of each corner.  uv: (C, 2).
    """
    values = np.ascontiguousarray(uv, np.float32).reshape(-1, 2)
    keys = np.column_stack([np.asarray(vertices, np.int32), values.view(np.int32)])
    _, first, row = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return values[first], row.reshape(-1).astype(np.int32)


def counted(name: str, positions: ArrayLike, sent: int, remedy: str) -> Floats:
    """Positions as (V, 3) float32; raises Trouble, with the remedy, where V is not `sent`."""
    now: NDArray[Any] = np.asarray(positions, np.float32).reshape(-1, 3)
    if len(now) != sent:
        raise Trouble(changed_count(name, sent, len(now)) + remedy)
    return now
