"""Grey OpenEXR images: one channel of half or float from 0 to 1, which becomes codes of 16 bits.

0.5 becomes 32768 of 65535: mid grey. Scan lines or tiles, uncompressed or compressed as ZIP or
ZIPS, which zlib unpacks. `exr_header` says why no other library reads them.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rhytid.errors import InputError
from rhytid.formats.exr_header import Damaged, Header, read_header

_MOST_CODE = 65535
_OFFSET = np.dtype("<u8")
Block = tuple[slice, slice]


def read_grey_exr(data: bytes, name: str) -> NDArray[np.uint16]:
    """(h, w) codes of an OpenEXR image: its values times 65535, rounded; row 0 at the top.

    `name` is for messages. Raises InputError saying what is wrong, and LimitError above MOST_SIDE
    texels a side. Values are taken as they are, whatever the channel is called.
    """
    try:
        header = read_header(data, name)
        offsets = _offsets(data, header)
        codes = np.empty((header.height, header.width), np.uint16)
        for number, block in enumerate(_blocks(header)):
            values = _values(data, header, int(offsets[number]), block)
            _check_range(values, block, name)
            codes[block] = np.rint(values.astype(np.float64) * _MOST_CODE)
    except (Damaged, zlib.error) as exc:
        raise InputError(f"{name}: a damaged OpenEXR image: {exc}") from exc
    return codes


def _blocks(header: Header) -> Iterator[Block]:
    """Rows and columns of every block, in the order of their offsets."""
    for top in range(0, header.height, header.down):
        rows = slice(top, min(top + header.down, header.height))
        for left in range(0, header.width, header.across):
            yield rows, slice(left, min(left + header.across, header.width))


def _offsets(data: bytes, header: Header) -> NDArray[np.uint64]:
    """Where every block begins."""
    count = -(-header.height // header.down) * -(-header.width // header.across)
    if len(data) < header.end + count * _OFFSET.itemsize:
        raise Damaged(f"cut short before its {count} blocks")
    return np.frombuffer(data, _OFFSET, count, header.end)


def _values(data: bytes, header: Header, offset: int, block: Block) -> NDArray[np.floating]:
    """(rows, columns) of a block, half or float."""
    rows, columns = block
    shape = rows.stop - rows.start, columns.stop - columns.start
    texels = np.dtype(header.dtype)
    packed = _packed(data, header, offset, block)
    plain = _unpacked(packed, shape[0] * shape[1] * texels.itemsize, header.zip)
    return np.frombuffer(plain, texels).reshape(shape)


def _packed(data: bytes, header: Header, offset: int, block: Block) -> memoryview:
    """The bytes of a block, which begins with its place and their number."""
    top, left = (part.start for part in block)
    place: tuple[int, ...] = (top,)
    if header.tiled:  # the last two are the level
        place = left // header.across, top // header.down, 0, 0
    layout = f"<{len(place) + 1}i"
    begin = offset + struct.calcsize(layout)
    if begin > len(data):
        raise Damaged(f"the block of row {top} is not there")
    *found, size = struct.unpack_from(layout, data, offset)
    if tuple(found) != place or not 0 <= size <= len(data) - begin:
        raise Damaged(f"the block of row {top} is not there, or cut short")
    return memoryview(data)[begin : begin + size]


def _unpacked(packed: memoryview, whole: int, zip: bool) -> bytes:
    """The `whole` bytes of a block. What would not become smaller is stored as it is."""
    if len(packed) == whole:
        return bytes(packed)
    if not zip or len(packed) > whole:
        raise Damaged(f"a block has {len(packed)} bytes for {whole}")
    stream = zlib.decompressobj()
    steps = np.frombuffer(stream.decompress(packed, whole + 1), np.uint8)
    if len(steps) != whole or not stream.eof:
        raise Damaged(f"a block does not unpack to {whole} bytes")
    # Every byte but the first is a step from the one before it, plus 128; and the first half are
    # the bytes at even places, the other half those at odd ones.
    halves: NDArray[np.uint8] = np.cumsum(steps - np.uint8(128), dtype=np.uint8) + np.uint8(128)
    plain: bytes = halves.reshape(2, -1).T.tobytes()
    return plain


def _check_range(values: NDArray[np.floating], block: Block, name: str) -> None:
    wrong = np.argwhere(~((values >= 0) & (values <= 1)))
    if len(wrong):
        y, x = wrong[0].tolist()
        place = f"the texel of column {block[1].start + x}, row {block[0].start + y}"
        raise InputError(f"{name}: {place} is {values[y, x]!s}: must be from 0 to 1")
