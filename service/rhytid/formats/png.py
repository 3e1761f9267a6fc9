"""PNG files of 8 or 16 bits: grey or RGB with texts are written, grey ones are read.

They are written here since Pillow writes no RGB of 16 bits. When one is read, what an image library
would convert without a word (colours, palettes, few bits) is refused.

After the PNG specification, third edition, https://www.w3.org/TR/png-3/
"""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from isal import isal_zlib
from numpy.typing import NDArray

from rhytid.errors import InputError
from rhytid.formats.deflate import Section, end_of
from rhytid.formats.limits import check_sides
from rhytid.support.cores import on_all_cores

if TYPE_CHECKING:
    from PIL import Image

SIGNATURE = b"\x89PNG\r\n\x1a\n"
# Colour types of the header by channels, and the filter that stores differences to the row above.
_COLOURS, _UP = {1: 0, 3: 2}, 2
_GAMMA_1 = 100_000
# Bytes of texels that a core works on at a time, which stay in its cache.
_STRIP = 1 << 19
# The length and the name of the first chunk follow the signature.
_HEADER = SIGNATURE + b"\x00\x00\x00\x0dIHDR"
_HEADER_BYTES = 29
# The errors of the library for a chunk that is too short or malformed.
_DAMAGED = (OSError, SyntaxError, ValueError, EOFError, IndexError, TypeError, struct.error)
PALETTE = 3
# Channels by colour type; what is not here has one.
_CHANNELS = {2: 3, 4: 2, 6: 4}
_KINDS = {2: "colours", 3: "a palette", 4: "transparency", 6: "colours and transparency"}


def encode_png(
    texels: NDArray[np.uint8] | NDArray[np.uint16],
    texts: Mapping[str, str],
    linear: bool = False,
) -> bytes:
    """The bytes of a file, as `png_parts` has them."""
    return b"".join(png_parts(texels, texts, linear))


def png_parts(
    texels: NDArray[np.uint8] | NDArray[np.uint16],
    texts: Mapping[str, str],
    linear: bool = False,
) -> list[bytes]:
    """The bytes of a file, in parts.

    texels: (h, w) grey or (h, w, 3) RGB, row 0 at the top.  texts: by Latin keywords of up to 79
    letters.  linear: mark the values as proportional to what they stand for, by a gamma of 1;
    without it readers assume sRGB. Raises InputError for another shape or type.
    """
    rows = texels[..., None] if texels.ndim == 2 else texels
    kinds = (np.uint8, np.uint16)
    if rows.ndim != 3 or rows.shape[2] not in _COLOURS or not rows.size or rows.dtype not in kinds:
        raise InputError(f"no PNG of {texels.dtype} {texels.shape}: grey or RGB of 8 or 16 bits")
    height, width, channels = rows.shape
    bits = 8 * rows.dtype.itemsize
    head = struct.pack(">IIBBBBB", width, height, bits, _COLOURS[channels], 0, 0, 0)
    notes = (_chunk(b"iTXt", _text(name, text)) for name, text in texts.items())
    gamma = [_chunk(b"gAMA", struct.pack(">I", _GAMMA_1))] if linear else []
    header = [SIGNATURE, _chunk(b"IHDR", head), *gamma, *notes]
    return [*header, *_image(rows), _chunk(b"IEND", b"")]


def renamed(data: bytes, keyword: str, text: str) -> list[bytes]:
    """A file of `encode_png` with another text for a keyword, in parts. Raises ValueError where it
    has no such text."""
    mark = b"iTXt" + keyword.encode("latin-1") + b"\0"
    start = data.index(mark, 0, data.index(b"IDAT")) - 4
    end = start + 12 + int.from_bytes(data[start : start + 4], "big")
    return [data[:start], _chunk(b"iTXt", _text(keyword, text)), data[end:]]


def _image(rows: NDArray[np.uint8] | NDArray[np.uint16]) -> list[bytes]:
    """The chunks of some rows, of which a core compresses a strip at a time."""
    height = len(rows)
    step = max(_STRIP // max(rows[:1].nbytes, 1), 1)

    def strip(start: int) -> tuple[bytes, Section]:
        stop = min(start + step, height)
        filtered = _filtered(rows, start, stop).reshape(-1)
        section = Section.of(filtered.data, first=start == 0, last=stop == height)
        return _chunk(b"IDAT", section.data), replace(section, data=b"")

    strips = on_all_cores(strip, range(0, height, step))
    return [*(chunk for chunk, _ in strips), _chunk(b"IDAT", end_of(s for _, s in strips))]


def _filtered(
    rows: NDArray[np.uint8] | NDArray[np.uint16], start: int, stop: int
) -> NDArray[np.uint8]:
    """Rows `start` to `stop` as bytes, high byte first, less those of the row above, each after its
    filter."""
    above = max(start - 1, 0)
    some = rows[above:stop]
    high_first = some.astype(some.dtype.newbyteorder(">"), copy=False)
    plain = np.ascontiguousarray(high_first).view(np.uint8).reshape(len(some), -1)
    out = np.empty((stop - start, plain.shape[1] + 1), np.uint8)
    out[:, 0] = _UP
    if start == 0:
        out[0, 1:] = plain[0]
    np.subtract(plain[1:], plain[:-1], out=out[above + 1 - start :, 1:])
    return out


def _text(name: str, text: str) -> bytes:
    return name.encode("latin-1") + b"\0\0\0\0\0" + text.encode()


def _chunk(kind: bytes, data: bytes) -> bytes:
    check = struct.pack(">I", isal_zlib.crc32(data, isal_zlib.crc32(kind)))
    return b"".join([struct.pack(">I", len(data)), kind, data, check])


def read_grey_png(data: bytes, name: str) -> NDArray[np.unsignedinteger]:
    """The codes (h, w) of a grey PNG, uint8 or uint16 by its bits, row 0 at the top.

    `name` is for messages. Raises InputError where the image is damaged or not grey, and LimitError
    above MOST_SIDE texels per side. Codes are taken as they are, whatever the gamma and colour
    profile.
    """
    bits = _checked_layout(data, name).bits
    with _naming(name):
        _open(data).verify()  # every chunk and its checksum, to the end
        image = _open(data)
        image.load()
    if "transparency" in image.info:
        raise InputError(f"{name} has {_KINDS[4]}: must be grey")
    # 16 bits are `I;16` or `I` by the version of the library; their numbers are the same.
    codes: NDArray[np.unsignedinteger] = np.asarray(image).astype(f"u{bits // 8}", copy=False)
    return codes


def read_sides(data: bytes, name: str) -> tuple[int, int]:
    """Width and height of a PNG by its header; raises as `read_grey_png` does."""
    found = _checked_layout(data, name)
    return found.width, found.height


@dataclass(frozen=True)
class PngLayout:
    """What the header of a PNG says: its sides, the bits of a channel and the colour type."""

    width: int
    height: int
    bits: int
    kind: int

    @property
    def channels(self) -> int:
        """How many a texel has."""
        return _CHANNELS.get(self.kind, 1)


def read_layout(data: bytes, name: str) -> PngLayout:
    """The header of a PNG of any kind; raises InputError where it is damaged."""
    if not data.startswith(_HEADER) or len(data) < _HEADER_BYTES:
        raise InputError(f"{name}: a damaged PNG image")
    width, height, bits, kind = struct.unpack_from(">IIBB", data, 16)
    return PngLayout(width, height, bits, kind)


def read_texts(data: bytes, name: str) -> dict[str, str]:
    """The texts of a PNG by their keys; raises InputError where it is damaged."""
    with _naming(name), _open(data) as image:
        image.load()
        return {key: str(text) for key, text in getattr(image, "text", {}).items()}


def _checked_layout(data: bytes, name: str) -> PngLayout:
    """The header of a grey PNG that is not too large."""
    found = read_layout(data, name)
    bits, kind = found.bits, found.kind
    if kind != 0:
        raise InputError(f"{name} has {_KINDS.get(kind, f'colour type {kind}')}: must be grey")
    if bits not in (8, 16):
        raise InputError(f"{name} has {bits} bits per texel: must be 8 or 16")
    check_sides(name, found.width, found.height)
    return found


def _open(data: bytes) -> Image.Image:
    from PIL import Image  # here, since few processes that write images read any

    return Image.open(io.BytesIO(data), formats=["PNG"])


@contextmanager
def _naming(name: str) -> Iterator[None]:
    """Within the block, raise the errors of the library for a damaged file as InputError."""
    from PIL import UnidentifiedImageError

    try:
        yield
    except UnidentifiedImageError as exc:  # its text is an address in memory
        raise InputError(f"{name}: a damaged PNG image") from exc
    except _DAMAGED as exc:
        raise InputError(f"{name}: a damaged PNG image: {exc}") from exc
