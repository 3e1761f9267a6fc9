"""The image datablock of an object: one for as long as it lives, whatever it shows."""

from __future__ import annotations

import re
from itertools import count
from pathlib import Path
from zlib import crc32

import bpy

from .words import Trouble

# Maps that were shown before and may still be read by a viewport that renders.
KEPT = 3
# Characters of a name: the server takes frames of 64, and some are of the session.
_LONGEST = 40
_serial = count(1)


def slug(name: str) -> str:
    """A name of a file, and of a frame of the server, of at most 40 characters; other names have
    other ones."""
    plain = re.sub(r"[^A-Za-z0-9_-]+", "_", name)[:_LONGEST]
    return plain if plain == name else f"{plain[: _LONGEST - 9]}-{crc32(name.encode()):08x}"


def image_of(obj: bpy.types.Object, path: str, udims: list[int]) -> bpy.types.Image:
    """The image of the object, made where there is none, showing `path`."""
    image = obj.rhytid.image
    if image is None:
        image = bpy.data.images.load(path.replace("<UDIM>", str(udims[0])))
        image.name = f"rhytid {obj.name}"
        obj.rhytid.image = image
    show(image, path, udims)
    return image


def show(image: bpy.types.Image, path: str, udims: list[int]) -> None:
    """Let the image show a file, or tiles where there are several UDIMs.

    A new path each time: Cycles and the viewport would go on with what they read under an old one.
    """
    source = "TILED" if udims != [1001] else "FILE"
    if image.source != source:
        image.source = source
    image.filepath = path if source == "TILED" else path.replace("<UDIM>", "1001")
    if source == "TILED":
        _tiles(image, udims)
    image.colorspace_settings.name = "Non-Color"
    image.alpha_mode = "NONE"
    image.reload()


def _tiles(image: bpy.types.Image, udims: list[int]) -> None:
    for udim in udims:
        if image.tiles.get(udim) is None:
            image.tiles.new(udim)
    for tile in list(image.tiles):
        if tile.number not in udims:
            image.tiles.remove(tile)


def written(name: str, maps: dict[int, bytes]) -> str:
    """Write maps to the session's temporary folder; their path, `<UDIM>` in place of the number."""
    folder = Path(bpy.app.tempdir) / "rhytid"
    folder.mkdir(exist_ok=True)
    start, serial = slug(name), f"{next(_serial):06d}"
    for udim, data in maps.items():
        replaced(folder / f"{start}.{udim}.{serial}.exr", data)
        of_tile = sorted(folder.glob(f"{start}.{udim}.*.exr"))
        for old in of_tile[:-KEPT]:
            old.unlink(missing_ok=True)
    return str(folder / f"{start}.<UDIM>.{serial}.exr")


def replaced(path: Path, data: bytes) -> None:
    """Write a file that is there when it is whole; raises Trouble."""
    aside = path.with_suffix(".part")
    try:
        aside.write_bytes(data)
        aside.replace(path)
    except OSError as exc:
        raise Trouble(f"{path} cannot be written: {exc}") from exc
