"""Grey PNG images of 8 or 16 bits.

What an image library would convert without a word (colours, palettes, few bits) is refused.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from rhytid.errors import InputError
from rhytid.formats.limits import check_sides

# A PNG begins with its signature, then the length and the name of its first chunk.
SIGNATURE = b"\x89PNG\r\n\x1a\n"
_HEADER = SIGNATURE + b"\x00\x00\x00\x0dIHDR"
_HEADER_BYTES = 29
# What the library raises where a chunk is shorter than it must be, or not what it must be.
_DAMAGED = (OSError, SyntaxError, ValueError, EOFError, IndexError, TypeError, struct.error)
_KINDS = {2: "colours", 3: "a palette", 4: "transparency", 6: "colours and transparency"}


def read_grey_png(data: bytes, name: str) -> NDArray[np.unsignedinteger]:
    """(h, w) codes of the bytes of a PNG, uint8 or uint16 by its bits, row 0 at the top.

    `name` is for messages. Raises InputError saying what is wrong, and LimitError above MOST_SIDE
    texels per side. Gamma and colour profiles count for nothing: codes are taken as they are.
    """
    bits = _check_header(data, name)
    with _naming(name):
        _open(data).verify()  # every chunk and its checksum, to the end
        image = _open(data)
        image.load()
    if "transparency" in image.info:
        raise InputError(f"{name} has {_KINDS[4]}: must be grey")
    # 16 bits are `I;16` or `I` by the version of the library; their numbers are the same.
    codes: NDArray[np.unsignedinteger] = np.asarray(image).astype(f"u{bits // 8}", copy=False)
    return codes


def _check_header(data: bytes, name: str) -> int:
    """Bits of a texel."""
    if not data.startswith(_HEADER) or len(data) < _HEADER_BYTES:
        raise InputError(f"{name}: a damaged PNG image")
    width, height = (int.from_bytes(data[at : at + 4], "big") for at in (16, 20))
    bits, kind = data[24], data[25]
    if kind != 0:
        raise InputError(f"{name} has {_KINDS.get(kind, f'colour type {kind}')}: must be grey")
    if bits not in (8, 16):
        raise InputError(f"{name} has {bits} bits per texel: must be 8 or 16")
    check_sides(name, width, height)
    return bits


def _open(data: bytes) -> Image.Image:
    return Image.open(io.BytesIO(data), formats=["PNG"])


@contextmanager
def _naming(name: str) -> Iterator[None]:
    """What the library says of a damaged file, as an InputError."""
    try:
        yield
    except UnidentifiedImageError as exc:  # its text is an address in memory
        raise InputError(f"{name}: a damaged PNG image") from exc
    except _DAMAGED as exc:
        raise InputError(f"{name}: a damaged PNG image: {exc}") from exc
