"""The header of an OpenEXR image of one grey map: what decides before the library sees a byte.

After "OpenEXR File Layout", https://openexr.com/en/latest/OpenEXRFileLayout.html
"""

from __future__ import annotations

import struct

from rhytid.errors import InputError
from rhytid.formats.limits import check_sides

SIGNATURE = b"\x76\x2f\x31\x01"
_VERSION, _TILED, _LONG_NAMES, _DEEP, _PARTS = 2, 0x200, 0x400, 0x800, 0x1000
_NEEDED = ("channels", "dataWindow", "displayWindow")
_TEXELS = {0: "uint", 1: "half", 2: "float"}
_COLOURS = {"R", "G", "B", "RY", "BY"}
_MOST_NAME, _MOST_CHANNELS, _MOST_ATTRIBUTES = 255, 8, 10_000


class _Damaged(ValueError):
    """Not what a header must be; the message says why."""


class _Bytes:
    """Bytes read one after another; raises _Damaged beyond the end."""

    def __init__(self, data: bytes, at: int = 0) -> None:
        self.data, self.at = data, at

    def take(self, count: int) -> bytes:
        found = self.data[self.at : self.at + count]
        if len(found) != count:  # nor is any length a negative one
            raise _Damaged("the header is cut short")
        self.at += count
        return found

    def numbers(self, layout: str) -> tuple[int, ...]:
        return struct.unpack(layout, self.take(struct.calcsize(layout)))

    def text(self) -> str:
        end = self.data.find(b"\0", self.at, self.at + _MOST_NAME + 1)
        if end < 0:
            raise _Damaged("a name in the header has no end")
        return self.take(end + 1 - self.at)[:-1].decode("ascii", "backslashreplace")


def read_sides(data: bytes, name: str) -> tuple[int, int]:
    """Width and height of the bytes of an image, `name` for messages.

    Raises InputError for what is damaged or no grey map of half or float, LimitError above
    MOST_SIDE texels per side.
    """
    source = _Bytes(data, len(SIGNATURE))
    try:
        _check_flags(source.numbers("<I")[0], name)
        found = _attributes(source)
        _check_channel(found["channels"], name)
        return _sides(found, name)
    except _Damaged as exc:
        raise InputError(f"{name}: a damaged EXR image: {exc}") from exc


def _check_flags(flags: int, name: str) -> None:
    if flags & _PARTS:
        raise InputError(f"{name} has several parts: must have one")
    if flags & _DEEP:
        raise InputError(f"{name} has deep texels: must have one value per texel")
    if flags & ~(_TILED | _LONG_NAMES) != _VERSION:
        raise InputError(f"{name} is of an unknown version of OpenEXR")


def _attributes(source: _Bytes) -> dict[str, bytes]:
    """The attributes of _NEEDED by name. One that is there twice could be read as either."""
    found: dict[str, bytes] = {}
    for _ in range(_MOST_ATTRIBUTES):
        if not (name := source.text()):
            break
        source.text()  # its type
        value = source.take(*source.numbers("<i"))
        if name in found:
            raise _Damaged(f"{name} is there twice")
        if name in _NEEDED:
            found[name] = value
    else:
        raise _Damaged(f"the header has more than {_MOST_ATTRIBUTES} attributes")
    if missing := [name for name in _NEEDED if name not in found]:
        raise _Damaged(f"the header has no {missing[0]}")
    return found


def _check_channel(channels: bytes, name: str) -> None:
    """One channel, whatever its name, of half or float, with a value for every texel."""
    source = _Bytes(channels)
    found: list[tuple[str, tuple[int, ...]]] = []
    while len(found) < _MOST_CHANNELS and (channel := source.text()):
        found.append((channel, source.numbers("<iIii")))
    names = [channel for channel, _ in found]
    if len(found) != 1:
        what = "colours" if _COLOURS & set(names) else "not one channel"
        raise InputError(f"{name} has {what} ({', '.join(names)}): must be grey, one channel")
    kind, _, *every = found[0][1]
    texels = _TEXELS.get(kind, f"type {kind}")
    if texels not in ("half", "float"):
        raise InputError(f"{name} has texels of {texels}: must be half or float")
    if every != [1, 1]:
        raise InputError(f"{name} has a value every {every[0]} x {every[1]} texels: must be 1 x 1")


def _sides(found: dict[str, bytes], name: str) -> tuple[int, int]:
    """Both windows begin at the origin and are the same."""
    data, display = (_Bytes(found[w]).numbers("<4i") for w in ("dataWindow", "displayWindow"))
    if data[:2] != (0, 0) or data != display:
        windows = f"data window {data[:2]} to {data[2:]}, display window {display[:2]} to"
        rule = "must be the same, from (0, 0) on"
        raise InputError(f"{name} has {windows} {display[2:]}: {rule}")
    width, height = data[2] + 1, data[3] + 1
    check_sides(name, width, height)
    return width, height
