"""Textures as a renderer reads them: by OpenImageIO, which shares no code with what wrote them."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray


class Texture(NamedTuple):
    """texels (h, w, channels) as they are stored, of one level; levels: (width, tile) of each."""

    texels: NDArray[Any]
    attributes: dict[str, Any]
    channels: tuple[str, ...]
    levels: list[tuple[int, int]]


def read_texture(path: Path, level: int = 0) -> Texture:
    found = oiio.ImageInput.open(str(path))
    assert found is not None, oiio.geterror()
    levels = []
    while found.seek_subimage(0, len(levels)):
        spec = found.spec()
        levels.append((spec.width, spec.tile_width))
    assert found.seek_subimage(0, level)
    spec = found.spec()
    texels = found.read_image(0, level, 0, spec.nchannels, spec.format)
    assert texels is not None, found.geterror()
    attributes = {attribute.name: attribute.value for attribute in spec.extra_attribs}
    return Texture(np.asarray(texels), attributes, tuple(spec.channelnames), levels)
