"""PNG files by hand: numpy and zlib alone."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
# 2 to the power of 15, less 1: codes to either side of the middle, as the server's.
_MIDDLE, _STEPS = 32768.0, 32767.0
# Pixels per side that a picture has at most.
_SHOWN = 512
# Slopes of which a root mean square is drawn as this: relief that can be seen.
_SLOPE = 0.35
_LIGHT = np.array([-0.55, 0.60, 0.58]) / np.linalg.norm([-0.55, 0.60, 0.58])


def grey16(codes: NDArray[np.uint16], notes: Mapping[str, str] | None = None) -> bytes:
    """A grey PNG of codes (h, w), 16 bits; `notes` are Latin-1 texts in it by their keys."""
    return _file(codes.astype(">u2"), 16, notes)


def grey8(codes: NDArray[np.uint8], notes: Mapping[str, str] | None = None) -> bytes:
    """The same, 8 bits."""
    return _file(codes, 8, notes)


def rgb16(
    codes: NDArray[np.uint16], notes: Mapping[str, str] | None = None, *, quick: bool = False
) -> bytes:
    """A PNG of codes (h, w, 3), 16 bits.  quick: larger, in less time."""
    return _file(codes.astype(">u2"), 16, notes, 1 if quick else 6)


def notes_of(file: bytes) -> dict[str, str]:
    """The texts before the pixels of a PNG, of which the first bytes are enough; none of what is no
    PNG."""
    found, at = {}, len(_SIGNATURE)
    while file.startswith(_SIGNATURE) and at + 8 <= len(file):
        size, kind = struct.unpack_from(">I4s", file, at)
        if kind == b"IDAT":
            break
        if kind == b"tEXt":
            key, _, text = file[at + 8 : at + 8 + size].decode("latin-1").partition("\0")
            found[key] = text
        at += 12 + size
    return found


def heights16(heights: NDArray[Any], scale: float | None = None) -> bytes:
    """Heights (h, w) as 16 bits, height = (p - 32768) / 32767 · scale, with `scale` as a text.

    scale: absent, the largest absolute height, 1 where all are 0. What lies beyond it is clipped.
    Raises ValueError for a scale that is not above 0 and for heights that are not finite.
    """
    values = np.asarray(heights, np.float64)
    most = float(np.abs(values).max(initial=0.0))
    chosen = (most or 1.0) if scale is None else float(scale)
    if not (np.isfinite(most) and np.isfinite(chosen) and chosen > 0):
        raise ValueError(f"heights up to {most:g} cannot be written with the scale {chosen:g}")
    codes = np.rint(values * (_STEPS / chosen)) + _MIDDLE
    return grey16(np.clip(codes, 0, 65535).astype(np.uint16), {"scale": repr(chosen)})


def relief(heights: NDArray[Any]) -> bytes:
    """A picture of heights (h, w), row 0 at the top: lit from the upper left, at most 512 pixels
    per side, each the mean of its texels.

    Slopes are scaled so that their root mean square looks alike in every picture; the texts
    `lowest` and `highest` in the file say how high the relief is, mesh units.
    """
    values = np.asarray(heights, np.float64)
    notes = {"lowest": f"{values.min():.6g}", "highest": f"{values.max():.6g}"}
    small = _reduced(values)
    down, across = (_slope(small, axis) for axis in (0, 1))
    steep = float(np.sqrt(np.mean(down**2 + across**2)))
    gain = _SLOPE / steep if np.isfinite(steep) and steep > 0 else 0.0
    normal = np.stack([-across * gain, down * gain, np.ones_like(small)], axis=-1)
    facing = normal @ _LIGHT / np.linalg.norm(normal, axis=-1)
    grey = np.nan_to_num(np.clip(0.12 + 0.88 * facing, 0.0, 1.0))
    return grey8((255 * grey + 0.5).astype(np.uint8), notes)


def _reduced(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Means over whole squares of texels, so that neither side exceeds what is shown."""
    factor = -(-max(values.shape) // _SHOWN)
    height, width = (side // factor for side in values.shape)
    whole = values[: height * factor, : width * factor]
    means: NDArray[np.float64] = whole.reshape(height, factor, width, factor).mean(axis=(1, 3))
    return means


def _slope(values: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    """By central differences; 0 along a side of one texel."""
    if values.shape[axis] < 2:
        return np.zeros_like(values)
    found: NDArray[np.float64] = np.gradient(values, axis=axis)
    return found


def _file(
    codes: NDArray[Any], bits: int, notes: Mapping[str, str] | None, effort: int = 6
) -> bytes:
    height, width = codes.shape[:2]
    colour = {2: 0, 3: 2}[codes.ndim]
    # Every row begins with its filter: 0, none.
    rows = np.zeros((height, 1 + codes[0].size * bits // 8), np.uint8)
    rows[:, 1:] = np.ascontiguousarray(codes).view(np.uint8).reshape(height, -1)
    texts = ((key + "\0" + text).encode("latin-1") for key, text in (notes or {}).items())
    return b"".join([
        _SIGNATURE,
        _chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, colour, 0, 0, 0)),
        *(_chunk(b"tEXt", text) for text in texts),
        _chunk(b"IDAT", zlib.compress(rows.tobytes(), effort)),
        _chunk(b"IEND", b""),
    ])  # fmt: skip


def _chunk(kind: bytes, data: bytes) -> bytes:
    check = zlib.crc32(kind + data)
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", check)
