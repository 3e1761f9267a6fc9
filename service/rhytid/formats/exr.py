"""OpenEXR: displacement maps as they are read, and grey images as they are uploaded.

Maps are written by `exr_encoder`.

A grey image has one channel of half or float from 0 to 1, which becomes codes of 16 bits; 0.5
becomes 32768 of 65535, mid grey. Its header is checked here, before the library sees a byte of it,
after "OpenEXR File Layout", https://openexr.com/en/latest/OpenEXRFileLayout.html. The library
decodes the rest in a process of its own, `exr_decoder`, which it may crash without harm.
"""

from __future__ import annotations

import io
import json
import struct
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from rhytid.domain.wording import plural
from rhytid.errors import InputError
from rhytid.formats import exr_encoder
from rhytid.formats.decoder_process import answer_of
from rhytid.formats.exr_decoder import BadTexel, decode
from rhytid.formats.exr_encoder import CHANNEL, Texels, exr_parts
from rhytid.formats.limits import MOST_SIDE, check_sides
from rhytid.formats.tile_header import TileHeader
from rhytid.support.temporary_folders import temporary_folder

SIGNATURE = exr_encoder.SIGNATURE
# Seconds that the decoder may take.
_SECONDS = 60
# Isolated from the environment and the working folder, and importing from where this process does,
# however the package is installed.
_START = (
    "import sys; sys.path[:] = sys.argv[4:]; from rhytid.formats.exr_decoder import main; main()"
)
# Set by `decode_here`.
_begun: Callable[[str], None] | None = None
# The version of the format, and flags beside it in a header.
_VERSION, _TILED, _LONG_NAMES, _DEEP, _PARTS = 2, 0x200, 0x400, 0x800, 0x1000
# Attributes that are read of a header.
_NEEDED = ("channels", "dataWindow", "displayWindow")
# Types of texels by their numbers.
_TEXELS = {0: "uint", 1: "half", 2: "float"}
# Channels of colour images.
_COLOURS = {"R", "G", "B", "RY", "BY"}
# Bytes of a name, channels and attributes that are read of a header at most.
_MOST_NAME, _MOST_CHANNELS, _MOST_ATTRIBUTES = 255, 8, 10_000


def encode_exr(texels: Texels, header: TileHeader) -> bytes:
    """A map (h, w) of float32 or float16 as the bytes of a file, with the attributes of its
    header."""
    return b"".join(exr_parts(texels, header.attributes()))


def read_exr(path: Path) -> tuple[Texels, dict[str, object]]:
    """Channel `Y` (h, w) of a file, and the attributes; raises InputError where it is damaged."""
    return _read(str(path), path.name)


def decode_exr(data: bytes) -> tuple[Texels, dict[str, object]]:
    """Channel `Y` (h, w) of a file in memory, and the attributes; raises InputError as `read_exr`
    does."""
    return _read(io.BytesIO(data), "tile.exr")


def _read(source: str | io.BytesIO, name: str) -> tuple[Texels, dict[str, object]]:
    try:
        file = OpenEXR.File(source, separate_channels=True)
    except RuntimeError as exc:
        raise InputError(f"{name}: not a readable EXR file") from exc
    # A file that is cut short raises nothing: it just has no parts.
    channels = file.channels() if file.parts else {}
    if CHANNEL not in channels:
        raise InputError(f"{name}: a damaged EXR file, or one without a channel {CHANNEL}")
    texels: Texels = channels[CHANNEL].pixels
    return texels, dict(file.header())


def read_attributes(path: Path) -> dict[str, object]:
    """The attributes of a file, without its texels; raises InputError where it is damaged."""
    try:
        file = OpenEXR.File(str(path), header_only=True)
    except RuntimeError as exc:
        raise InputError(f"{path.name}: not a readable EXR file") from exc
    if not file.parts:
        raise InputError(f"{path.name}: a damaged EXR file")
    return dict(file.header())


def decode_here(begun: Callable[[str], None]) -> None:
    """From now on decode images in this process, not in one of their own.

    Only for a process that may crash without harm and has a limit of its memory.  begun: called
    with the name of each image before it is decoded.
    """
    global _begun
    _begun = begun


def decodes_here(name: str) -> bool:
    """Whether images are decoded in this process, as `decode_here` says; if so, `name` is next."""
    if _begun is not None:
        _begun(name)
    return _begun is not None


def read_grey_exr(data: bytes, name: str) -> NDArray[np.uint16]:
    """(h, w) codes of an OpenEXR image: its values times 65535, rounded; row 0 at the top.

    `name` is for messages. Raises InputError saying what is wrong, LimitError above MOST_SIDE
    texels per side, StorageError where the image cannot be written aside for the decoder. Values
    are taken as they are, whatever the channel is called.
    """
    width, height = read_sides(data, name)
    if decodes_here(name):
        return _decoded_here(data, name, width, height)
    try:
        answer = _decoded(data, width, height)
    except subprocess.TimeoutExpired as exc:
        raise InputError(f"{name}: not decoded within {_SECONDS} s") from exc
    try:
        wrong = _wrong(answer)
        if wrong is None:
            return np.frombuffer(answer, np.uint16, offset=len(b"null\n")).reshape(height, width)
    except (ValueError, RecursionError) as exc:  # it failed, or was made to answer something else
        raise InputError(f"{name}: a damaged EXR image") from exc
    raise _beyond(wrong, name)


def _beyond(wrong: BadTexel, name: str) -> InputError:
    place = f"the texel of column {wrong.column}, row {wrong.row}"
    return InputError(f"{name}: {place} is {wrong.value}: must be from 0 to 1")


def _decoded_here(data: bytes, name: str, width: int, height: int) -> NDArray[np.uint16]:
    with temporary_folder("rhytid-") as folder:
        path = folder / "map.exr"
        path.write_bytes(data)
        try:
            wrong, codes = decode(path, width, height)
        except MemoryError:
            raise
        except Exception as exc:
            raise InputError(f"{name}: a damaged EXR image") from exc
    if wrong is not None:
        raise _beyond(wrong, name)
    return codes


def _wrong(answer: bytes) -> BadTexel | None:
    """The texel that the first line of an answer names, None for a line without one; raises
    ValueError for any other line."""
    found = json.loads(answer[: answer.find(b"\n")])
    if found is None:
        return None
    if not (isinstance(found, list) and [type(part) for part in found] == [int, int, str]):
        raise ValueError("neither null nor a texel")
    return BadTexel(*found)


def _decoded(data: bytes, width: int, height: int) -> bytes:
    """The answer of the decoder after READY; empty where it fails."""
    return answer_of(_START, data, [str(width), str(height)], _SECONDS, "EXR")


def read_sides(data: bytes, name: str) -> tuple[int, int]:
    """Width and height of an OpenEXR image by its header; `name` is for messages.

    Raises InputError where the header is damaged, or not that of a grey map of half or float;
    LimitError above MOST_SIDE texels per side.
    """
    _, width, height = read_channels(data, name, 1, MOST_SIDE)
    return width, height


def read_channels(
    data: bytes, name: str, most: int, most_side: int
) -> tuple[tuple[str, ...], int, int]:
    """Names of the channels, width and height of an OpenEXR image by its header.

    most: channels that it may have.  most_side: texels per side. Raises InputError where the header
    is damaged, or names other texels than half or float; LimitError above `most_side`.
    """
    source = _Bytes(data, len(SIGNATURE))
    try:
        _check_flags(source.numbers("<I")[0], name)
        found = _attributes(source)
        names = _check_channels(found["channels"], name, most)
        return names, *_sides(found, name, most_side)
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


def _check_channels(channels: bytes, name: str, most: int) -> tuple[str, ...]:
    """Up to `most` channels, whatever their names, of half or float, with a value for every
    texel."""
    source = _Bytes(channels)
    found: list[tuple[str, tuple[int, ...]]] = []
    while len(found) < _MOST_CHANNELS and (channel := source.text()):
        found.append((channel, source.numbers("<iIii")))
    names = tuple(channel for channel, _ in found)
    if not 0 < len(found) <= most:
        what = "colours" if _COLOURS & set(names) and most == 1 else "not one channel"
        rule = "must be grey, one channel"
        if most > 1:
            what, rule = plural(len(names), "channel"), f"must have 1 to {most}"
        raise InputError(f"{name} has {what} ({', '.join(names)}): {rule}")
    for _, (kind, _, *every) in found:
        texels = _TEXELS.get(kind, f"type {kind}")
        if texels not in ("half", "float"):
            raise InputError(f"{name} has texels of {texels}: must be half or float")
        if every != [1, 1]:
            raise InputError(
                f"{name} has a value every {every[0]} x {every[1]} texels: must be 1 x 1"
            )
    return names


def _sides(found: dict[str, bytes], name: str, most_side: int) -> tuple[int, int]:
    """Both windows begin at the origin and are the same."""
    data, display = (_Bytes(found[w]).numbers("<4i") for w in ("dataWindow", "displayWindow"))
    if data[:2] != (0, 0) or data != display:
        windows = f"data window {data[:2]} to {data[2:]}, display window {display[:2]} to"
        rule = "must be the same, from (0, 0) on"
        raise InputError(f"{name} has {windows} {display[2:]}: {rule}")
    width, height = data[2] + 1, data[3] + 1
    check_sides(name, width, height, most_side)
    return width, height


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
