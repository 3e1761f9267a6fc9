"""Expressions of a face, and where they fold its skin, so that lines can grow there."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rhytid.domain.mesh import ORIGIN, Centre, subtract_centre
from rhytid.domain.validation import fixed_array
from rhytid.errors import InputError, ShapesError

# Of more, this many evenly spaced ones are used: a captured take repeats itself.
MOST_EXPRESSIONS = 400
_LONGEST_NAME = 256
# Of the size of the mesh: no face is so small in every expression, and offsets are smaller.
_SMALLEST = 0.2
# What `graph.lines` can say.
AUTO, BY_EXPRESSIONS, LEVEL = LINES = ("auto", "expressions", "level")
# Expressions that move anything, from which on what they leave alone counts as never folding.
ENOUGH = 5
# The name under which the crests of a frown are stored.
_FROWN = "frown.sides"
# The same of the folds around the corners of the mouth.
_FANS = "mouth.corners"
# Places of xx, yy, zz, xy, xz, yz in a symmetric 3 x 3 matrix.
ROWS, COLUMNS = np.array([0, 1, 2, 0, 0, 1]), np.array([0, 1, 2, 1, 2, 2])
FloatArray = NDArray[np.float64]


def form(tensor: FloatArray, one: FloatArray, two: FloatArray) -> FloatArray:
    """(N,) oneᵀ · tensor · two, of tensors (N, 6) and vectors (N, 3)."""
    off = one[:, ROWS[3:]] * two[:, COLUMNS[3:]] + one[:, COLUMNS[3:]] * two[:, ROWS[3:]]
    found: FloatArray = (tensor * np.concatenate([one * two, off], axis=1)).sum(axis=1)
    return found


@dataclass(frozen=True, eq=False)
class Expressions:
    """Deformed positions of a mesh by name.

    positions: (E, V, 3) float32, less the centre of the mesh.  names: of the E expressions;
    captured frames have numbers for names.
    """

    positions: NDArray[np.float32]
    names: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.positions)

    @classmethod
    def checked(
        cls,
        positions: ArrayLike,
        vertices: int,
        names: Sequence[str] | None = None,
        centre: Centre = ORIGIN,
    ) -> Expressions:
        """At most MOST_EXPRESSIONS of the positions that were sent, evenly picked, with the first
        and the last.

        Raises ShapesError naming the shape, the names that do not fit, or the expression and the
        vertex that is not finite.
        """
        values = np.asarray(positions)
        if values.ndim != 3 or values.shape[1:] != (vertices, 3) or values.dtype.kind not in "fiu":
            shape = f"shape {values.shape} of {values.dtype}"
            raise ShapesError(f"shapes have {shape}, not numbers (E, {vertices}, 3)")
        chosen = evenly_spaced(len(values))
        known = [f"{i:04d}" for i in chosen]
        if names is not None:
            if len(names) != len(values):
                raise ShapesError(f"{len(names)} names for {len(values)} shapes")
            known = [str(names[i])[:_LONGEST_NAME] for i in chosen]
        kept = np.empty((len(chosen), vertices, 3), np.float32)
        with np.errstate(over="ignore"):
            for row, i in zip(kept, chosen, strict=True):
                row[:] = subtract_centre(values[i], centre)
        _check_finite(kept, known)
        kept.setflags(write=False)
        return cls(kept, tuple(known))

    def check_size(self, neutral: NDArray[np.floating]) -> None:
        """Raise ShapesError where all of them are far smaller than the mesh, as offsets from the
        neutral are.  neutral: (V, 3)."""
        least = _SMALLEST * _size(neutral)
        if len(self) and all(_size(shape) < least for shape in self.positions):
            raise ShapesError(
                f"no shape is {100 * _SMALLEST:g} % as large as the mesh: they must be positions "
                "of all vertices, not offsets from the neutral"
            )

    @property
    def named(self) -> bool:
        """Whether the expressions have names that a caller can ask for; frames have numbers."""
        return bool(self.names) and not all(name.isdigit() for name in self.names)

    def digest(self) -> bytes:
        """SHA-256 of the names and positions, the same on every machine."""
        found = hashlib.sha256("\0".join(self.names).encode())
        found.update(repr(self.positions.shape).encode())
        for shape in self.positions:
            found.update(np.ascontiguousarray(shape, "<f4").data)
        return found.digest()


def expressions_for_lines(lines: str | None, expressions: Expressions | None) -> Expressions | None:
    """The expressions that lines grow by, as `graph.lines` says; None for level lines.

    Raises InputError where it asks for expressions and there are none.
    """
    if expressions is not None and not len(expressions):
        expressions = None
    if lines == BY_EXPRESSIONS and expressions is None:
        raise InputError(
            'graph.lines is "expressions", and none came with the mesh: send shapes, or a mesh '
            "file that holds shapes, frames or morph targets"
        )
    return None if lines == LEVEL else expressions


def evenly_spaced(count: int) -> list[int]:
    """The indices of the expressions that are used of that many: evenly spaced."""
    if count <= MOST_EXPRESSIONS:
        return list(range(count))
    picked = np.linspace(0.0, count - 1.0, MOST_EXPRESSIONS)
    return [int(i) for i in np.rint(picked)]


def _size(positions: NDArray[np.floating]) -> float:
    """Root mean square distance from the mean."""
    return float(np.sqrt(positions.var(axis=0, dtype=np.float64).sum()))


def _check_finite(positions: NDArray[np.float32], names: Sequence[str]) -> None:
    for shape, name in zip(positions, names, strict=True):
        good = np.isfinite(shape).all(axis=1)
        if not good.all():
            vertex = int(np.argmin(good))
            where = f"shape {name}, vertex {vertex}"
            raise ShapesError(f"{where} is {shape[vertex].tolist()}: not finite as float32")


@dataclass(frozen=True, eq=False)
class Folds:
    """Where and which way expressions fold skin, at the vertices of a mesh.

    tensor: (V, 6) float32; xx, yy, zz, xy, xz, yz of the mean over all expressions of the squared
    log compression along its axes, in the space of the mesh, smoothed on the surface;
    dimensionless.  moving: how many expressions moved anything.  regions: (V,) float32, shares from
    0 to 1, by the name of the region.  frown: (V,) float32, how far vertices lie on one of the two
    crests of a frown, 0 to 1 on the left one and 0 to -1 on the right one; None where expressions
    do not show them.  fans: (V, 6) float32, as `tensor`, of an open jaw alone and less smoothed, as
    far as vertices lie beside a corner of the mouth; None where expressions do not show one.

    Raises InputError for arrays that do not fit or are not finite.
    """

    tensor: NDArray[np.float32]
    moving: int
    regions: Mapping[str, NDArray[np.float32]] = field(default_factory=dict)
    frown: NDArray[np.float32] | None = None
    fans: NDArray[np.float32] | None = None

    def __post_init__(self) -> None:
        tensor = fixed_array(self.tensor, "folds", (None, 6), np.float32, InputError)
        regions = {
            name: fixed_array(self.regions[name], name, (len(tensor),), np.float32, InputError)
            for name in sorted(self.regions)
        }
        shares = list(regions.values())
        if self.frown is not None:
            shares.append(fixed_array(self.frown, _FROWN, (len(tensor),), np.float32, InputError))
            object.__setattr__(self, "frown", shares[-1])
        if self.fans is not None:
            shape = (len(tensor), 6)
            shares.append(fixed_array(self.fans, _FANS, shape, np.float32, InputError))
            object.__setattr__(self, "fans", shares[-1])
        if not all(np.isfinite(array).all() for array in (tensor, *shares)):
            raise InputError("folds that are not finite")
        object.__setattr__(self, "tensor", tensor)
        object.__setattr__(self, "regions", regions)

    @property
    def known(self) -> float:
        """From 0 to 1: how surely a place that no expression folds never folds."""
        return min(self.moving / ENOUGH, 1.0)

    def axes(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Size, eccentricity and axis of the folding.

        size: (V,) largest root mean square log compression in any direction.  eccentricity: (V,)
        share by which it is smaller across that direction, 0 where both are alike.  axis: (V, 3)
        the direction.
        """
        return axes_of(self.tensor)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The arrays by name, in which `of_arrays` reads the same folds."""
        regions = {f"region.{name}": mask for name, mask in self.regions.items()}
        found = {"tensor": self.tensor, "moving": np.array([self.moving], np.int32), **regions}
        further = {_FROWN: self.frown, _FANS: self.fans}
        return found | {name: array for name, array in further.items() if array is not None}

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> Folds:
        """The inverse of `arrays`."""
        regions = {
            name.removeprefix("region."): mask
            for name, mask in arrays.items()
            if name.startswith("region.")
        }
        moving = int(arrays["moving"][0])
        return cls(arrays["tensor"], moving, regions, arrays.get(_FROWN), arrays.get(_FANS))


def axes_of(tensor: NDArray[np.float32]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """`Folds.axes` of a tensor (V, 6)."""
    full = np.empty((len(tensor), 3, 3))
    full[:, ROWS, COLUMNS] = full[:, COLUMNS, ROWS] = tensor
    values, vectors = np.linalg.eigh(full)
    roots = np.sqrt(np.maximum(values, 0.0))
    eccentricity = 1.0 - roots[:, 1] / np.maximum(roots[:, 2], 1e-12)
    return roots[:, 2], np.where(roots[:, 2] > 0, eccentricity, 0.0), vectors[:, :, 2]
