"""Painted maps, of stiffness and of synthesis, as grey images.

One code per texel, from 0 (black) to the largest (white); row 0 is the top, v = 1 of the UDIM. PNG
of 8 or 16 bits, or OpenEXR of one channel from 0 to 1, known by their first bytes. The UDIM of each
is in its file name: `anything.1002.png` or `.exr`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import PurePath

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.painted_maps import Controls, Map, Stiffness, check_total, check_udim
from rhytid.errors import InputError

_NUMBER = re.compile(r"(?:^|[._])([0-9]{4})\.[A-Za-z]+$")


def read_painted(
    files: Sequence[tuple[str, bytes]], udims: Sequence[int], kind: str, before: Sequence[Map] = ()
) -> dict[int, NDArray[np.unsignedinteger]]:
    """Painted maps by UDIM.

    files: (file name or path, bytes) of each image.  udims: those of the mesh.  kind: what the maps
    are, for messages.  before: maps that count towards the limit, too.

    The four digits before the extension are the UDIM. A lone image without them is that of the only
    UDIM of the mesh. Raises InputError naming the image that belongs to no UDIM or cannot be read,
    LimitError where the maps are too large.
    """
    maps: dict[int, NDArray[np.unsignedinteger]] = {}
    for udim, (name, data) in _places(files, udims, kind).items():
        maps[udim] = read_grey(data, name)
        check_total((*before, *maps.values()), name, "control" if before else kind)
    return maps


def _places(
    files: Sequence[tuple[str, bytes]], udims: Sequence[int], kind: str
) -> dict[int, tuple[str, bytes]]:
    places: dict[int, tuple[str, bytes]] = {}
    for file in files:
        udim = _udim(file[0], len(files) == 1, udims, kind)
        check_udim(udim, udims, file[0])
        if udim in places:
            raise InputError(f"{file[0]} and {places[udim][0]} are both of UDIM {udim}")
        places[udim] = file
    return places


def _udim(name: str, alone: bool, udims: Sequence[int], kind: str) -> int:
    number = _NUMBER.search(PurePath(name).name)
    if number is not None:
        return int(number[1])
    if alone and len(udims) == 1:
        return udims[0]
    have = ", ".join(str(udim) for udim in udims)
    rule = f"name every image by its UDIM, as in {kind}.1001.png"
    raise InputError(f"{name} names no UDIM; the mesh has {have}: {rule}")


def read_stiffness(files: Sequence[tuple[str, bytes]], udims: Sequence[int]) -> Stiffness:
    """The stiffness maps of images, (file name or path, bytes) each, for a mesh with these UDIMs.

    Raises as `read_painted` does.
    """
    return Stiffness(read_painted(files, udims, "stiffness"))


def read_controls(
    files: Mapping[str, Sequence[tuple[str, bytes]]], udims: Sequence[int]
) -> Controls | None:
    """The control maps of images, (file name or path, bytes) each by the name of the control; None
    where there are no images.

    Raises as `read_painted` does.
    """
    maps: dict[str, dict[int, Map]] = {}
    before: list[Map] = []
    for name, images in files.items():
        maps[name] = read_painted(images, udims, name, before)
        before += maps[name].values()
    return Controls(maps) if maps else None


def read_grey(data: bytes, name: str) -> NDArray[np.unsignedinteger]:
    """The codes (h, w) of a grey image: uint8 or uint16 of a PNG, uint16 of an OpenEXR.

    `name` is for messages. Raises InputError where the image is damaged or not grey, and LimitError
    above MOST_SIDE texels per side.
    """
    # Imported here: their libraries take longer than to check a mesh.
    from rhytid.formats import exr, png

    if data.startswith(png.SIGNATURE):
        return png.read_grey_png(data, name)
    if data.startswith(exr.SIGNATURE):
        return exr.read_grey_exr(data, name)
    raise InputError(f"{name}: not a PNG or OpenEXR image")
