"""Tiles as files: displacement as npy, f16, exr, exr16 and png, moments of slopes as npy and
exr."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.errors import QueryError
from rhytid.formats.exr import encode_exr
from rhytid.formats.exr_encoder import exr_parts
from rhytid.formats.half_floats import OVERFLOW, half_floats
from rhytid.formats.png import encode_png
from rhytid.formats.tile_header import TileHeader
from rhytid.support.cores import on_all_cores

__all__ = ["FORMATS", "Encoded", "TileFormat", "TileHeader", "encode", "quantise"]

Tile = NDArray[np.float32]
# Those that moments of slopes can be asked for in, and what their values are.
OF_SLOPES = ("npy", "exr")
# Texels that are quantised at a time: their doubles stay in the cache. How many times a core does
# so before another can take over: a tile is not worth that.
_AT_ONCE, _STEPS = 1 << 16, 8
SLOPE_CHANNELS = ("x", "y", "xx", "xy", "yy")


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
    out = np.empty(tile.shape, np.uint16)
    step = max(_AT_ONCE // max(tile.shape[1], 1), 1)

    def part(begin: int) -> None:
        for start in range(begin, min(begin + _STEPS * step, len(tile)), step):
            codes = tile[start : start + step] * (32767.0 / np.float64(scale))
            np.rint(codes, out=codes)
            codes += 32768.0
            np.clip(codes, 0.0, 65535.0, out=codes)
            out[start : start + step] = codes

    on_all_cores(part, range(0, len(tile), _STEPS * step))
    return out


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
    "png": TileFormat(_png, "image/png", ".png", 3, compressed=True),
}
