"""The image datablock of an object: one for as long as it lives, whatever it shows."""

from __future__ import annotations

from itertools import count
from pathlib import Path
from typing import Literal

import bpy

from rhytid_client.hosts.files import folder_at, replaced, slug

from .properties import ours
from .typed import there

# Maps that were shown before and may still be read by a viewport that renders.
KEPT = 3
_serial = count(1)


def own(obj: bpy.types.Object) -> bpy.types.Image | None:
    """The image of the object; None where there is none, or another object has it, too."""
    return ours(obj).image if sharer(obj) is None else None


def sharer(obj: bpy.types.Object) -> bpy.types.Object | None:
    """Another object that has the image of the object."""
    image = ours(obj).image
    others = (other for other in bpy.data.objects if other != obj)
    return next((o for o in others if image is not None and ours(o).image == image), None)


def part(obj: bpy.types.Object) -> None:
    """A copy of another object shall have images of its own."""
    if own(obj) is None:
        ours(obj).image = ours(obj).shine_image = None


def is_of_copy(obj: bpy.types.Object) -> bool:
    """Whether the image of the object was made for an object of another name."""
    image = ours(obj).image
    return image is not None and image.name != _name(obj)


def shows(image: bpy.types.Image | None, path: str, udims: list[int]) -> bool:
    """Whether the image shows a path whose files, one a UDIM, are there."""
    if image is None or image.filepath != path:
        return False
    return bool(image.packed_files) or all(file.is_file() for file in files(image, path, udims))


def files(image: bpy.types.Image, path: str, udims: list[int]) -> list[Path]:
    """The files of a path of an image, one a UDIM."""
    whole = bpy.path.abspath(path, library=image.library)
    return [Path(whole.replace("<UDIM>", str(udim))) for udim in udims]


def portable(path: str) -> str:
    """Beside a saved .blend paths are from it on, so that both can be moved."""
    try:
        return bpy.path.relpath(path) if bpy.data.filepath else path
    except ValueError:  # on another drive of Windows
        return path


def image_of(obj: bpy.types.Object, path: str, udims: list[int]) -> bpy.types.Image:
    """The image of the object, made where there is none, showing `path`."""
    image = ours(obj).image = ours(obj).image or _loaded(_name(obj), path, udims)
    show(image, path, udims)
    return image


def shine_of(obj: bpy.types.Object, path: str, udims: list[int]) -> bpy.types.Image:
    """The same of its shine."""
    name = f"rhytid shine {obj.name}"
    image = ours(obj).shine_image = ours(obj).shine_image or _loaded(name, path, udims)
    show(image, path, udims)
    return image


def _loaded(name: str, path: str, udims: list[int]) -> bpy.types.Image:
    image = bpy.data.images.load(path.replace("<UDIM>", str(udims[0])))
    image.name = name
    return image


def show(image: bpy.types.Image, path: str, udims: list[int]) -> None:
    """Let the image show a file, or tiles where there are several UDIMs.

    A new path each time: Cycles and the viewport would go on with what they read under an old one.
    """
    source: Literal["TILED", "FILE"] = "TILED" if udims != [1001] else "FILE"
    if image.source != source:
        image.source = source
    if image.packed_files:  # which would go on to be shown
        image.unpack(method="REMOVE")
    image.filepath = path if source == "TILED" else path.replace("<UDIM>", "1001")
    if source == "TILED":
        _tiles(image, udims)
    # The stubs know no colour spaces, which come from a file of Blender's.
    there(image.colorspace_settings, "a colour space").name = "Non-Color"  # type: ignore[assignment]
    image.alpha_mode = "NONE"
    image.reload()


def _name(obj: bpy.types.Object) -> str:
    return f"rhytid {obj.name}"


def _tiles(image: bpy.types.Image, udims: list[int]) -> None:
    for udim in udims:
        if image.tiles.get(udim) is None:
            image.tiles.new(udim)
    for tile in list(image.tiles):
        if tile.number not in udims:
            image.tiles.remove(tile)


def written(obj: bpy.types.Object, maps: dict[int, bytes], ending: str = "exr") -> str:
    """Write maps to the session's temporary folder; their path, `<UDIM>` in place of the number.

    ending: of the files. Each object has a folder of its own there, whatever it is called
    meanwhile.
    """
    folder = folder_at(Path(bpy.app.tempdir) / "rhytid" / str(obj.session_uid))
    start, serial = slug(obj.name), f"{next(_serial):06d}"
    for udim, data in maps.items():
        replaced(folder / f"{start}.{udim}.{serial}.{ending}", data)
        found = folder.glob(f"*.{udim}.*.{ending}")
        for old in sorted(found, key=lambda file: file.suffixes[-2])[:-KEPT]:
            old.unlink(missing_ok=True)
    return str(folder / f"{start}.<UDIM>.{serial}.{ending}")
