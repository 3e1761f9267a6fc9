"""A tile or a map of displacement, and the files that it is saved as."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from rhytid_client import npy, png
from rhytid_client.results import InputWarning
from rhytid_client.saving import write_whole

# What files of each format are called.
EXTENSIONS = {"npy": ".npy", "f16": ".f16", "exr": ".exr", "exr16": ".exr", "png": ".png"}


@dataclass(frozen=True, eq=False)
class Tile:
    """A tile or a whole map of displacement; in a notebook it shows itself as a shaded relief.

    content: the bytes as the server sent them.  etag: to ask for it again, None for a tile that
    was drawn once.  scale: of png alone, height = (p - 32768) / 32767 · scale, mesh units.
    values: (n, n) float32 or float16, row 0 at the top, read-only; None for exr and png. Of the
    layer slopes (n, n, 5).
    warnings: of a tile that was drawn once, what is probably wrong with its positions.
    label: what names its file, as "1001.smile": UDIM and frame of a map, and its level where that
    is not 0; of a tile also level, row and column, without the frame where it was drawn once.
    """

    format: str
    content: bytes | memoryview = field(repr=False)
    etag: str | None = None
    scale: float | None = None
    values: NDArray[Any] | None = field(default=None, repr=False)
    warnings: tuple[InputWarning, ...] = ()
    label: str = ""

    @property
    def array(self) -> NDArray[Any]:
        """`values`; raises ValueError for the image formats, which this package does not decode."""
        if self.values is None:
            raise ValueError(f"a tile in {self.format} has no array: its file is in .content")
        return self.values

    def save(
        self, path: str | PathLike[str], *, name: str = "face", scale: float | None = None
    ) -> Path:
        """Write a file and return its path.

        path: a file, whose extension says the format; or a folder, for a file called as those of
        `bake` are, NAME.<UDIM>.<FRAME>.exr, with the extension of the tile's format. What is not
        there and ends with a slash or has no extension is a folder, and is made. FRAME is the name
        in the service, which counts frames of a mesh file from 0001, as `bake` does.
        What the server sent is written as it came. Of a tile that came as npy or f16 also .npy of
        the same type, and .png of 16 bits are made here.
        scale: of such a .png, mesh units that white stands for, (p - 32768) / 32767 · scale is the
        height; the largest absolute height unless given: give one for files that belong together.
        Raises ValueError for what cannot be made here: ask the server for it with `format`.
        """
        as_folder = str(path).endswith(("/", os.sep))
        path, folder = Path(path), None
        if path.is_dir() or (not path.exists() and (as_folder or not path.suffix)):
            folder = path
            path = folder / f"{name}.{self.label}{EXTENSIONS[self.format]}"
        data = _file(self, path, scale)
        if folder:
            folder.mkdir(parents=True, exist_ok=True)
        write_whole(path, data)
        return path

    def _repr_png_(self) -> bytes | None:
        """What notebooks show; None for exr, which this package does not decode, and for slopes."""
        if self.values is not None and self.values.ndim == 2:
            return png.relief(self.values)
        return bytes(self.content) if self.format == "png" else None


def _file(tile: Tile, path: Path, scale: float | None) -> bytes | memoryview:
    extension = path.suffix.lower()
    if extension == EXTENSIONS[tile.format]:
        if scale is not None:
            raise ValueError(f"a tile in {tile.format} is written as it came: leave scale out")
        return tile.content
    if tile.values is not None and extension == ".npy" and scale is None:
        return npy.encode(tile.values)
    if tile.values is not None and tile.values.ndim == 2 and extension == ".png":
        return png.heights16(tile.values, scale)
    formats = [format for format, known in EXTENSIONS.items() if known == extension]
    if not formats:
        known = ", ".join(dict.fromkeys(EXTENSIONS.values()))
        raise ValueError(f"{path}: a tile is written as {known}")
    if scale is not None:
        raise ValueError(f"{path}: only a .png has a scale")
    wanted = " or ".join(f"format={format!r}" for format in formats)
    raise ValueError(f"{path}: a tile in {tile.format} is not turned into that: ask for {wanted}")
