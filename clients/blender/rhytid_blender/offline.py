"""Folders of maps, as `rhytid bake` and the bake operator write them: NAME.<UDIM>.<FRAME>.exr."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import bpy

from . import images, meshes, nodes
from .exr_header import text_attribute
from .words import Trouble

_FILE = re.compile(r"([^.]+)\.(1\d{3})\.(\d+)\.exr")


@dataclass(frozen=True)
class Sequence:
    """The maps of one mesh: `pattern` has <UDIM> and <FRAME> in place of the numbers."""

    name: str
    pattern: str
    udims: list[int]
    frames: list[int]
    digits: int
    unit: str

    def path(self, frame: int) -> str:
        """The path of a frame, with <UDIM> in it."""
        return self.pattern.replace("<FRAME>", f"{frame:0{self.digits}d}")


def found(folder: Path, name: str = "") -> Sequence:
    """The sequence in a folder; raises Trouble where there is none, or several and no name."""
    files = [match for path in folder.glob("*.exr") if (match := _FILE.fullmatch(path.name))]
    names = sorted({match[1] for match in files})
    if not names:
        raise Trouble(f"{folder} has no files named NAME.<UDIM>.<FRAME>.exr")
    if not name and len(names) > 1:
        raise Trouble(f"{folder} has maps of {', '.join(names)}: give the name of one")
    files = [match for match in files if match[1] == (name or names[0])]
    if not files:
        raise Trouble(f"{folder} has no maps of {name}; there are {', '.join(names)}")
    return _checked(folder, files)


def _checked(folder: Path, files: list[re.Match[str]]) -> Sequence:
    udims = sorted({int(match[2]) for match in files})
    frames = sorted({int(match[3]) for match in files})
    missing = set(range(frames[0], frames[-1] + 1)) - set(frames)
    if missing:
        raise Trouble(f"Maps of the frames {sorted(missing)[:5]} are missing in {folder}")
    if len(files) != len(udims) * len(frames):
        raise Trouble(f"Some frames in {folder} have no map of a UDIM: bake them again")
    name, digits = files[0][1], len(files[0][3])
    unit = text_attribute(folder / files[0][0], "unit") or ""
    pattern = str(folder / f"{name}.<UDIM>.<FRAME>.exr")
    return Sequence(name, pattern, udims, frames, digits, unit)


def opened(obj: bpy.types.Object, maps: Sequence, start: int | None = None) -> None:
    """Let the object show a sequence from the frame `start`, that of its first number if None."""
    given = obj.rhytid
    given.baked, given.pattern = True, _portable(maps.pattern)
    given.digits = maps.digits
    given.first, given.last = maps.frames[0], maps.frames[-1]
    given.start = maps.frames[0] if start is None else start
    given.udims = ",".join(str(udim) for udim in maps.udims)
    given.uv_map, given.factor = meshes.uv_map(obj), _factor(obj, maps.unit)
    images.image_of(obj, _portable(maps.path(given.first)), maps.udims)
    nodes.set_up(obj)
    if maps.udims == [1001]:
        given.image.source = "SEQUENCE"
        nodes.play(obj, len(maps.frames), given.start, given.first)
    else:
        _show(obj, bpy.context.scene.frame_current)


def _portable(path: str) -> str:
    """Beside a saved .blend paths are from it on, so that both can be moved."""
    try:
        return bpy.path.relpath(path) if bpy.data.filepath else path
    except ValueError:  # on another drive of Windows
        return path


def _factor(obj: bpy.types.Object, unit: str) -> float:
    """Mesh units in one of the map, 1 where the map names none; raises Trouble for a unit that is
    no length known here."""
    if not unit:
        return 1.0
    unit = unit.lower().replace("µ", "u")
    if unit not in meshes.MILLIMETRES:
        known = ", ".join(meshes.MILLIMETRES)
        raise Trouble(f"The maps are in {unit!r}: bake them in one of {known}")
    own = obj.rhytid.unit
    if own == "auto":
        own = meshes.guessed_unit(meshes.rest_positions(obj))
    return meshes.MILLIMETRES[unit] / meshes.MILLIMETRES[own]


def show_frame(scene: bpy.types.Scene) -> None:
    """Images of Blender have tiles or are a sequence, not both: tiles are changed by the frame."""
    for obj in scene.objects:
        if obj.type == "MESH" and obj.rhytid.baked and obj.rhytid.udims != "1001":
            _show(obj, scene.frame_current)


def _show(obj: bpy.types.Object, frame: int) -> None:
    given = obj.rhytid
    if given.image is None:
        return
    file = min(max(frame - given.start + given.first, given.first), given.last)
    path = given.pattern.replace("<FRAME>", f"{file:0{given.digits}d}")
    if given.image.filepath != path:
        images.show(given.image, path, given.udim_list())
