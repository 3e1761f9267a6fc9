"""Tiles as files: displacement as npy, f16, exr, exr16 and png, moments of slopes as npy and
exr."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.errors import QueryError
from rhytid.formats.exr import encode_exr
from rhytid.formats.exr_encoder import exr_parts
from rhytid.formats.png import encode_png
from rhytid.formats.tile_header import TileHeader

__all__ = ["FORMATS", "Encoded", "TileFormat", "TileHeader", "encode", "quantise"]

Tile = NDArray[np.float32]
# Those that moments of slopes can be asked for in, and what their values are.
OF_SLOPES = ("npy", "exr")
SLOPE_CHANNELS = ("x", "y", "xx", "xy", "yy")
# The first float32 that rounds to no half float.
OVERFLOW = 65520.0
# Numbers that are converted at a time: what is in between stays in the cache.
_PIECE = 1 << 15
_EXPONENT, _SIGN = np.uint32(0x7F800000), np.uint32(0x8000)
# Bits of a float32 whose exponent is that of the least half float that is normal, and how much
# larger the exponent of the power of two is.
_LEAST, _LARGER = np.uint32(113 << 23), np.uint32(13 << 23)
# Bits of a mantissa that a half float lacks; what the exponent of the power of two is too large by.
_LACKS, _OFFSET = np.uint32(13), np.uint32(126 << 10)


@dataclass(frozen=True)
class Encoded:
    """A tile ready to be sent or saved."""

    body: bytes
    media_type: str
    extension: str


@dataclass(frozen=True)
class TileFormat:
    """How a tile is encoded, and what the result is called.

    working: the most that a tile and what it is encoded to take of memory, over the tile.
    compressed: whether encoding takes much longer than copying.
    """

    encode: Callable[[Tile, TileHeader], bytes]
    media_type: str
    extension: str
    working: int
    compressed: bool = False


def encode(tile: Tile, format: str, header: TileHeader) -> Encoded:
    """A tile (h, w) of displacement, in the unit of the header, in one of FORMATS; or moments (h,
    w, 5) in one of OF_SLOPES.

    Raises QueryError for an unknown format and for a displacement that half floats cannot hold,
    StorageError where an exr cannot be written.
    """
    kind = FORMATS.get(format)
    if kind is None:
        raise QueryError(f"format {format!r:.40}: one of {', '.join(FORMATS)}")
    if tile.ndim == 3 and format == "exr":
        parts = slope_parts(tile, {**header.attributes(), "layer": "slopes"})
        return Encoded(b"".join(parts), kind.media_type, kind.extension)
    return Encoded(kind.encode(tile, header), kind.media_type, kind.extension)


def slope_parts(moments: Tile, attributes: Mapping[str, str | int | float]) -> list[bytes]:
    """Moments (h, w, 5) as OpenEXR of the channels slope.x, slope.y, slope.xx, slope.xy, slope.yy,
    in parts."""
    return exr_parts(moments, attributes, tuple(f"slope.{name}" for name in SLOPE_CHANNELS))


def quantise(tile: Tile, scale: float) -> NDArray[np.uint16]:
    """16 bit codes p with h = (p - 32768)/32767 · scale; what lies beyond ±scale is clipped."""
    codes = np.rint(tile * (32767.0 / np.float64(scale))) + 32768.0
    clipped: NDArray[np.uint16] = np.clip(codes, 0, 65535).astype(np.uint16)
    return clipped


def _npy(tile: Tile, header: TileHeader) -> bytes:
    texels = np.ascontiguousarray(tile, "<f4")
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, np.lib.format.header_data_from_array_1_0(texels))
    return b"".join((head.getvalue(), texels.data))  # np.save would copy the texels three times


def half_tile(tile: Tile) -> NDArray[np.float16]:
    """A tile as half floats; raises QueryError where they cannot hold it."""
    # Not of np.abs, which would write as much memory again.
    worst = float(np.maximum(tile.max(initial=0.0), -tile.min(initial=0.0)))
    if not worst < OVERFLOW:  # also where it is not a number
        raise QueryError(f"displacement {worst:g} does not fit half floats: use npy, exr or png")
    return half_floats(tile)


def half_floats(values: NDArray[np.float32]) -> NDArray[np.float16]:
    """Half floats of numbers, each below OVERFLOW, rounded as numpy does, in half of its time.

    numpy converts one number after the other. Here a number is added to the power of two whose last
    bit is that of its half float: the addition of floats rounds to even by itself.
    """
    flat = np.ascontiguousarray(values, np.float32).reshape(-1)
    out = np.empty(values.shape, "<u2")
    codes, piece = out.reshape(-1), min(_PIECE, len(flat))
    room = np.empty((3, piece), np.uint32)
    least = np.full(piece, _LEAST)  # numpy compares two arrays faster than one and a number
    for first in range(0, len(flat), _PIECE):
        some = flat[first : first + piece]
        _convert(some, room[:, : len(some)], least[: len(some)], codes[first : first + piece])
    return out.view("<f2")


def _convert(some: NDArray[np.float32], room: Any, least: Any, codes: Any) -> None:
    """Half floats of `some` as `codes`.  room: (3, n), overwritten."""
    bits, (power, rounded, sign) = some.view(np.uint32), room
    sums = rounded.view(np.float32)
    np.bitwise_and(bits, _EXPONENT, out=power)
    np.maximum(power, least, out=power)
    np.add(power, _LARGER, out=power)
    np.abs(some, out=sums)
    np.add(sums, power.view(np.float32), out=sums)
    # What the addition left of the mantissa, and the exponent: of a number that was rounded up to a
    # power of two the one overflows into the other.
    np.subtract(rounded, power, out=rounded)
    np.right_shift(power, _LACKS, out=power)
    np.add(rounded, power, out=rounded)
    np.subtract(rounded, _OFFSET, out=rounded)
    np.right_shift(bits, np.uint32(16), out=sign)
    np.bitwise_and(sign, _SIGN, out=sign)
    np.bitwise_or(rounded, sign, out=rounded)
    np.copyto(codes, rounded, casting="unsafe")


def _f16(tile: Tile, header: TileHeader) -> bytes:
    return half_tile(tile).tobytes()


def _exr16(tile: Tile, header: TileHeader) -> bytes:
    return encode_exr(half_tile(tile), header)


def _png(tile: Tile, header: TileHeader) -> bytes:
    notes = {**header.attributes(), "scale": header.scale}
    texts = {name: str(value) for name, value in notes.items()}
    return encode_png(quantise(tile, header.scale), texts)


FORMATS = {
    "npy": TileFormat(_npy, "application/x-npy", ".npy", 2),
    "f16": TileFormat(_f16, "application/octet-stream", ".f16", 3),
    "exr": TileFormat(encode_exr, "image/x-exr", ".exr", 3, compressed=True),
    "exr16": TileFormat(_exr16, "image/x-exr", ".exr", 3, compressed=True),
    "png": TileFormat(_png, "image/png", ".png", 6, compressed=True),
}
