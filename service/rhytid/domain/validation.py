"""Checked, read-only arrays, which all domain types are made of."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rhytid.errors import InputError


def fixed_array(
    values: ArrayLike,
    what: str,
    shape: tuple[int | None, ...],
    dtype: Any,
    error: type[InputError],
) -> NDArray[Any]:
    """A read-only, C-contiguous, native copy of `values` of a dtype; or `values` without a copy,
    where they are that already and their memory is bytes, which nobody can change.

    `None` in `shape` stands for any length. Raises `error` naming `what` where the shape or the
    kind of number does not fit (float or integer for a float dtype, integer for an integer one).
    """
    array = np.asarray(values)
    fits = array.ndim == len(shape)
    if not fits or any(w not in (None, n) for n, w in zip(array.shape, shape, strict=True)):
        wanted = ", ".join("N" if n is None else str(n) for n in shape)
        raise error(f"{what} has shape {array.shape}, not ({wanted})")
    kinds = "fiu" if np.dtype(dtype).kind == "f" else "iu"
    if array.dtype.kind not in kinds and array.size:
        raise error(f"{what} has dtype {array.dtype}, not {np.dtype(dtype)}")
    if _on_bytes(array):
        fixed = np.require(array, dtype, ["C", "ALIGNED"])
    else:
        fixed = np.array(array, dtype=dtype, order="C", copy=True)
    fixed.setflags(write=False)
    return fixed


def _on_bytes(array: NDArray[Any]) -> bool:
    owner: object = array
    while isinstance(owner, np.ndarray):
        owner = owner.base
    return isinstance(owner, bytes)


def first_bad_row(good: NDArray[np.bool_]) -> int | None:
    """Index of the first row of `good` that is not all true, or None."""
    if good.all():  # by rows it takes many times as long, and frames are checked each time
        return None
    rows = good if good.ndim == 1 else good.all(axis=-1)
    return int(np.argmin(rows))
