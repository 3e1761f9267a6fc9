"""Tiles as files, and files that are there when they are whole."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING
from uuid import uuid4

from rhytid_client import npy, png

if TYPE_CHECKING:
    from rhytid_client.results import Tile

# What files of each format are called.
EXTENSIONS = {"npy": ".npy", "f16": ".f16", "exr": ".exr", "exr16": ".exr", "png": ".png"}


def save(tile: Tile, path: Path, name: str, scale: float | None) -> Path:
    """What `Tile.save` does."""
    if path.is_dir():
        path = path / f"{name}.{tile.label}{EXTENSIONS[tile.format]}"
    write_whole(path, _file(tile, path, scale))
    return path


def write_whole(path: Path, data: bytes | memoryview) -> None:
    """Write a file aside and put it in its place: nobody reads half of it."""
    aside = path.with_name(f".{path.name}.{uuid4().hex}")
    try:
        aside.write_bytes(data)
        aside.replace(path)
    finally:
        aside.unlink(missing_ok=True)


def _file(tile: Tile, path: Path, scale: float | None) -> bytes | memoryview:
    extension = path.suffix.lower()
    if extension == EXTENSIONS[tile.format]:
        if scale is not None:
            raise ValueError(f"a tile in {tile.format} is written as it came: leave scale out")
        return tile.content
    if tile.values is not None and extension == ".npy" and scale is None:
        return npy.encode(tile.values)
    if tile.values is not None and extension == ".png":
        return png.heights16(tile.values, scale)
    formats = [format for format, known in EXTENSIONS.items() if known == extension]
    if not formats:
        known = ", ".join(dict.fromkeys(EXTENSIONS.values()))
        raise ValueError(f"{path}: a tile is written as {known}")
    if scale is not None:
        raise ValueError(f"{path}: only a .png has a scale")
    wanted = " or ".join(f"format={format!r}" for format in formats)
    raise ValueError(f"{path}: a tile in {tile.format} is not turned into that: ask for {wanted}")
