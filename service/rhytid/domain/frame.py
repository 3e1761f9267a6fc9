"""A frame: a name and the positions of the deformed mesh."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rhytid.domain.mesh import ORIGIN, Centre, subtract_centre
from rhytid.domain.validation import first_bad_row, fixed_array
from rhytid.domain.wording import plural
from rhytid.errors import FrameError

NEUTRAL = "neutral"
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}", re.ASCII)


def check_frame_name(name: str) -> str:
    """Return a frame's name; raise FrameError where the API does not allow it."""
    if not _NAME.fullmatch(name):
        rule = "an ASCII letter or digit, then up to 63 of these, '_', '.' or '-'"
        raise FrameError(f"frame name {name!r}: use {rule}")
    return name


def check_positions(
    values: ArrayLike, vertices: int, centre: Centre = ORIGIN, what: str = "frame"
) -> NDArray[np.float32]:
    """Frame positions as (V, 3) float32, less the centre of their mesh, read-only.

    what: words for them in errors. Raises FrameError naming the count or the first vertex that is
    not finite.
    """
    shape = np.shape(values)
    if len(shape) != 2 or shape[1] != 3:
        raise FrameError(f"{what} has shape {shape}, not ({vertices}, 3)")
    if shape[0] != vertices:
        raise FrameError(
            f"{what} has {plural(shape[0], 'vertex', 'vertices')}, the neutral mesh has {vertices}"
        )
    if centre.any() and np.asarray(values).dtype.kind in "fiu":
        values = subtract_centre(np.asarray(values), centre)
    with np.errstate(over="ignore"):
        array: NDArray[Any] = fixed_array(values, what, (vertices, 3), np.float32, FrameError)
    bad = first_bad_row(np.isfinite(array))
    if bad is not None:
        raise FrameError(f"{what} vertex {bad} is {array[bad].tolist()}: not finite as float32")
    return array


def frame_label(number: int) -> str:
    """The name of the frame of this number: at least four digits."""
    return f"{number:04d}"


def counted_frame(index: int) -> str:
    """The name of a frame by its place in a file that does not number them: 0001 for the first."""
    return frame_label(index + 1)
