"""OpenEXR files as they are written: of one channel `Y`, or of several with names.

The name of a lone channel is not free: Blender reads one of another name as NaN.

ZIP, ZIPS and no compression are written here, block by block on all cores, and their deflate is
that of ISA-L: the bindings of the OpenEXR library know one level of it alone, which takes three to
six times as long for 2 to 8 % less. Other compressions are written by the library. After "OpenEXR
File Layout", https://openexr.com/en/latest/OpenEXRFileLayout.html.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Protocol, TypeGuard

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from rhytid.errors import QueryError, StorageError
from rhytid.formats.deflate import deflated
from rhytid.formats.half_floats import OVERFLOW, extremes, half_floats
from rhytid.support.cores import on_all_cores

Texels = NDArray[np.float32] | NDArray[np.float16]
Attributes = Mapping[str, str | int | float]
# Rows `start` to `stop` of a map as (stop - start, width); (…, width, C) of C channels.
Rows = Callable[[int, int], Texels]
SIGNATURE = b"\x76\x2f\x31\x01"
CHANNEL = "Y"
# Those that are written here: their number in a file, and the rows of a block.
_OWN = {"none": (0, 1), "zips": (2, 1), "zip": (3, 16)}
# Those of the library.
_LIBRARY = {"piz": "PIZ_COMPRESSION", "dwaa": "DWAA_COMPRESSION", "zstd": "ZSTD_COMPRESSION"}
# Texels that a core works on at a time: a few blocks, so that they stay in its cache.
_STRIP = 1 << 18
_VERSION, _LONG_NAMES, _MOST_SHORT = 2, 0x400, 31
_KINDS = {"float16": 1, "float32": 2}
_INTS, _FLOAT, _TEXT = "int", "float", "string"


class Body(Protocol):
    """The texels of a file, compressed."""

    @property
    def minimum(self) -> float:
        """Of the texels as they are stored."""

    @property
    def maximum(self) -> float:
        """Of the texels as they are stored."""

    def parts(self, attributes: Attributes) -> list[bytes]:
        """The bytes of the file with these attributes, in parts. Raises StorageError where the
        library fails."""


def exr_body(rows: Rows, side: tuple[int, int], dtype: str, compression: str = "zip") -> Body:
    """The texels of a map.

    side: rows and columns.  dtype: `float32`, or `float16` for half floats.  compression: `zip`,
    `zips`, `none`, `piz`, `dwaa`, which is lossy, or `zstd`. Raises QueryError for another one.
    """
    if compression in _OWN:
        return _Blocks.of(rows, side, dtype, compression)
    if compression in _LIBRARY:
        return _Whole.of(rows(0, side[0]).astype(dtype, copy=False), compression)
    raise QueryError(f"compression {compression!r:.40} is unknown")


def exr_parts(
    texels: Texels, attributes: Attributes, channels: tuple[str, ...] = (CHANNEL,)
) -> list[bytes]:
    """A map (h, w), or (h, w, C) of channels with these names, with attributes as the bytes of a
    file in ZIP compression, in parts."""
    dtype = texels.dtype.name
    body = _Blocks.of(
        lambda start, stop: texels[start:stop], texels.shape[:2], dtype, "zip", channels
    )
    return body.parts(attributes)


def renamed(data: bytes, attribute: str, text: str) -> list[bytes]:
    """A file of scanlines with another text for one of its attributes, in parts.

    data: as it was written here or by the library. Raises KeyError where it has no such attribute.
    """
    places = _places(data)
    start, size = places[attribute]
    end = max(at + length for at, length in places.values()) + 1
    value = text.encode()
    (first,) = struct.unpack_from("<q", data, end)
    table = np.frombuffer(data, "<i8", (first - end) // 8, end) + (len(value) - size)
    head = [data[: start - 4], struct.pack("<i", len(value)), value, data[start + size : end]]
    return [*head, table.astype("<i8").tobytes(), data[first:]]


def _places(data: bytes) -> dict[str, tuple[int, int]]:
    """Where the value of each attribute of a file begins, and how many bytes it has."""
    found, at = {}, 8
    while data[at]:
        name, kind = data.index(b"\0", at), data.index(b"\0", data.index(b"\0", at) + 1)
        (size,) = struct.unpack_from("<i", data, kind + 1)
        found[data[at:name].decode()] = kind + 5, size
        at = kind + 5 + size
    return found


@dataclass(frozen=True)
class _Blocks:
    """Blocks of rows as they are in a file."""

    side: tuple[int, int]
    dtype: str
    compression: str
    blocks: list[bytes]
    minimum: float
    maximum: float
    channels: tuple[str, ...] = (CHANNEL,)

    @classmethod
    def of(cls, rows: Rows, side: tuple[int, ...], dtype: str,
           compression: str, channels: tuple[str, ...] = (CHANNEL,)) -> _Blocks:  # fmt: skip
        """Compress a map, a strip of rows per core at a time."""
        height, width = side
        lines = _OWN[compression][1]
        step = max(_STRIP // max(width, 1) // lines, 1) * lines
        starts = range(0, height, step)

        def strip(start: int) -> tuple[list[bytes], float, float]:
            found = rows(start, min(start + step, height))
            ends = _ends(found)
            stored = _stored(_by_channel(found, channels), dtype, ends)
            parts = range(0, len(stored), lines)
            blocks = [_block(stored[at : at + lines], compression) for at in parts]
            low, high = (float(np.asarray(end).astype(dtype)) for end in ends)
            return blocks, low, high

        done = on_all_cores(strip, starts)
        ends = np.array([(low, high) for _, low, high in done])
        blocks = [block for strips, _, _ in done for block in strips]
        low, high = float(ends[:, 0].min()), float(ends[:, 1].max())
        return cls((height, width), dtype, compression, blocks, low, high, channels)

    def parts(self, attributes: Attributes) -> list[bytes]:
        """See `Body`."""
        head = _head(attributes, self.side, self.dtype, self.compression, self.channels)
        lines = _OWN[self.compression][1]
        firsts = range(0, self.side[0], lines)
        sizes = np.array([8 + len(block) for block in self.blocks], np.uint64)
        start = np.uint64(len(head) + 8 * len(self.blocks))
        table = (start + np.cumsum(sizes, dtype=np.uint64) - sizes).astype("<u8").tobytes()
        found = [head, table]
        for first, block in zip(firsts, self.blocks, strict=True):
            found += [struct.pack("<ii", first, len(block)), block]
        return found


@dataclass(frozen=True)
class _Whole:
    """A map that the library compresses when it writes it."""

    texels: Texels
    compression: str
    minimum: float
    maximum: float

    @classmethod
    def of(cls, texels: Texels, compression: str) -> _Whole:
        """A map (h, w)."""
        return cls(texels, compression, float(texels.min()), float(texels.max()))

    def parts(self, attributes: Attributes) -> list[bytes]:
        """See `Body`."""
        method = getattr(OpenEXR, _LIBRARY[self.compression])
        fixed = {"compression": method, "type": OpenEXR.scanlineimage}
        stream = io.BytesIO()
        try:
            file = OpenEXR.File(
                {**attributes, **fixed}, {CHANNEL: np.ascontiguousarray(self.texels)}
            )
            file.write(stream)
        except (OSError, RuntimeError) as exc:
            raise StorageError(f"cannot write an EXR file: {exc}") from exc
        return [stream.getvalue()]


def _ends(rows: Texels) -> tuple[np.floating, np.floating]:
    """The least and the greatest of some rows."""
    return extremes(rows) if _are_halves(rows) else (rows.min(), rows.max())


def _are_halves(rows: Texels) -> TypeGuard[NDArray[np.float16]]:
    return rows.dtype == np.float16


def _stored(rows: Texels, dtype: str, ends: tuple[np.floating, np.floating]) -> Texels:
    """Rows as they are in a file before compression.  ends: their least and greatest number."""
    if dtype == "float16" and rows.dtype == np.float32:
        low, high = map(float, ends)
        if low > -OVERFLOW and high < OVERFLOW:  # not where one is not a number
            return half_floats(rows.astype(np.float32, copy=False))
    stored: Texels = np.ascontiguousarray(rows, np.dtype(dtype).newbyteorder("<"))
    return stored


def _block(rows: Texels, compression: str) -> bytes:
    """The rows of a block, as they are in a file: compressed, unless that makes them no smaller."""
    if compression == "none":
        return rows.tobytes()
    found = deflated(_differences(rows).data)
    return found if len(found) < rows.nbytes else rows.tobytes()


def _differences(rows: Texels) -> NDArray[np.uint8]:
    """The bytes of rows as ZIP compresses them: first those at even places, then those at odd ones,
    each less the one before it, plus 128 modulo 256. The first byte stays."""
    pairs = rows.view("<u2").reshape(-1)
    count = len(pairs)
    split = np.empty(2 * count + 1, np.uint8)
    split[0] = 128  # what leaves the first one as it is
    split[1 : count + 1] = pairs  # the lower byte, at the even place
    split[count + 1 :] = pairs >> 8
    found: NDArray[np.uint8] = split[1:] - split[:-1]
    found ^= 128
    return found


def _by_channel(rows: Texels, channels: tuple[str, ...]) -> Texels:
    """Rows (n, w, C) as they are in a file, (n, C w): the channels of a row one after the other, by
    the alphabet; rows (n, w) as they are."""
    if rows.ndim == 2:
        return rows
    order = np.argsort(channels)
    found: Texels = rows[..., order].transpose(0, 2, 1).reshape(len(rows), -1)
    return found


def _head(
    attributes: Attributes,
    side: tuple[int, int],
    dtype: str,
    compression: str,
    channels: tuple[str, ...],
) -> bytes:
    """The bytes before the table of blocks."""
    height, width = side
    window = ("box2i", struct.pack("<4i", 0, 0, width - 1, height - 1))
    kind = struct.pack("<iIii", _KINDS[dtype], 0, 1, 1)
    channel = b"".join(name.encode() + b"\0" + kind for name in sorted(channels)) + b"\0"
    fixed = {
        "channels": ("chlist", channel),
        "compression": ("compression", bytes([_OWN[compression][0]])),
        "dataWindow": window,
        "displayWindow": window,
        "lineOrder": ("lineOrder", b"\0"),
        "pixelAspectRatio": (_FLOAT, struct.pack("<f", 1.0)),
        "screenWindowCenter": ("v2f", struct.pack("<2f", 0.0, 0.0)),
        "screenWindowWidth": (_FLOAT, struct.pack("<f", 1.0)),
        "type": (_TEXT, b"scanlineimage"),
    }
    every = {**{name: _value(value) for name, value in attributes.items()}, **fixed}
    flags = _VERSION | (_LONG_NAMES if any(len(name) > _MOST_SHORT for name in every) else 0)
    return b"".join([SIGNATURE, struct.pack("<I", flags), *_attributes(every), b"\0"])


def _attributes(every: Mapping[str, tuple[str, bytes]]) -> Iterable[bytes]:
    for name, (kind, value) in sorted(every.items()):
        yield f"{name}\0{kind}\0".encode() + struct.pack("<i", len(value)) + value


def _value(value: str | int | float) -> tuple[str, bytes]:
    """The type of an attribute, and its bytes."""
    if isinstance(value, str):
        return _TEXT, value.encode()
    if isinstance(value, int):
        return _INTS, struct.pack("<i", value)
    return _FLOAT, struct.pack("<f", value)
