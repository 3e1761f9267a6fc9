"""PNG files of one or three channels, 8 or 16 bits, with texts. Pillow writes no 16-bit RGB.

After the PNG specification, third edition, https://www.w3.org/TR/png-3/
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from rhytid.errors import InputError

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
# Colour types of the header by channels, and the filter that stores differences to the row above.
_COLOURS, _UP = {1: 0, 3: 2}, 2
_GAMMA_1 = 100_000
# Level 6 takes twice the time for 10 % less.
_LEVEL = 1


def encode_png(
    texels: NDArray[np.uint8] | NDArray[np.uint16],
    texts: Mapping[str, str],
    linear: bool = False,
) -> bytes:
    """The bytes of a file. texels: (h, w) grey or (h, w, 3) RGB, row 0 at the top; texts: Latin
    keywords of up to 79 letters, and what they say. linear: say that values are in proportion to
    what they stand for, by a gamma of 1: without it readers take sRGB. Raises InputError for
    another shape or type."""
    rows = texels[..., None] if texels.ndim == 2 else texels
    if rows.ndim != 3 or rows.shape[2] not in _COLOURS or rows.dtype not in (np.uint8, np.uint16):
        raise InputError(f"no PNG of {texels.dtype} {texels.shape}: grey or RGB of 8 or 16 bits")
    height, width, channels = rows.shape
    bits = 8 * rows.dtype.itemsize
    head = struct.pack(">IIBBBBB", width, height, bits, _COLOURS[channels], 0, 0, 0)
    notes = (_chunk(b"iTXt", _text(name, text)) for name, text in texts.items())
    data = zlib.compress(_filtered(rows), _LEVEL)
    gamma = [_chunk(b"gAMA", struct.pack(">I", _GAMMA_1))] if linear else []
    parts = [_chunk(b"IHDR", head), *gamma, *notes, _chunk(b"IDAT", data), _chunk(b"IEND", b"")]
    return b"".join([_SIGNATURE, *parts])


def _filtered(rows: NDArray[np.uint8] | NDArray[np.uint16]) -> bytes:
    """Rows as bytes, high byte first, less those of the row above, each after its filter."""
    high_first = rows.astype(rows.dtype.newbyteorder(">"), copy=False)
    plain = np.ascontiguousarray(high_first).view(np.uint8).reshape(len(rows), -1)
    out = np.empty((len(rows), plain.shape[1] + 1), np.uint8)
    out[:, 0] = _UP
    out[0, 1:] = plain[0]
    np.subtract(plain[1:], plain[:-1], out=out[1:, 1:])
    return out.tobytes()


def _text(name: str, text: str) -> bytes:
    return name.encode("latin-1") + b"\0\0\0\0\0" + text.encode()


def _chunk(kind: bytes, data: bytes) -> bytes:
    check = struct.pack(">I", zlib.crc32(data, zlib.crc32(kind)))
    return b"".join([struct.pack(">I", len(data)), kind, data, check])
