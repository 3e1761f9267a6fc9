"""Expressions of a face: what it does again and again, so that lines can grow where it folds."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rhytid.domain.origin import ORIGIN, Centre, brought_to
from rhytid.errors import FrameError, InputError

# Of more, this many evenly spaced ones are used: a captured take repeats itself.
MOST_EXPRESSIONS = 400
_LONGEST_NAME = 256
# What `graph.lines` can say.
AUTO, BY_EXPRESSIONS, LEVEL = LINES = ("auto", "expressions", "level")


@dataclass(frozen=True, eq=False)
class Expressions:
    """Positions of the deformed mesh, (E, V, 3) float32 less the centre of the mesh, and their
    names; captured frames, which have none, are named by their numbers."""

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
        """At most MOST_EXPRESSIONS of what was sent, evenly picked, first and last among them.

        Raises FrameError naming the shape, the names that do not fit, or the expression and the
        vertex that is not finite.
        """
        values = np.asarray(positions)
        if values.ndim != 3 or values.shape[1:] != (vertices, 3) or values.dtype.kind not in "fiu":
            shape = f"shape {values.shape} of {values.dtype}"
            raise FrameError(f"shapes have {shape}, not numbers (E, {vertices}, 3)")
        chosen = evenly(len(values))
        known = [f"{i:04d}" for i in chosen]
        if names is not None:
            if len(names) != len(values):
                raise FrameError(f"{len(names)} names for {len(values)} shapes")
            known = [str(names[i])[:_LONGEST_NAME] for i in chosen]
        kept = np.empty((len(chosen), vertices, 3), np.float32)
        with np.errstate(over="ignore"):
            for row, i in zip(kept, chosen, strict=True):
                row[:] = brought_to(values[i], centre)
        _check_finite(kept, known)
        kept.setflags(write=False)
        return cls(kept, tuple(known))

    @property
    def named(self) -> bool:
        """Whether somebody named them, so that they can be asked for; frames have numbers."""
        return bool(self.names) and not all(name.isdigit() for name in self.names)

    def digest(self) -> bytes:
        """Of names and positions, the same on every machine."""
        found = hashlib.sha256("\0".join(self.names).encode())
        found.update(repr(self.positions.shape).encode())
        for shape in self.positions:
            found.update(np.ascontiguousarray(shape, "<f4").data)
        return found.digest()


def grown_from(lines: str | None, expressions: Expressions | None) -> Expressions | None:
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


def evenly(count: int) -> list[int]:
    """Which of that many expressions are used."""
    if count <= MOST_EXPRESSIONS:
        return list(range(count))
    picked = np.linspace(0.0, count - 1.0, MOST_EXPRESSIONS)
    return [int(i) for i in np.rint(picked)]


def _check_finite(positions: NDArray[np.float32], names: Sequence[str]) -> None:
    for shape, name in zip(positions, names, strict=True):
        good = np.isfinite(shape).all(axis=1)
        if not good.all():
            vertex = int(np.argmin(good))
            where = f"shape {name}, vertex {vertex}"
            raise FrameError(f"{where} is {shape[vertex].tolist()}: not finite")
