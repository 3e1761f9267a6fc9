"""The writers of the profiles. Each takes the path, the map, and the facts of its profile."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.formats.exr import write_exr
from rhytid.formats.png import encode_png
from rhytid.formats.tiles import quantise
from rhytid.support.atomic_files import atomic_write, write_file
from rhytid.textures.cavity import cavity_map
from rhytid.textures.frame_map import Facts, FrameMap, attributes
from rhytid.textures.normals import normal_map
from rhytid.textures.tiled import levels_of, write_tiled
from rhytid.textures.weights import FULL, weight_map

Codes = NDArray[np.uint8] | NDArray[np.uint16]
_WHITE, _MIDDLE = 65535, 32768


def plain_facts(map: FrameMap) -> Facts:
    """For files of floats: displacement in mesh units as it is."""
    return {"scale": 1.0, "midlevel": 0.0}


def png16_facts(map: FrameMap) -> Facts:
    """Displacement is (p - 32768) / 32767 times `scale`; in a program that has 0 to 1 for black to
    white, (value - `midlevel`) times `range`."""
    full = map.header.scale * _WHITE / (_MIDDLE - 1)
    return {"scale": map.header.scale, "midlevel": _MIDDLE / _WHITE, "range": full}


def normal_gl_facts(map: FrameMap) -> Facts:
    """Normals are 2 value - 1, green along v."""
    return {"scale": 1.0, "midlevel": 0.5, "green": "up"}


def normal_dx_facts(map: FrameMap) -> Facts:
    """Normals are 2 value - 1, green against v."""
    return {"scale": 1.0, "midlevel": 0.5, "green": "down"}


def cavity_facts(map: FrameMap) -> Facts:
    """How far a texel lies below its surroundings is (1 - value) times `scale`."""
    return {"scale": map.depth, "midlevel": 1.0}


def weight_facts(map: FrameMap) -> Facts:
    """Red is stretch, green compression: |log ratio| of lengths is value times `scale`."""
    return {"scale": FULL, "midlevel": 0.0, "red": "stretch", "green": "compression"}


def write_float(path: Path, map: FrameMap, facts: Facts) -> None:
    """OpenEXR of floats; padded next to islands."""
    heights = map.bordered()
    write_exr(path, heights, map.header, attributes(map.header, facts, heights))


def write_half(path: Path, map: FrameMap, facts: Facts) -> None:
    """OpenEXR of half floats; padded next to islands."""
    heights = map.bordered().astype(np.float16)
    write_exr(path, heights, map.header, attributes(map.header, facts, heights))


def write_mipmapped(path: Path, map: FrameMap, facts: Facts) -> None:
    """OpenEXR of floats in tiles, with levels; padded."""
    heights = map.padded()
    with atomic_write(path) as aside:
        write_tiled(aside, levels_of(heights), attributes(map.header, facts, heights))


def write_png16(path: Path, map: FrameMap, facts: Facts) -> None:
    """Grey PNG of 16 bits, 0 at code 32768, said to be linear; padded."""
    heights = map.padded()
    _png(path, quantise(heights, map.header.scale), map, facts, heights, linear=True)


def write_normals(path: Path, map: FrameMap, facts: Facts) -> None:
    """RGB PNG of 16 bits."""
    normals = normal_map(map.heights(), map.chart(), map.posed())
    if facts["green"] == "down":
        normals[..., 1] *= -1.0
    codes = np.rint((normals * 0.5 + 0.5) * _WHITE).astype(np.uint16)
    _png(path, codes, map, facts, normals)


def write_cavity(path: Path, map: FrameMap, facts: Facts) -> None:
    """Grey PNG of 8 bits: white is as high as its surroundings or higher, black lower by the depth
    of a furrow of strength 1, or more."""
    values = cavity_map(map.heights(), map.chart(), map.depth)
    _png(path, _bytes(values), map, facts, values)


def write_weights(path: Path, map: FrameMap, facts: Facts) -> None:
    """RGB PNG of 8 bits: stretch, compression, 0."""
    values = weight_map(map.chart(), map.weights())
    codes = np.zeros((*values.shape[:2], 3), np.uint8)
    codes[..., :2] = _bytes(values)
    _png(path, codes, map, facts, values)


def _bytes(values: NDArray[np.float32]) -> NDArray[np.uint8]:
    codes: NDArray[np.uint8] = np.rint(values * 255.0).astype(np.uint8)
    return codes


def _png(
    path: Path,
    codes: Codes,
    map: FrameMap,
    facts: Facts,
    values: NDArray[Any],
    linear: bool = False,
) -> None:
    texts = {name: str(v) for name, v in attributes(map.header, facts, values).items()}
    with atomic_write(path) as aside:
        write_file(aside, encode_png(codes, texts, linear))
