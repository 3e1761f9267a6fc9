"""OpenEXR files of one displacement map: one channel `Y`, ZIP compression.

The name of the channel is not free: Blender reads a lone channel of another name as NaN. OpenEXR
before 3.5 writes to paths only, hence the temporary folders.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from rhytid.errors import InputError, StorageError
from rhytid.formats.tile_header import TileHeader
from rhytid.unfinished import temporary_folder

Texels = NDArray[np.float32] | NDArray[np.float16]

_CHANNEL = "Y"
NOTHING: Mapping[str, str | int | float] = MappingProxyType({})


def write_exr(
    path: Path, texels: Texels, header: TileHeader, more: Mapping[str, str | int | float] = NOTHING
) -> None:
    """Write a map (h, w) float32 or float16 to `path`, whole or not at all, with the attributes of
    its header and `more`.

    It is written aside, in the same folder, and then moved into place. Raises StorageError.
    """
    with _temporary_folder(path.parent) as folder:
        aside = folder / path.name
        _write(aside, texels, {**header.attributes(), **more})
        aside.replace(path)


def encode_exr(texels: Texels, header: TileHeader) -> bytes:
    """The bytes of the file that `write_exr` writes; raises StorageError."""
    with _temporary_folder() as folder:
        path = folder / "tile.exr"
        _write(path, texels, header.attributes())
        return path.read_bytes()


def read_exr(path: Path) -> tuple[Texels, dict[str, object]]:
    """Channel `Y` (h, w) of a file, and the attributes; raises InputError where it is damaged."""
    try:
        file = OpenEXR.File(str(path), separate_channels=True)
    except RuntimeError as exc:
        raise InputError(f"{path.name}: not a readable EXR file") from exc
    # A file that is cut short raises nothing: it just has no parts.
    channels = file.channels() if file.parts else {}
    if _CHANNEL not in channels:
        raise InputError(f"{path.name}: a damaged EXR file, or one without a channel {_CHANNEL}")
    texels: Texels = channels[_CHANNEL].pixels
    return texels, dict(file.header())


def read_attributes(path: Path) -> dict[str, object]:
    """The attributes of a file, without its texels; raises InputError where it is damaged."""
    try:
        file = OpenEXR.File(str(path), header_only=True)
    except RuntimeError as exc:
        raise InputError(f"{path.name}: not a readable EXR file") from exc
    if not file.parts:
        raise InputError(f"{path.name}: a damaged EXR file")
    return dict(file.header())


def decode_exr(data: bytes) -> tuple[Texels, dict[str, object]]:
    """`read_exr` of a file in memory."""
    with _temporary_folder() as folder:
        path = folder / "tile.exr"
        path.write_bytes(data)
        return read_exr(path)


def _write(path: Path, texels: Texels, attributes: Mapping[str, str | int | float]) -> None:
    fixed = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    channels = {_CHANNEL: np.ascontiguousarray(texels)}
    OpenEXR.File({**attributes, **fixed}, channels).write(str(path))


@contextmanager
def _temporary_folder(parent: Path | None = None) -> Iterator[Path]:
    try:
        with temporary_folder(".rhytid-", parent) as folder:
            yield folder
    except (OSError, RuntimeError) as exc:
        raise StorageError(f"cannot write an EXR file: {exc}") from exc
