"""OpenEXR images: written by the library, and byte by byte for what it does not write."""

from __future__ import annotations

import struct
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import OpenEXR
from numpy.typing import NDArray

HALF, FLOAT = 1, 2


def exr(texels: NDArray[Any], channel: str = "Y", **header: Any) -> bytes:
    """The bytes of an image of one channel; of tiles where `tiles` says their width and height."""
    if tiles := header.pop("tiles", None):
        header["tiles"] = OpenEXR.TileDescription()
        header["tiles"].xSize, header["tiles"].ySize = tiles
    kind = OpenEXR.tiledimage if tiles else OpenEXR.scanlineimage
    return exr_of({"compression": OpenEXR.ZIP_COMPRESSION, "type": kind, **header}, channel, texels)


def exr_of(header: dict[str, Any], channel: str, texels: NDArray[Any]) -> bytes:
    """The bytes of an image with a header and one channel, or one group of three."""
    return exr_file(OpenEXR.File({**header}, {channel: np.ascontiguousarray(texels)}))


def exr_file(file: Any) -> bytes:
    """The bytes that a file of the library writes."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "x.exr"
        file.write(str(path))
        return path.read_bytes()


def window(right: int, bottom: int, left: int = 0, top: int = 0) -> tuple[str, bytes]:
    return "box2i", struct.pack("<4i", left, top, right, bottom)


def channels(*names: str, kind: int = FLOAT, step: tuple[int, int] = (1, 1)) -> tuple[str, bytes]:
    every = (name.encode() + b"\0" + struct.pack("<iIii", kind, 0, *step) for name in names)
    return "chlist", b"".join(every) + b"\0"


PLAIN = {
    "channels": channels("Y"),
    "compression": ("compression", b"\0"),
    "dataWindow": window(1, 1),
    "displayWindow": window(1, 1),
}


def raw_header(flags: int = 2, **changed: tuple[str, bytes] | None) -> bytes:
    """A header of 2 x 2 texels, uncompressed float, with attributes changed, added or left out."""
    attributes = {name: value for name, value in {**PLAIN, **changed}.items() if value}
    parts = [b"\x76\x2f\x31\x01", struct.pack("<I", flags)]
    for name, (kind, value) in attributes.items():
        parts += [name.encode(), b"\0", kind.encode(), b"\0", struct.pack("<i", len(value)), value]
    return b"".join(parts) + b"\0"


def raw_exr(
    rows: tuple[bytes, ...] = (struct.pack("<ff", 0.0, 0.25), struct.pack("<ff", 0.5, 1.0)),
    order: tuple[int, ...] = (0, 1),
    **header: Any,
) -> bytes:
    """A file of blocks of one row each, stored in an order."""
    head = raw_header(**header)
    at, offsets, body = len(head) + 8 * len(rows), [0] * len(rows), b""
    for row in order:
        offsets[row] = at + len(body)
        body += struct.pack("<ii", row, len(rows[row])) + rows[row]
    return head + struct.pack(f"<{len(rows)}Q", *offsets) + body
