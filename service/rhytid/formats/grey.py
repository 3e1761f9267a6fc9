"""Grey images: painted maps of one code a texel, from 0 (black) to the largest (white).

PNG of 8 or 16 bits, or OpenEXR of one channel from 0 to 1, told apart by their first bytes. Row 0
is the top, v = 1 of the UDIM.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rhytid.errors import InputError
from rhytid.formats import exr_header, grey_png
from rhytid.formats.grey_exr import read_grey_exr


def read_grey(data: bytes, name: str) -> NDArray[np.unsignedinteger]:
    """(h, w) codes of the bytes of an image: uint8 or uint16 of a PNG, uint16 of an OpenEXR.

    `name` is for messages. Raises InputError saying what is wrong, and LimitError above MOST_SIDE
    texels per side.
    """
    if data.startswith(grey_png.SIGNATURE):
        return grey_png.read_grey_png(data, name)
    if data.startswith(exr_header.SIGNATURE):
        return read_grey_exr(data, name)
    raise InputError(f"{name}: not a PNG or OpenEXR image")
