"""Textures as KTX 2.0: arrays of one channel, with their own levels, not compressed.

https://registry.khronos.org/KTX/specs/2.0/ktxspec.v2.html and, for the description of the channel,
the Khronos Data Format 1.3.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

IDENTIFIER = b"\xabKTX 20\xbb\r\n\x1a\n"
WRITER = b"rhytid"
_ALIGNMENT = 4
# Values of the descriptor: red, linear, of no colour space.
_RED, _LINEAR, _NO_PRIMARIES, _RGBSDA = 0, 1, 0, 1
_SIGNED = 0x40


@dataclass(frozen=True)
class Channel:
    """The texels of a texture of one channel: the number of their format in Vulkan, and the values
    that are written as their least and their largest."""

    vulkan: int
    dtype: np.dtype[np.generic]
    signed: bool
    low: int
    high: int


# R8_SNORM, whose -127 to 127 are -1 to 1, R16_UINT and R32_UINT.
CHANNELS = {
    "r8snorm": Channel(10, np.dtype("i1"), True, -127, 127),
    "r16uint": Channel(74, np.dtype("<u2"), False, 0, 1),
    "r32uint": Channel(98, np.dtype("<u4"), False, 0, 1),
}


def ktx2_pieces(
    channel: str, shape: tuple[int, int, int], levels: Sequence[NDArray[np.generic]]
) -> Iterator[bytes]:
    """The bytes of a file, piece by piece.

    channel: of CHANNELS.  shape: layers, rows and columns of level 0.  levels: finest first, each
    (layers, rows, columns), row 0 at the top, half as many rows and columns as the one before.
    """
    kind = CHANNELS[channel]
    sizes = [level.size * kind.dtype.itemsize for level in levels]
    head, starts = _head(kind, shape, sizes)
    yield head
    at = len(head)
    for level, start in reversed([*zip(levels, starts, strict=True)]):
        yield bytes(start - at)
        for layer in level:
            yield np.ascontiguousarray(layer, kind.dtype).tobytes()
        at = start + level.size * kind.dtype.itemsize


def _head(
    kind: Channel, shape: tuple[int, int, int], sizes: Sequence[int]
) -> tuple[bytes, list[int]]:
    """The bytes before the levels, and the offset of each level; the smallest level comes first."""
    layers, rows, columns = shape
    described, keys = _description(kind), _keys()
    first = len(IDENTIFIER) + 36 + 32 + 24 * len(sizes)
    end = first + len(described) + len(keys)
    starts: list[int] = []
    for size in reversed(sizes):
        end += -end % _ALIGNMENT
        starts.insert(0, end)
        end += size
    header = struct.pack(
        "<9I", kind.vulkan, kind.dtype.itemsize, columns, rows, 0, layers, 1, len(sizes), 0
    )
    places = (first, len(described), first + len(described), len(keys))
    index = struct.pack("<4I2Q", *places, 0, 0)
    found = [struct.pack("<3Q", start, n, n) for start, n in zip(starts, sizes, strict=True)]
    return b"".join([IDENTIFIER, header, index, *found, described, keys]), starts


def _description(kind: Channel) -> bytes:
    """The data format descriptor: one block that describes one channel."""
    size = kind.dtype.itemsize
    block = struct.pack(
        "<I2H8B8B", 0, 2, 24 + 16, _RGBSDA, _NO_PRIMARIES, _LINEAR, 0, 0, 0, 0, 0, size, *[0] * 7
    )
    channel = _RED | (_SIGNED if kind.signed else 0)
    limits = (kind.low & 0xFFFFFFFF, kind.high)
    sample = struct.pack("<H6B2I", 0, 8 * size - 1, channel, 0, 0, 0, 0, *limits)
    return struct.pack("<I", 4 + len(block) + len(sample)) + block + sample


def _keys() -> bytes:
    """Row 0 is at the top, column 0 on the left; sorted by name."""
    found = b""
    for name, value in ((b"KTXorientation", b"rd"), (b"KTXwriter", WRITER)):
        entry = name + b"\0" + value + b"\0"
        found += struct.pack("<I", len(entry)) + entry + bytes(-len(entry) % 4)
    return found
