"""OpenEXR files of one displacement map: one channel `Y`, ZIP compression.

The name of the channel is not free: Blender reads a lone channel of another name as NaN.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from rhytid.errors import InputError, StorageError
from rhytid.formats.tile_header import TileHeader
from rhytid.support.atomic_files import atomic_write

Texels = NDArray[np.float32] | NDArray[np.float16]

_CHANNEL = "Y"
NOTHING: Mapping[str, str | int | float] = MappingProxyType({})


def write_exr(
    path: Path, texels: Texels, header: TileHeader, more: Mapping[str, str | int | float] = NOTHING
) -> None:
    """Write a map (h, w) float32 or float16 to `path`, whole or not at all, with the attributes of
    its header and `more`.

    Raises StorageError.
    """
    try:
        with atomic_write(path) as aside:
            _file(texels, {**header.attributes(), **more}).write(str(aside))
    except (OSError, RuntimeError) as exc:
        raise StorageError(f"cannot write an EXR file: {exc}") from exc


def encode_exr(texels: Texels, header: TileHeader) -> bytes:
    """The bytes of the file that `write_exr` writes."""
    stream = io.BytesIO()
    _file(texels, header.attributes()).write(stream)
    return stream.getvalue()


def read_exr(path: Path) -> tuple[Texels, dict[str, object]]:
    """Channel `Y` (h, w) of a file, and the attributes; raises InputError where it is damaged."""
    return _read(str(path), path.name)


def decode_exr(data: bytes) -> tuple[Texels, dict[str, object]]:
    """`read_exr` of a file in memory."""
    return _read(io.BytesIO(data), "tile.exr")


def read_attributes(path: Path) -> dict[str, object]:
    """The attributes of a file, without its texels; raises InputError where it is damaged."""
    try:
        file = OpenEXR.File(str(path), header_only=True)
    except RuntimeError as exc:
        raise InputError(f"{path.name}: not a readable EXR file") from exc
    if not file.parts:
        raise InputError(f"{path.name}: a damaged EXR file")
    return dict(file.header())


def _read(source: str | io.BytesIO, name: str) -> tuple[Texels, dict[str, object]]:
    try:
        file = OpenEXR.File(source, separate_channels=True)
    except RuntimeError as exc:
        raise InputError(f"{name}: not a readable EXR file") from exc
    # A file that is cut short raises nothing: it just has no parts.
    channels = file.channels() if file.parts else {}
    if _CHANNEL not in channels:
        raise InputError(f"{name}: a damaged EXR file, or one without a channel {_CHANNEL}")
    texels: Texels = channels[_CHANNEL].pixels
    return texels, dict(file.header())


def _file(texels: Texels, attributes: Mapping[str, str | int | float]) -> OpenEXR.File:
    fixed = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    return OpenEXR.File({**attributes, **fixed}, {_CHANNEL: np.ascontiguousarray(texels)})
