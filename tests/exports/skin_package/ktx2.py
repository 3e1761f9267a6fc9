"""A plain reader of KTX 2.0, written apart from the writer: no supercompression, one face."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

DTYPES = {10: "i1", 74: "<u2", 98: "<u4"}


@dataclass(frozen=True)
class Texture:
    """levels: (layers, rows, columns), finest first.  keys: metadata.  channel: of the first
    sample: type and flags, lower and upper."""

    format: int
    levels: list[NDArray[Any]]
    keys: dict[str, str]
    channel: tuple[int, int, int]


def read_ktx2(file: Path) -> Texture:
    data = file.read_bytes()
    assert data[:12] == bytes([0xAB, 0x4B, 0x54, 0x58, 0x20, 0x32, 0x30, 0xBB, 13, 10, 26, 10])
    kind, size, width, height, depth, layers, faces, count, scheme = struct.unpack_from(
        "<9I", data, 12
    )
    assert (depth, faces, scheme) == (0, 1, 0)
    dtype = np.dtype(DTYPES[kind])
    assert size == dtype.itemsize
    described, described_size, keys, keys_size, extra, extra_size = struct.unpack_from(
        "<4I2Q", data, 48
    )
    assert (extra, extra_size) == (0, 0)
    levels = []
    for level in range(count):
        start, length, plain = struct.unpack_from("<3Q", data, 80 + 24 * level)
        assert length == plain
        assert start % 4 == 0
        shape = (layers, max(height >> level, 1), max(width >> level, 1))
        levels.append(np.frombuffer(data, dtype, length // size, start).reshape(shape))
    assert struct.unpack_from("<I", data, described)[0] == described_size
    sample = struct.unpack_from("<H6B2i", data, described + 28)
    return Texture(kind, levels, _keys(data[keys : keys + keys_size]), (sample[2], *sample[7:]))


def _keys(data: bytes) -> dict[str, str]:
    found = {}
    while data:
        (length,) = struct.unpack_from("<I", data)
        name, value, _ = data[4 : 4 + length].split(b"\0")
        found[name.decode()] = value.decode()
        data = data[4 + length + -length % 4 :]
    return found
