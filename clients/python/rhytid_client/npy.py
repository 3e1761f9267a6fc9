"""numpy's own file formats, to and from bytes, without pickles."""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.lib import format as npy_format
from numpy.typing import ArrayLike, NDArray

from rhytid_client.errors import BadAnswer

# The longest header that numpy itself reads, and the bytes before it.
_LONGEST_HEAD = 10_000 + 16


def encode(array: NDArray[Any]) -> bytes:
    """The array as a .npy file."""
    file = io.BytesIO()
    np.save(file, array, allow_pickle=False)
    return file.getvalue()


def decode(data: bytes | memoryview) -> NDArray[Any]:
    """The array of a .npy file, a read-only view of `data`; raises BadAnswer."""
    head = io.BytesIO(bytes(data[:_LONGEST_HEAD]))
    try:
        shape, fortran, dtype = _header(head)
        size = math.prod(shape) * dtype.itemsize
        if dtype.hasobject or len(data) != head.tell() + size:
            raise ValueError(f"{len(data)} bytes do not hold {dtype} {shape}")
        flat = np.frombuffer(data, dtype, math.prod(shape), head.tell())
        return flat.reshape(shape, order="F" if fortran else "C")
    except ValueError as exc:
        raise BadAnswer(f"not a .npy file: {exc}") from exc


def _header(file: io.BytesIO) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    if npy_format.read_magic(file) == (1, 0):
        return npy_format.read_array_header_1_0(file)
    return npy_format.read_array_header_2_0(file)


def pack(arrays: Mapping[str, ArrayLike]) -> memoryview:
    """The arrays as an uncompressed .npz file; no second copy of it is made."""
    file = io.BytesIO()
    members: dict[str, Any] = {name: np.asarray(array) for name, array in arrays.items()}
    np.savez(file, **members)
    return file.getbuffer()


def unpack(data: bytes, *names: str) -> list[NDArray[Any]]:
    """The named arrays of a .npz file; raises BadAnswer where one is missing or damaged."""
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            return [arrays[name] for name in names]
    except (ValueError, KeyError, TypeError, OSError, EOFError, zipfile.BadZipFile) as exc:
        raise BadAnswer(f"not a .npz file with {', '.join(names)}: {exc}") from exc
