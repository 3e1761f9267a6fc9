"""NumPy's .npy arrays, their headers checked before anything is allocated.

numpy's own reader allocates what a header asks for, runs pickles when told to, and warns about
headers that it cannot quite read. Here a header says how many bytes must follow, or it is refused.
"""

from __future__ import annotations

import ast
import math
import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.errors import InputError

_MAGIC = b"\x93NUMPY"
_DTYPE = re.compile(r"[<>=|]?[fiu](?:1|2|4|8|16)", re.ASCII)
_TEXT = re.compile(r"[<>=|]?U[0-9]{1,4}", re.ASCII)
_KINDS = {
    "O": "Python objects (a pickle)",
    "S": "text",
    "U": "text",
    "c": "complex numbers",
    "b": "truth values",
    "V": "records",
    "M": "dates",
    "m": "time spans",
}
# No header of a plain array comes near this; more need not be read to judge one.
MAX_HEADER = 10_000


@dataclass(frozen=True)
class NpyHeader:
    """What a .npy header promises. `start`: bytes before the data; `stored`: bytes of data."""

    dtype: np.dtype[Any]
    shape: tuple[int, ...]
    fortran_order: bool
    start: int

    @property
    def numbers(self) -> int:
        """How many numbers follow."""
        return math.prod(self.shape)

    @property
    def stored(self) -> int:
        """How many bytes follow."""
        return self.numbers * self.dtype.itemsize

    def array(self, data: bytes | bytearray) -> NDArray[Any]:
        """The array of the whole .npy file `data`, whose length has been checked."""
        flat = np.frombuffer(data, self.dtype, self.numbers, self.start)
        return flat.reshape(self.shape, order="F" if self.fortran_order else "C")


def read_header(
    data: bytes, what: str, error: type[InputError], *, names: bool = False
) -> NpyHeader:
    """The header at the start of `data`; `error` naming `what` where it is not one of real numbers,
    or of text where `names` are read.

    The first MAX_HEADER bytes of a file are enough.
    """
    text, start = _header_text(data, what, error)
    try:
        fields = ast.literal_eval(text.strip())
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError) as exc:
        raise error(f"{what}: the .npy header cannot be read") from exc
    if not isinstance(fields, dict) or set(fields) != {"descr", "fortran_order", "shape"}:
        raise error(f"{what}: the .npy header must hold descr, fortran_order and shape")
    dtype = _text(fields["descr"], what, error) if names else _dtype(fields["descr"], what, error)
    shape, fortran_order = fields["shape"], fields["fortran_order"]
    if not isinstance(shape, tuple) or len(shape) > 4 or not all(map(_is_length, shape)):
        raise error(f"{what}: the .npy header has shape {shape!r:.80}")
    if type(fortran_order) is not bool:
        raise error(f"{what}: the .npy header has fortran_order {fortran_order!r:.80}")
    return NpyHeader(dtype, shape, fortran_order, start)


def _is_length(value: object) -> bool:
    return type(value) is int and 0 <= value < 1 << 40


def _header_text(data: bytes, what: str, error: type[InputError]) -> tuple[str, int]:
    """Version 1 counts the header in 2 bytes, versions 2 and 3 in 4."""
    if data[:6] != _MAGIC or data[6:8] not in (b"\x01\x00", b"\x02\x00", b"\x03\x00"):
        raise error(f"{what} is not a .npy array of version 1, 2 or 3")
    first = 10 if data[6] == 1 else 12
    start = first + int.from_bytes(data[8:first], "little")
    if start > MAX_HEADER:
        raise error(f"{what}: the .npy header is {start} bytes: at most {MAX_HEADER}")
    if len(data) < start:
        raise error(f"{what} ends inside its .npy header")
    return data[first:start].decode("latin-1"), start


def _text(descr: object, what: str, error: type[InputError]) -> np.dtype[Any]:
    if isinstance(descr, str) and _TEXT.fullmatch(descr):
        return np.dtype(descr)
    raise error(f"{what} has dtype {descr!r:.80}: must be text, as of np.array(['jawOpen', …])")


def _dtype(descr: object, what: str, error: type[InputError]) -> np.dtype[Any]:
    if isinstance(descr, str) and _DTYPE.fullmatch(descr):
        try:
            return np.dtype(descr)
        except TypeError as exc:  # "f1", or "f16" where the machine has none
            raise error(f"{what} has dtype {descr!r}, which does not exist here") from exc
    code = descr.lstrip("<>=|")[:1] if isinstance(descr, str) else "V"
    kind = _KINDS.get(code, f"{descr!r:.80}")
    raise error(f"{what} holds {kind}: only integers and real numbers are read")
