"""The writers of the profiles: each takes the path, the map and the facts of its profile, and
returns the SHA-256 of the file, but where a library has written it.

Normal maps: the normal of a surface P + h n is, to first order in h, along n - g, where g is the
gradient of h on the surface: g . dP/du = dh/du, g . dP/dv = dh/dv. A shader that reads the map
computes x T + y B + z N, and B = sign (N x T), of N and T that are interpolated and not made unit
vectors again, as MikkTSpace asks for; (x, y, z) is what makes this parallel to n - g.

Tiled, mipmapped OpenEXR is written through OpenImageIO, with levels that are given (extra `tx`).
"""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from rhytid.domain.wording import install_hint
from rhytid.errors import InputError, StorageError
from rhytid.exports.textures.frame_map import TEXELS, Chart, Facts, FrameMap, attributes
from rhytid.exports.textures.tangents import FloatArray, Posed, dot, unit
from rhytid.formats.exr_encoder import Texels, exr_body
from rhytid.formats.png import encode_png
from rhytid.formats.tiles import quantise
from rhytid.support.atomic_files import (
    atomic_write,
    storage_errors,
    write_hashed,
)

Codes = NDArray[np.uint8] | NDArray[np.uint16]
FloatMap = NDArray[np.float32]
_WHITE, _MIDDLE = 65535, 32768
# The square around a texel, as a share of the side of a map: some 4 mm on a face that fills it.
AROUND = 1.0 / 64.0
# Weight of a neighbour outside of the islands: it counts where there is no other.
_OUTSIDE = 1e-9
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


def normal_gl_facts(map: FrameMap) -> Facts:
    """Facts of normal-gl: normals are 2 value - 1, green along v."""
    return {"scale": 1.0, "midlevel": 0.5, "green": "up"}


def normal_dx_facts(map: FrameMap) -> Facts:
    """Facts of normal-dx: normals are 2 value - 1, green against v."""
    return {"scale": 1.0, "midlevel": 0.5, "green": "down"}


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


def write_normals(path: Path, map: FrameMap, facts: Facts) -> str:
    """Write normals as RGB PNG of 16 bits."""
    normals = normal_map(map.heights(), map.chart(), map.posed())
    if facts["green"] == "down":
        normals[..., 1] *= -1.0
    codes = np.rint((normals * 0.5 + 0.5) * _WHITE).astype(np.uint16)
    return write_png(path, codes, map, facts, normals)


def write_cavity(path: Path, map: FrameMap, facts: Facts) -> str:
    """Write a grey PNG of 8 bits: white is as high as its surroundings or higher, black lower by
    the depth of a furrow of strength 1, or more."""
    values = cavity_map(map.heights(), map.chart(), map.depth)
    return write_png(path, as_bytes(values), map, facts, values)


def as_bytes(values: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Values from 0 to 1 as codes of 8 bits."""
    codes: NDArray[np.uint8] = np.rint(values * 255.0).astype(np.uint8)
    return codes


def write_png(
    path: Path,
    codes: Codes,
    map: FrameMap,
    facts: Facts,
    values: NDArray[Any],
    linear: bool = False,
) -> str:
    """Write codes as PNG with attributes; `minimum` and `maximum` are of the values."""
    ends = values.min(), values.max()
    texts = {name: str(v) for name, v in attributes(map.header, facts, *ends).items()}
    with atomic_write(path) as aside:
        return write_hashed(aside, [encode_png(codes, texts, linear)])


def normal_map(heights: NDArray[np.float32], chart: Chart, posed: Posed) -> NDArray[np.float32]:
    """(R, R, 3) unit vectors (along u, along v, outwards) of the heights (R, R), mesh units, row 0
    at the top.

    In the padding a texel has the vector of the nearest texel inside, beyond it (0, 0, 1).
    """
    side = len(heights)
    out = np.zeros((side, side, 3), np.float32)
    rows = max(TEXELS // side, 1)
    for start in range(0, side, rows):
        part = slice(start, min(start + rows, side))
        inside = chart.inside[part]
        found = chart.triangles[part][inside].astype(np.int64)
        if len(found):
            slopes = _slopes(heights, chart, part)[inside]
            weights = chart.corner_weights(part, inside)
            out[part][inside] = _normals(slopes, found, weights, posed)
    return np.where(chart.covered[..., None], chart.padded(out), np.array([0, 0, 1], np.float32))


def _normals(
    slopes: FloatArray, found: NDArray[np.int64], weights: FloatArray, posed: Posed
) -> FloatArray:
    """(K, 3) of texels in triangles `found`, with slopes (K, 2) = (dh/du, dh/dv)."""
    mean = np.einsum("kc,kcx->kx", weights, posed.normals[found])
    normal = unit(mean)
    tangent = np.einsum("kc,kcx->kx", weights, posed.tangents[found])
    sign = posed.signs[found][:, None]
    du, across_u, dv = posed.scale[found].T[..., None]
    # A triangle without area in space has no slopes: it is taken as flat.
    flat = (du <= 0.0) | (dv <= 0.0)
    along = np.where(flat, 0.0, slopes[:, :1] / np.where(flat, 1.0, du))
    across = np.where(flat, 0.0, (slopes[:, 1:] - across_u * along) / np.where(flat, 1.0, dv))
    # The axes of the triangle, turned into the plane of the interpolated normal.
    first = unit(posed.along[found] - dot(posed.along[found], normal) * normal)
    second = sign * np.cross(normal, first)
    direction = normal - along * first - across * second
    return _in_frame(direction, mean, tangent, sign * np.cross(mean, tangent))


def _in_frame(
    direction: FloatArray, normal: FloatArray, tangent: FloatArray, bitangent: FloatArray
) -> FloatArray:
    """Unit (x, y, z) with x T + y B + z N along `direction`. T need not be orthogonal to N, and
    none of them need be of length 1."""
    size = np.maximum(dot(normal, normal), 1e-300)
    lean = dot(tangent, normal) / size
    flat = tangent - lean * normal
    x = dot(direction, flat) / np.maximum(dot(flat, flat), 1e-300)
    y = dot(direction, bitangent) / np.maximum(dot(bitangent, bitangent), 1e-300)
    return unit(np.concatenate([x, y, dot(direction, normal) / size - x * lean], axis=1))


def _slopes(heights: NDArray[np.float32], chart: Chart, rows: slice) -> FloatArray:
    """(rows, R, 2) of dh/du and dh/dv: differences over two texels, over one where a neighbour is
    outside, of another island or beyond the border."""
    side = len(heights)
    index = np.arange(side)
    here = index[rows]
    offset = max(rows.start - 1, 0)
    near = slice(offset, rows.stop + 1)
    island = chart.islands[chart.triangles[near]]
    trust = np.where(chart.inside[near], 1.0, _OUTSIDE)

    def step(
        row: NDArray[np.int64], column: NDArray[np.int64]
    ) -> tuple[FloatArray, NDArray[np.float64]]:
        """How much higher the neighbours are, and their distance in texels: 0 where not used."""
        same = island[np.ix_(row - offset, column)] == island[np.ix_(here - offset, index)]
        higher = heights[np.ix_(row, column)].astype(np.float64) - heights[rows]
        moved = (row != here)[:, None] | (column != index)[None]
        used = (same & moved) * trust[np.ix_(row - offset, column)]
        return higher * used, used

    right, left = np.minimum(index + 1, side - 1), np.maximum(index - 1, 0)
    below, above = np.minimum(here + 1, side - 1), np.maximum(here - 1, 0)
    slopes = []
    for plus, minus in (((here, right), (here, left)), ((above, index), (below, index))):
        (rise, more), (fall, less) = step(*plus), step(*minus)
        slopes.append((rise - fall) * side / np.maximum(more + less, 1e-3 * _OUTSIDE))
    return np.stack(slopes, axis=-1)


def cavity_map(heights: NDArray[np.float32], chart: Chart, depth: float) -> NDArray[np.float32]:
    """(R, R) from 1, no lower than the mean around it, to 0, lower by `depth` or more.

    heights, depth: mesh units. Texels outside of the islands do not count in the mean. In the
    padding a texel has the value of the nearest texel inside, beyond it 1.
    """
    size = max(round(AROUND * len(heights)), 1) | 1
    shown = chart.inside.astype(np.float32)
    share = scipy.ndimage.uniform_filter(shown, size, mode="constant")
    mean = scipy.ndimage.uniform_filter(heights * shown, size, mode="constant")
    mean /= np.maximum(share, np.float32(0.5 / size**2))
    below = (heights - mean) / np.float32(depth)
    cavity = chart.padded(1.0 + below.clip(-1.0, 0.0))
    return np.where(chart.covered, cavity, np.float32(1.0)).astype(np.float32)


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
