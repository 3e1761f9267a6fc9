"""The neutral mesh: positions, triangles and their texture coordinates.

Positions far from the origin are coarse in float32. Stretch does not depend on where a face stands,
so doubles there are moved to the origin before they are rounded; what was rounded before stays
rounded.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.validation import first_bad_row, fixed_array
from rhytid.domain.wording import plural
from rhytid.errors import MeshError

UV_LIMIT = 100.0
# A triangle whose area is below this share of its longest edge squared has no usable stretch.
DEGENERATE_AREA = 1e-7
# Triangles whose areas are computed at a time.
_AT_ONCE = 1 << 16
# A mesh this many times its own size away from the origin is brought there: it has lost 4 of the
# 24 bits of a float32, and keeps 20. Nearer ones stay as they are, bit for bit.
FAR_SIZES = 16.0
# Mean distance of numbers from the nearest float32, in steps: 0.25 where they are doubles, 0 where
# they were float32 once. Decimal text of float32 comes within a few hundredths.
_ROUNDED = 0.05
Centre = NDArray[np.float64]
ORIGIN: Centre = np.zeros(3)
ORIGIN.setflags(write=False)


class _Kept:
    """What was found of a mesh, kept beside its arrays and no part of it."""

    __slots__ = ("_usable", "_with_uv")
    _usable: NDArray[np.bool_]
    _with_uv: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Mesh(_Kept):
    """A triangle mesh whose texture coordinates have indices of their own.

    positions: (V, 3) float32, in the length unit of the mesh, in the order of the file.
    faces: (F, 3) int32, indices into positions.
    uv: (T, 2) float64, v up. Double, because a float32 at u = 9 is 1/64 texel at 16k.
    face_uv: (F, 3) int32, indices into uv.
    centre: (3,) float64, subtracted from the positions as they were sent.

    A vertex on a UV seam is one position with several uv. The arrays are read-only copies.
    Raises MeshError naming the first element that cannot be used.
    """

    positions: NDArray[np.float32]
    faces: NDArray[np.int32]
    uv: NDArray[np.float64]
    face_uv: NDArray[np.int32]
    centre: Centre = field(default_factory=lambda: ORIGIN)

    @classmethod
    def centred(cls, positions: Any, faces: Any, uv: Any, face_uv: Any) -> Mesh:
        """A mesh of positions as a file has them.

        Doubles far from the origin are moved there before they are rounded to float32. Subtract the
        `centre` from frames of the mesh, too.
        """
        values = np.asarray(positions)
        if values.ndim != 2 or values.shape[1:] != (3,) or values.dtype.kind != "f":
            return cls(positions, faces, uv, face_uv)
        centre = centre_for(values)
        return cls(subtract_centre(values, centre), faces, uv, face_uv, centre)

    def __post_init__(self) -> None:
        object.__setattr__(self, "positions", _finite(self.positions, "positions", 3, np.float32))
        object.__setattr__(self, "uv", _finite(self.uv, "uv", 2, np.float64))
        faces = _indices(self.faces, "faces", len(self.positions))
        object.__setattr__(self, "faces", faces)
        object.__setattr__(self, "face_uv", _indices(self.face_uv, "face_uv", len(self.uv)))
        centre = fixed_array(self.centre, "centre", (3,), np.float64, MeshError)
        object.__setattr__(self, "centre", centre)
        self._check()

    def same(self, other: Mesh) -> bool:
        """Whether all arrays are equal."""
        names = [one.name for one in fields(self)]
        return all(np.array_equal(getattr(self, n), getattr(other, n)) for n in names)

    def _check(self) -> None:
        if len(self.faces) != len(self.face_uv):
            faces, rows = plural(len(self.faces), "face"), plural(len(self.face_uv), "row")
            raise MeshError(f"{faces} but {rows} of face_uv")
        far = first_bad_row(np.abs(self.uv) <= UV_LIMIT)
        if far is not None:
            raise MeshError(f"uv {far} is {self.uv[far].tolist()}: beyond ±{UV_LIMIT:g}")
        if not np.isfinite(self.centre).all():
            raise MeshError(f"centre is {self.centre.tolist()}: not finite")
        if not self.usable_triangles().any():
            raise MeshError("no triangle has area both in space and in UV")

    def __getstate__(self) -> dict[str, Any]:
        """The arrays, without what was found of them: processes send meshes to each other."""
        return {one.name: getattr(self, one.name) for one in fields(self)}

    def usable_triangles(self) -> NDArray[np.bool_]:
        """(F,) true where a triangle has area both in space and in UV; read-only."""
        if not hasattr(self, "_usable"):
            usable = self.triangles_with_uv().copy()
            for part in in_parts(len(usable)):
                usable[part] &= has_area(self.positions[self.faces[part]].astype(np.float64))
            usable.setflags(write=False)
            object.__setattr__(self, "_usable", usable)
        return self._usable

    def triangles_with_uv(self) -> NDArray[np.bool_]:
        """(F,) true where a triangle has area in UV, whatever it has in space; read-only."""
        if not hasattr(self, "_with_uv"):
            found = np.empty(len(self.face_uv), np.bool_)
            for part in in_parts(len(found)):
                found[part] = has_area(self.uv[self.face_uv[part]])
            found.setflags(write=False)
            object.__setattr__(self, "_with_uv", found)
        return self._with_uv

    def triangle_uv(self) -> NDArray[np.float64]:
        """(F, 3, 2) texture coordinates of the corners."""
        corners: NDArray[np.float64] = self.uv[self.face_uv]
        return corners


def has_area(corners: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(F,) true where a triangle, corners (F, 3, 2) or (F, 3, 3), has a usable area."""
    a, b, c = (corners[:, i] for i in range(3))
    longest = np.maximum.reduce([np.sum(e * e, -1) for e in (b - a, c - b, a - c)])
    u, w = b - a, c - a
    if corners.shape[-1] == 2:
        area = 0.5 * np.abs(u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0])
    else:
        area = 0.5 * np.linalg.norm(np.cross(u, w), axis=-1)
    result: NDArray[np.bool_] = (area >= DEGENERATE_AREA * longest) & (longest > 0)
    return result


def boxes(corners: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(N, 2) the least and the most of corners (N, 3, 2): a fifth of the time of `min` and `max`
    along an axis of three."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)


def in_parts(count: int) -> Iterator[slice]:
    """Ranges that together cover `count` triangles, for work that takes 0.5 KB or more for each."""
    return (slice(start, start + _AT_ONCE) for start in range(0, count, _AT_ONCE))


def centre_for(positions: NDArray[np.floating]) -> Centre:
    """(3,) the centre to subtract from positions (V, 3) before they become float32: the middle of
    their box, rounded to a power of two; 0 where they are near the origin, or float32 already."""
    values = np.asarray(positions)
    if not len(values) or not np.isfinite(values).all() or values.dtype.itemsize <= 4:
        return ORIGIN
    low, high = values.min(axis=0).astype(np.float64), values.max(axis=0).astype(np.float64)
    size = float((high - low).max())
    farthest = float(np.maximum(np.abs(low), np.abs(high)).max())
    if not 0.0 < FAR_SIZES * size < farthest < np.finfo(np.float32).max:
        return ORIGIN
    if was_float32(values):
        return ORIGIN
    # A multiple of a power of two: subtracting it from a float32 is exact.
    step = 2.0 ** np.floor(np.log2(size))
    centre: Centre = np.round((low + high) / 2.0 / step) * step
    return centre


def was_float32(values: NDArray[np.floating]) -> bool:
    """Whether doubles were float32 once: no more than their last digits differ from it."""
    near = values.astype(np.float32)
    gaps = np.abs(values - near.astype(np.float64)) / np.spacing(np.abs(near)).astype(np.float64)
    return bool(gaps.mean() < _ROUNDED)


def subtract_centre(values: NDArray[np.floating], centre: Centre) -> NDArray[np.floating]:
    """Positions (…, 3) less a centre, in double; the positions themselves where it is 0."""
    return values.astype(np.float64) - centre if centre.any() else values


def add_centre(positions: NDArray[np.floating], centre: Centre) -> NDArray[np.floating]:
    """The inverse of `subtract_centre`: double where the centre is not 0."""
    return positions.astype(np.float64) + centre if centre.any() else positions


def float_step(positions: NDArray[np.float32], centre: Centre) -> float:
    """The step between neighbouring numbers in which positions (V, 3) were sent.

    positions: less `centre`. The step is that of float32 at the farthest coordinate as it was sent;
    where positions were sent as doubles with a centre, at the farthest coordinate without it.
    """
    if centre.any():
        sent = positions + centre
        if was_float32(sent):
            return float(np.spacing(np.float32(np.abs(sent).max(initial=0.0))))
    farthest = max(float(positions.max(initial=0.0)), -float(positions.min(initial=0.0)))
    return float(np.spacing(np.float32(farthest)))


def _finite(values: Any, what: str, width: int, dtype: type[np.floating[Any]]) -> NDArray[Any]:
    with np.errstate(over="ignore"):
        array = fixed_array(values, what, (None, width), dtype, MeshError)
    bad = first_bad_row(np.isfinite(array))
    if bad is not None:
        one = what.removesuffix("s")
        raise MeshError(f"{one} {bad} is {array[bad].tolist()}: not finite as {array.dtype}")
    return array


def _indices(values: Any, what: str, count: int) -> NDArray[np.int32]:
    wide = fixed_array(values, what, (None, 3), np.int64, MeshError)
    bad = first_bad_row((wide >= 0) & (wide < count))
    if bad is not None:
        raise MeshError(f"{what} {bad} is {wide[bad].tolist()}: indices go from 0 to {count - 1}")
    return fixed_array(wide, what, (None, 3), np.int32, MeshError)
