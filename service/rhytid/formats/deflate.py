"""Deflate of ISA-L, level 1, whose bytes follow from the data alone.

Level 0 is 13 to 40 % larger, level 3 takes a tenth to a third longer for 1 % or nothing. Level 1 of
zlib takes four times as long for files of the same size.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from dataclasses import dataclass

from isal import isal_zlib

_LEVEL = 1
# ISA-L 2.32 hashes part of the address of its state, where it wants the third byte of a stream, and
# misses a match or not by that: the same data differ by some bytes from process to process. It does
# so only where the loop for long inputs takes the first byte. Up to 16 bytes go through another
# loop, so they are flushed before the rest.
_FIRST = 16
# Of a zlib stream of 32 KiB of memory, at its fast level.
_HEAD = b"\x78\x01"
# Bits of the memory of a stream; below 0 for one without head and checksum.
_ZLIB, _RAW = 15, -15
# The checksum of zlib counts modulo this (RFC 1950).
_ADLER = 65521


def deflated(data: bytes | memoryview) -> bytes:
    """A zlib stream (RFC 1950) of these bytes."""
    return _compressed(data, _ZLIB, isal_zlib.Z_FINISH)


@dataclass(frozen=True)
class Section:
    """Some bytes as a section of a zlib stream, which any thread makes by itself.

    data: compressed.  adler: the checksum of the bytes.  count: of them.
    """

    data: bytes
    adler: int
    count: int

    @classmethod
    def of(cls, data: memoryview, *, first: bool, last: bool) -> Section:
        """first, last: whether these are the first and the last bytes of the stream."""
        flush = isal_zlib.Z_FINISH if last else isal_zlib.Z_SYNC_FLUSH
        head = _HEAD if first else b""
        return cls(head + _compressed(data, _RAW, flush), isal_zlib.adler32(data), len(data))


def end_of(sections: Iterable[Section]) -> bytes:
    """The end of the stream that sections make up, one after the other: the checksum of all."""
    low, high = 1, 0
    for one in sections:
        high = (high + (one.adler >> 16) + one.count * (low - 1)) % _ADLER
        low = (low + (one.adler & 0xFFFF) - 1) % _ADLER
    return struct.pack(">HH", high, low)


def _compressed(data: bytes | memoryview, bits: int, flush: int) -> bytes:
    stream = isal_zlib.compressobj(_LEVEL, isal_zlib.DEFLATED, bits)
    view = memoryview(data)
    first = stream.compress(view[:_FIRST]) + stream.flush(isal_zlib.Z_SYNC_FLUSH)
    return b"".join([first, stream.compress(view[_FIRST:]), stream.flush(flush)])
