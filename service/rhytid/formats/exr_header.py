"""The header of an OpenEXR image of one grey map, with every bound checked.

Read here and not by the OpenEXR library, which hostile files make write beyond its memory. What a
grey map has no use for is refused before any texel is read. After "OpenEXR File Layout",
https://openexr.com/en/latest/OpenEXRFileLayout.html
"""

from __future__ import annotations

import struct
from typing import NamedTuple

from rhytid.errors import InputError
from rhytid.formats.limits import check_sides

SIGNATURE = b"\x76\x2f\x31\x01"
_VERSION, _TILED, _LONG_NAMES, _DEEP, _PARTS = 2, 0x200, 0x400, 0x800, 0x1000
# What is read of a header, and of which type it is; beside it there may be anything.
_TYPES = {
    "channels": "chlist",
    "compression": "compression",
    "dataWindow": "box2i",
    "displayWindow": "box2i",
    "tiles": "tiledesc",
    "type": "string",
}
_REQUIRED = ("channels", "compression", "dataWindow", "displayWindow")
_COMPRESSIONS = ("none", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB")
# Rows of a block of the compressions that are read.
_ROWS = {"none": 1, "ZIPS": 1, "ZIP": 16}
_TEXELS = {1: "<f2", 2: "<f4"}
_COLOURS = {"R", "G", "B", "RY", "BY"}
# Of a tile, texels a side: as many blocks, and as large ones, as are read in seconds.
_LEAST_TILE, _MOST_TILE = 16, 1024
_MOST_ATTRIBUTES, _MOST_NAME, _MOST_CHANNELS = 10_000, 255, 8


class Header(NamedTuple):
    """Of an image of `width` x `height` texels, which are of `dtype` in the file.

    It is stored in blocks of `across` x `down` texels, cut off at the right and at the bottom,
    which are scan lines or tiles, and may be compressed as ZIP does it. `end` is where it ends.
    """

    width: int
    height: int
    dtype: str
    across: int
    down: int
    tiled: bool
    zip: bool
    end: int


class Damaged(ValueError):
    """Not what an OpenEXR image must be; the message says why, without the name of the file."""


class _Bytes:
    """Bytes read one after another; raises Damaged beyond the end."""

    def __init__(self, data: bytes, at: int = 0) -> None:
        self.data, self.at = data, at

    def take(self, count: int) -> bytes:
        found = self.data[self.at : self.at + count]
        if len(found) != count:  # nor is any length a negative one
            raise Damaged("the header is cut short")
        self.at += count
        return found

    def numbers(self, layout: str) -> tuple[int, ...]:
        return struct.unpack(layout, self.take(struct.calcsize(layout)))

    def text(self) -> str:
        end = self.data.find(b"\0", self.at, self.at + _MOST_NAME + 1)
        if end < 0:
            raise Damaged("a name in the header has no end")
        return self.take(end + 1 - self.at)[:-1].decode("ascii", "backslashreplace")


def read_header(data: bytes, name: str) -> Header:
    """The header of the bytes of an image, `name` for messages.

    Raises InputError for what is no grey map of half or float, LimitError above MOST_SIDE texels
    a side, Damaged.
    """
    source = _Bytes(data, len(SIGNATURE))
    (flags,) = source.numbers("<I")
    if flags & _PARTS:
        raise InputError(f"{name} has several parts: must have one")
    if flags & 0xFF != _VERSION or flags & ~(0xFF | _TILED | _LONG_NAMES | _DEEP):
        raise InputError(f"{name} is of an unknown version of OpenEXR")
    found = _attributes(source)
    if flags & _DEEP or found.get("type", b"").startswith(b"deep"):
        raise InputError(f"{name} has deep texels: must have one value a texel")
    width, height = _size(found, name)
    dtype, compression = _dtype(found["channels"], name), _compression(found["compression"], name)
    tiled = bool(flags & _TILED)
    across, down = _tile(found, name) if tiled else (width, _ROWS[compression])
    return Header(width, height, dtype, across, down, tiled, compression != "none", source.at)


def _attributes(source: _Bytes) -> dict[str, bytes]:
    """The attributes of _TYPES by name."""
    found: dict[str, bytes] = {}
    for _ in range(_MOST_ATTRIBUTES):
        name = source.text()
        if not name:
            missing = [name for name in _REQUIRED if name not in found]
            if missing:
                raise Damaged(f"the header has no {missing[0]}")
            return found
        kind, (size,) = source.text(), source.numbers("<i")
        value = source.take(size)
        if name in _TYPES and (name in found or kind != _TYPES[name]):
            raise Damaged(f"{name} is of type {kind}, or there twice")
        if name in _TYPES:
            found[name] = value
    raise Damaged(f"the header has more than {_MOST_ATTRIBUTES} attributes")


def _size(found: dict[str, bytes], name: str) -> tuple[int, int]:
    """Width and height; both windows begin at the origin and are the same."""
    data, display = (_Bytes(found[w]).numbers("<4i") for w in ("dataWindow", "displayWindow"))
    if data[:2] != (0, 0) or data != display:
        windows = f"data window {data[:2]} to {data[2:]}, display window {display[:2]} to"
        rule = "must be the same, from (0, 0) on"
        raise InputError(f"{name} has {windows} {display[2:]}: {rule}")
    width, height = data[2] + 1, data[3] + 1
    check_sides(name, width, height)
    return width, height


def _dtype(channels: bytes, name: str) -> str:
    """Of the only channel, whatever its name."""
    source = _Bytes(channels)
    found: list[tuple[str, tuple[int, ...]]] = []
    while len(found) < _MOST_CHANNELS and (channel := source.text()):
        found.append((channel, source.numbers("<iIii")))
    names = [channel for channel, _ in found]
    if len(found) != 1:
        what = "colours" if _COLOURS & set(names) else "not one channel"
        raise InputError(f"{name} has {what} ({', '.join(names)}): must be grey, one channel")
    kind, _, *every = found[0][1]
    if kind not in _TEXELS:
        raise InputError(f"{name} has texels of type {kind} (0 is UINT): must be half or float")
    if every != [1, 1]:
        raise InputError(f"{name} has a value every {every[0]} x {every[1]} texels: must be 1 x 1")
    return _TEXELS[kind]


def _compression(value: bytes, name: str) -> str:
    (number,) = _Bytes(value).numbers("<B")
    known = _COMPRESSIONS[number] if number < len(_COMPRESSIONS) else f"number {number}"
    if known not in _ROWS:
        raise InputError(f"{name} has compression {known}: must be one of {', '.join(_ROWS)}")
    return known


def _tile(found: dict[str, bytes], name: str) -> tuple[int, int]:
    """Width and height of a tile."""
    if "tiles" not in found:
        raise Damaged("the header has no tiles")
    width, height, mode = _Bytes(found["tiles"]).numbers("<IIB")
    if mode & 0xF:
        raise InputError(f"{name} has levels (mipmaps): must be one image")
    if not all(_LEAST_TILE <= side <= _MOST_TILE for side in (width, height)):
        rule = f"from {_LEAST_TILE} to {_MOST_TILE} a side"
        raise InputError(f"{name} has tiles of {width} x {height} texels: {rule}")
    return width, height
