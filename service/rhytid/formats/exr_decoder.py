"""The process that decodes one grey OpenEXR image and ends; `grey_exr` starts it.

Crafted files have made decoders of the OpenEXR library write beyond their memory, so it meets
uploads only here. This is no jail: what is kept from the server is a crash, a loop without end and
a want of memory. It imports only what it needs, as it starts once per image. Arguments: path,
width, height. Standard output: READY once everything is imported, then a line of JSON, null or a
BadTexel, then the codes. How it ends is 0 only where all of that was written.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import OpenEXR
from numpy.typing import NDArray

READY = b"ready\n"
_MOST_CODE = 65535
_ROWS = 256  # rounded at a time
# How far outside 0 to 1 a value is taken for the nearest of them: what rounds to the same code;
# and where the compression changes values, what it may add (white becomes up to 1.016 by DWA at
# its usual level).
_ROUNDING, _LOSS = 0.5 / _MOST_CODE, 1 / 32
_LOSSY = {
    OpenEXR.B44_COMPRESSION,
    OpenEXR.B44A_COMPRESSION,
    OpenEXR.DWAA_COMPRESSION,
    OpenEXR.DWAB_COMPRESSION,
}
# Address space for an image, of bytes: as if it were one tile, unpacked several times over.
_ROOM, _ROOM_A_TEXEL = 256 << 20, 32
_ANSWER = 1 << 20  # bytes beside the codes


class BadTexel(NamedTuple):
    """A value that is not from 0 to 1, and where."""

    column: int
    row: int
    value: str


def main() -> None:
    """Decode the image that the arguments name; any exception or signal says that it is damaged."""
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # the library warns on standard output
    out.write(READY)
    out.flush()
    path, width, height = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
    limit_memory(width * height)
    wrong, codes = decode(Path(path), width, height)
    out.write(json.dumps(wrong).encode() + b"\n")
    if wrong is None:
        out.write(codes.data)
    out.flush()


def limit_memory(texels: int, nbytes: int | None = None) -> None:
    """Limit the address space of this process, and what it may write, to what an image of so many
    texels needs.

    nbytes: of its answer; None for codes of 16 bits. On Linux only: elsewhere there is no such
    limit, or none that holds.
    """
    if sys.platform == "linux":
        import resource

        pages = int(Path("/proc/self/statm").read_text().split()[0])
        most = pages * resource.getpagesize() + _ROOM + _ROOM_A_TEXEL * texels
        soft, hard = resource.getrlimit(resource.RLIMIT_AS)
        if soft == resource.RLIM_INFINITY or soft > most:
            resource.setrlimit(resource.RLIMIT_AS, (most, hard))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # nor fill the disk as it crashes
        written = _ANSWER + (2 * texels if nbytes is None else nbytes)
        resource.setrlimit(resource.RLIMIT_FSIZE, (written, written))


def decode(path: Path, width: int, height: int) -> tuple[BadTexel | None, NDArray[np.uint16]]:
    """The first value that is not from 0 to 1, or (height, width) codes: the values times 65535.

    Raises what the library raises, and ValueError where the image is not the one that its header
    promised.
    """
    file = OpenEXR.File(str(path), separate_channels=True)
    # A file that is cut short raises nothing: it just has no parts.
    values = [channel.pixels for channel in file.channels().values()] if file.parts else []
    if len(values) != 1 or values[0].shape != (height, width) or values[0].dtype.kind != "f":
        raise ValueError("not one channel of the size in the header")
    beyond = _LOSS if file.header()["compression"] in _LOSSY else _ROUNDING
    codes = np.empty((height, width), np.uint16)
    for top in range(0, height, _ROWS):
        rows = values[0][top : top + _ROWS].astype(np.float64)
        wrong = np.argwhere(~((rows >= -beyond) & (rows <= 1 + beyond)))
        if len(wrong):
            y, x = wrong[0].tolist()
            return BadTexel(x, top + y, str(values[0][top + y, x])), codes
        codes[top : top + _ROWS] = np.rint(rows.clip(0, 1) * _MOST_CODE)
    return None, codes
