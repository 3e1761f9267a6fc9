"""Painted maps as grey images, the UDIM of each in its file name: `anything.1002.png`."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.painted import MOST_TEXELS
from rhytid.errors import InputError, LimitError
from rhytid.formats.grey import read_grey

_NUMBER = re.compile(r"(?:^|[._])([0-9]{4})\.[A-Za-z]+$")


def read_painted(
    files: Sequence[tuple[str, bytes]], udims: Sequence[int], what: str, most: int = MOST_TEXELS
) -> dict[int, NDArray[np.float32]]:
    """The maps of images by UDIM, (file name, bytes) each, for a mesh with these UDIMs.

    The four digits before the extension are the UDIM. A lone image without them is that of the
    only UDIM of the mesh. Raises InputError naming the image that has no place or cannot be read,
    LimitError over what is too large.
    """
    maps: dict[int, NDArray[np.float32]] = {}
    for udim, (name, data) in _places(files, udims, what).items():
        maps[udim] = read_grey(data, name)
        if sum(map.size for map in maps.values()) > most:
            raise LimitError(f"{what} maps of more than {most} texels in all")
    return maps


def _places(
    files: Sequence[tuple[str, bytes]], udims: Sequence[int], what: str
) -> dict[int, tuple[str, bytes]]:
    places: dict[int, tuple[str, bytes]] = {}
    for file in files:
        udim = _udim(file[0], len(files) == 1, udims, what)
        if udim in places:
            raise InputError(f"{file[0]} and {places[udim][0]} are both of UDIM {udim}")
        places[udim] = file
    return places


def _udim(name: str, alone: bool, udims: Sequence[int], what: str) -> int:
    have = ", ".join(str(udim) for udim in udims)
    number = _NUMBER.search(name)
    if number is None:
        if alone and len(udims) == 1:
            return udims[0]
        rule = f"name every image by its UDIM, as in {what}.1001.png"
        raise InputError(f"{name} names no UDIM; the mesh has {have}: {rule}")
    if int(number[1]) not in udims:
        raise InputError(f"{name} is of UDIM {number[1]}, which has no mesh; the mesh has {have}")
    return int(number[1])
