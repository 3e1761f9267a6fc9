"""Tiled, mipmapped OpenEXR through OpenImageIO, with levels that are given (extra `tx`)."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.wording import install_hint
from rhytid.errors import InputError, StorageError

Texels = NDArray[np.float32]
# Texels a side of a tile in the file, as `maketx` has them.
_TILE = 64
# Marks a file that has levels already, so that no tool makes them again; and says what a renderer's
# texture system reads beyond the border.
_TEXTURE = {"textureformat": "Plain Texture", "wrapmodes": "clamp,clamp", "compression": "zip"}


def image_library() -> Any:
    """OpenImageIO; raises InputError where it is not installed."""
    try:
        return importlib.import_module("OpenImageIO")
    except ImportError as exc:
        raise InputError(f"tiled textures need OpenImageIO; {install_hint('tx')}") from exc


def levels_of(texels: Texels) -> list[Texels]:
    """A map (R, R), R a power of two, and its coarser levels down to one texel: means of 2 x 2,
    added in the order of the service's own levels (`level.cl`), so that they are the same bits."""
    levels = [texels]
    while len(levels[-1]) > 1:
        fine = levels[-1]
        top = fine[::2, ::2] + fine[::2, 1::2]
        bottom = fine[1::2, ::2] + fine[1::2, 1::2]
        levels.append(np.float32(0.25) * (top + bottom))
    return levels


def write_tiled(path: Path, levels: list[Texels], attributes: Mapping[str, Any]) -> None:
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
