"""The map that an object shows is kept beside the .blend that is saved.

Maps are drawn into a folder that Blender deletes at its end. `//rhytid/NAME/`, NAME that of the
.blend without its ending, holds those that the .blend and its older versions refer to.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path

import bpy
from bpy.app.handlers import persistent

from rhytid_client.hosts import Trouble
from rhytid_client.hosts.files import folder_at, replaced, slug

from . import images, state
from .properties import ours
from .typed import there
from .words import not_kept

# What was shown before, by image: a copy that is saved leaves the file as it was.
_before: list[tuple[bpy.types.Image, str]] = []
_NAME = re.compile(r"(.+\.1\d{3})\.[0-9a-f]{16}\.(?:exr|png)")


@persistent  # type: ignore[untyped-decorator]
def before_save(path: str, *_: object) -> None:
    """Put the maps that are shown beside the .blend, and let images refer to them there.

    path: of the .blend that is about to be saved, empty for the startup file. Blender saves even
    where a map cannot be kept, which is told.
    """
    _before.clear()
    if path:
        told = [text for obj in _with_live_map() if (text := _kept(obj, Path(path)))]
        _tell(told)


@persistent  # type: ignore[untyped-decorator]
def after_save(path: str, *_: object) -> None:
    """Where a copy was saved, the open file shows its own maps again."""
    is_copy = Path(path) != Path(bpy.data.filepath)
    for image, before in _before:
        now = before if is_copy else images.portable(bpy.path.abspath(image.filepath))
        state.moved(before, now)
        if image.filepath != now:
            image.filepath = now
    _before.clear()


def _with_live_map() -> Iterator[bpy.types.Object]:
    """An object for each image that shows a map which was drawn, in this file and unpacked."""
    seen = set()
    for obj in bpy.data.objects:
        image = ours(obj).image
        if image is not None and not ours(obj).baked and _is_here(image) and image not in seen:
            seen.add(image)
            yield obj


def _is_here(image: bpy.types.Image) -> bool:
    return not (image.library or image.packed_files)


def _kept(obj: bpy.types.Object, blend: Path) -> str:
    """Keep the maps of an object; what is wrong where that fails, else ""."""
    folder, name = blend.parent / "rhytid" / slug(blend.stem), slug(obj.name)
    image, shine = ours(obj).image, ours(obj).shine_image
    try:
        _keep(there(image, "an image"), ours(obj).udim_list(), folder, name)
        if ours(obj).shine and shine is not None and _is_here(shine):
            _keep(shine, ours(obj).udim_list(), folder, f"{name}.shine")
    except (OSError, Trouble) as exc:
        status = state.status(obj)
        status.text, status.failed = not_kept(obj.name, exc), True
        return status.text
    return ""


def _keep(image: bpy.types.Image, udims: list[int], folder: Path, name: str) -> None:
    """Copy the map of an image and have it shown from there; raises OSError and Trouble."""
    found = images.files(image, image.filepath, udims)
    path = _written(folder_at(folder), name, dict(zip(udims, found, strict=True)))
    _before.append((image, image.filepath))
    now = images.portable(path if image.source == "TILED" else path.replace("<UDIM>", "1001"))
    if now != image.filepath:
        image.filepath = now


def _written(folder: Path, name: str, maps: dict[int, Path]) -> str:
    """Copy the maps that are not there; their path, `<UDIM>` in place of the number. One map at a
    time is in memory. Raises OSError and Trouble."""
    whole = sha256(b"".join(sha256(path.read_bytes()).digest() for path in maps.values()))
    digest, ending = whole.hexdigest()[:16], next(iter(maps.values())).suffix
    for udim, path in maps.items():
        file = folder / f"{name}.{udim}.{digest}{ending}"
        if file.is_file() and file.stat().st_size == path.stat().st_size:
            os.utime(file)
        else:
            replaced(file, path.read_bytes())
        _prune(folder, f"{name}.{udim}")
    return str(folder / f"{name}.<UDIM>.{digest}{ending}")


def _prune(folder: Path, of_tile: str) -> None:
    """Remove what neither the .blend nor one of the older versions that Blender keeps refers to."""
    known = [(f, _NAME.fullmatch(f.name)) for f in folder.iterdir()]
    files = [file for file, match in known if match is not None and match[1] == of_tile]
    preferences = there(bpy.context.preferences, "preferences")
    kept = 1 + preferences.filepaths.save_version
    for old in sorted(files, key=lambda file: file.stat().st_mtime_ns)[:-kept]:
        old.unlink(missing_ok=True)


def _tell(lines: list[str]) -> None:
    """What is wrong, on the console and in a window where there is one."""
    for line in lines:
        print(f"rhytid: {line}", file=sys.stderr, flush=True)  # noqa: T201
    manager = bpy.context.window_manager
    if lines and manager is not None and not bpy.app.background and bpy.context.window is not None:

        def draw(menu: bpy.types.Menu, context: bpy.types.Context) -> None:
            for line in lines:
                there(menu.layout, "a layout").label(text=line)

        manager.popup_menu(draw, title="Rhytid", icon="ERROR")
