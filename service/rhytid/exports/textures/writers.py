"""The writers of the profiles: each takes the path, the map and the facts of its profile, and
returns the SHA-256 of the file, but where a library has written it.

Tiled, mipmapped OpenEXR is written through OpenImageIO, with levels that are given (extra `tx`).
"""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.wording import install_hint
from rhytid.errors import InputError, StorageError
from rhytid.exports.textures.frame_map import Chart, Facts, FrameMap, attributes
from rhytid.exports.textures.square_sums import Sums, with_square_sums
from rhytid.formats.exr_encoder import Texels, exr_body
from rhytid.formats.png import png_parts
from rhytid.formats.tiles import quantise
from rhytid.support.atomic_files import atomic_write, storage_errors, write_hashed

Codes = NDArray[np.uint8] | NDArray[np.uint16]
FloatMap = NDArray[np.float32]
_WHITE, _MIDDLE, _WHITE_8 = 65535, 32768, 255
# Texels a side of a tile in the file, as `maketx` has them.
_TILE = 64
# Marks a file that has levels already, so that no tool makes them again; and says what a renderer's
# texture system reads beyond the border.
_TEXTURE = {"textureformat": "Plain Texture", "wrapmodes": "clamp,clamp", "compression": "zip"}


def plain_facts(map: FrameMap) -> Facts:
    """Facts of files of floats: texels are the displacement in mesh units."""
    return {"scale": 1.0, "midlevel": 0.0}


def png16_facts(map: FrameMap) -> Facts:
    """Facts of png16: displacement is (p - 32768) / 32767 times `scale`.

    In a program that has 0 to 1 for black to white it is (value - `midlevel`) times `range`.
    """
    full = map.header.scale * _WHITE / (_MIDDLE - 1)
    return {"scale": map.header.scale, "midlevel": _MIDDLE / _WHITE, "range": full}


def cavity_facts(map: FrameMap) -> Facts:
    """Facts of cavity: a texel lies (1 - value) times `scale` below its surroundings."""
    return {"scale": map.depth, "midlevel": 1.0}


def write_float(path: Path, map: FrameMap, facts: Facts, compression: str = "zip") -> str:
    """Write OpenEXR of floats, padded next to islands."""
    return _write_bordered(path, map, map.heights(), facts, "float32", compression)


def write_half(path: Path, map: FrameMap, facts: Facts, compression: str = "zip") -> str:
    """Write OpenEXR of half floats, padded next to islands."""
    return _write_bordered(path, map, map.halves(), facts, "float16", compression)


def _write_bordered(
    path: Path,
    map: FrameMap,
    texels: Texels,
    facts: Facts,
    dtype: str,
    compression: str,
) -> str:
    padding = map.padding()

    def rows(start: int, stop: int) -> Texels:
        return padding.rows(texels, start, stop)

    body = exr_body(rows, (len(texels), texels.shape[1]), dtype, compression)
    return write_parts(path, body.parts(attributes(map.header, facts, body.minimum, body.maximum)))


def write_parts(path: Path, parts: Iterable[bytes]) -> str:
    """Write a file that comes in parts, whole or not at all; returns its SHA-256. Raises
    StorageError."""
    with storage_errors(f"{path} cannot be written"), atomic_write(path) as aside:
        return write_hashed(aside, parts)


def write_mipmapped(path: Path, map: FrameMap, facts: Facts) -> None:
    """Write OpenEXR of floats in tiles, with levels; padded."""
    heights = map.padded()
    with atomic_write(path) as aside:
        ends = heights.min(), heights.max()
        write_tiled(aside, levels_of(heights), attributes(map.header, facts, *ends))


def write_png16(path: Path, map: FrameMap, facts: Facts) -> str:
    """Write a grey PNG of 16 bits, 0 at code 32768, marked as linear; padded."""
    return write_signed(path, map.padded(), map.header.scale, map, facts)


def write_signed(path: Path, values: FloatMap, scale: float, map: FrameMap, facts: Facts) -> str:
    """Write values (R, R) within ±scale as a grey PNG of 16 bits, 0 at code 32768, marked as
    linear."""
    return write_png(path, quantise(values, scale), map, facts, values, linear=True)


def write_cavity(path: Path, map: FrameMap, facts: Facts) -> str:
    """Write a grey PNG of 8 bits: white is as high as its surroundings or higher, black lower by
    the depth of a furrow of strength 1, or more."""
    codes, least = cavity_codes(map.heights(), map.chart(), map.depth)
    # The highest texel of all is no lower than those around it.
    return write_png(path, codes, map, facts, (least, 1.0))


def as_bytes(values: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Values from 0 to 1 as codes of 8 bits."""
    codes: NDArray[np.uint8] = np.rint(values * 255.0).astype(np.uint8)
    return codes


def write_png(
    path: Path,
    codes: Codes,
    map: FrameMap,
    facts: Facts,
    values: Sequence[float] | NDArray[Any],
    linear: bool = False,
) -> str:
    """Write codes as PNG with attributes; `minimum` and `maximum` are of the values."""
    ends = np.min(values), np.max(values)
    texts = {name: str(v) for name, v in attributes(map.header, facts, *ends).items()}
    with atomic_write(path) as aside:
        return write_hashed(aside, png_parts(codes, texts, linear))


def cavity_codes(
    heights: NDArray[np.float32], chart: Chart, depth: float
) -> tuple[NDArray[np.uint8], float]:
    """(R, R) codes, 255 for texels no lower than the mean around them, to 0, lower by `depth` or
    more; and the least value before rounding, 0 to 1.

    heights, depth: mesh units. Texels outside of the islands do not count in the mean. In the
    padding a texel has the value of the nearest texel inside, beyond it 1.
    """
    inside, counts = chart.inside, chart.inside_around
    codes, lows = np.empty(heights.shape, np.uint8), list[float]()

    def found(sums: Sums) -> None:
        first, total = sums
        rows = slice(first, first + len(total))
        total /= counts[rows]
        np.subtract(heights[rows], total, out=total)
        total /= depth
        np.clip(total, -1.0, 0.0, out=total)
        total += 1.0
        lows.append(float(np.where(inside[rows], total, 1.0).min()))
        total *= _WHITE_8
        codes[rows] = np.rint(total, out=total)

    with_square_sums(lambda rows: heights[rows] * inside[rows], len(heights), chart.around, found)
    padded = chart.padded(codes)
    padded[~chart.covered] = _WHITE_8
    return padded, min(lows)


def image_library() -> Any:
    """The module OpenImageIO; raises InputError where it is not installed."""
    try:
        return importlib.import_module("OpenImageIO")
    except ImportError as exc:
        raise InputError(f"tiled textures need OpenImageIO; {install_hint('tx')}") from exc


def levels_of(texels: FloatMap) -> list[FloatMap]:
    """A map (R, R), R a power of two, and its coarser levels down to one texel.

    They are means of 2 x 2 texels, added in the order of the levels that the service draws
    (`level.cl`), so that they are the same bits.
    """
    levels = [texels]
    while len(levels[-1]) > 1:
        fine = levels[-1]
        top = fine[::2, ::2] + fine[::2, 1::2]
        bottom = fine[1::2, ::2] + fine[1::2, 1::2]
        levels.append(np.float32(0.25) * (top + bottom))
    return levels


def write_tiled(path: Path, levels: list[FloatMap], attributes: Mapping[str, Any]) -> None:
    """Write levels, finest first, as one file of one channel `Y`; raises StorageError."""
    library = image_library()
    output = library.ImageOutput.create("openexr")
    mode = "Create"
    for level in levels:
        spec = _spec(library, len(level), attributes)
        written = output.open(str(path), spec, mode) and output.write_image(level[..., None])
        if not written:
            raise StorageError(f"cannot write {path.name}: {output.geterror()}")
        mode = "AppendMIPLevel"
    closed, error = output.close(), output.geterror()
    # The last tiles are written when the object goes, not when it is closed.
    del output
    if not closed:
        raise StorageError(f"cannot write {path.name}: {error}")


def _spec(library: Any, side: int, attributes: Mapping[str, Any]) -> Any:
    spec = library.ImageSpec(side, side, 1, library.FLOAT)
    spec.channelnames = ("Y",)
    spec.tile_width = spec.tile_height = _TILE
    spec.tile_depth = 1
    for name, value in {**attributes, **_TEXTURE}.items():
        spec.attribute(name, value)
    return spec
