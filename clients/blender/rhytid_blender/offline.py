"""Sequences of maps, as `rhytid bake` and the bake operator write them, shown by an object."""

from __future__ import annotations

import bpy

from rhytid_client.hosts import MapSequence, units

from . import images, meshes, nodes
from .properties import ours
from .typed import scene_of


def opened(obj: bpy.types.Object, maps: MapSequence, start: int | None = None) -> None:
    """Let the object show a sequence from the frame `start`, that of its first number if None.
    Shine of a sequence before is disconnected.

    Raises Trouble, the object as it was, where its unit or its materials do not allow it.
    """
    given, own, factor = ours(obj), images.own(obj), _factor(obj, maps.unit)
    nodes.check(obj, own)
    given.image = own
    given.baked, given.pattern = True, images.portable(maps.pattern)
    given.digits = maps.digits
    given.first, given.last = maps.frames[0], maps.frames[-1]
    given.start = maps.frames[0] if start is None else start
    given.udims = ",".join(str(udim) for udim in maps.udims)
    given.uv_map, given.factor = meshes.uv_map(obj), factor
    image = images.image_of(obj, images.portable(maps.path(given.first)), list(maps.udims))
    nodes.set_up(obj)
    given.shine_pattern = ""
    nodes.disconnect_shine(obj)
    if maps.tiled:
        _show(obj, scene_of(bpy.context).frame_current)
    else:
        image.source = "SEQUENCE"
        play(obj)


def shine(obj: bpy.types.Object, maps: MapSequence) -> None:
    """Connect the files of shine of the sequence that the object shows to its materials; raises
    Trouble where none has a Principled BSDF."""
    given, first = ours(obj), images.portable(maps.shine.path(maps.frames[0]))
    udims = list(maps.udims)
    if given.shine_image is None:
        given.shine_image = bpy.data.images.load(first.replace("<UDIM>", str(udims[0])))
        given.shine_image.name = f"rhytid shine {obj.name}"
    images.show(given.shine_image, first, udims)
    nodes.connect_shine(obj, given.shine_image)
    given.shine_pattern = images.portable(maps.shine.pattern)
    if not maps.tiled:
        given.shine_image.source = "SEQUENCE"
    play(obj)


def play(obj: bpy.types.Object) -> None:
    """Where the image of the object is a sequence, let its nodes play that."""
    given = ours(obj)
    if given.baked and given.image is not None and given.image.source == "SEQUENCE":
        nodes.play(obj, given.last - given.first + 1, given.start, given.first)


def _factor(obj: bpy.types.Object, unit: str) -> float:
    """Mesh units in one of the map, 1 where the map names none; raises Trouble for a unit that is
    no length known here."""
    own = ours(obj).unit
    if own == "auto" and unit:
        own = units.guessed_unit(meshes.rest_positions(obj))
    return units.factor(unit, own)


def show_frame(scene: bpy.types.Scene) -> None:
    """Images of Blender have tiles or are a sequence, not both: tiles are changed by the frame."""
    for obj in scene.objects:
        if obj.type == "MESH" and ours(obj).baked and ours(obj).udims != "1001":
            _show(obj, scene.frame_current)


def _show(obj: bpy.types.Object, frame: int) -> None:
    given = ours(obj)
    shown = (given.image, given.pattern), (given.shine_image, given.shine_pattern)
    for image, pattern in shown:
        path = path_at(obj, pattern, frame)
        if image is not None and path and image.filepath != path:
            images.show(image, path, given.udim_list())


def path_at(obj: bpy.types.Object, pattern: str, frame: int) -> str:
    """The path of the file of a pattern that an object plays at a frame of the scene."""
    given = ours(obj)
    file = min(max(frame - given.start + given.first, given.first), given.last)
    return pattern.replace("<FRAME>", f"{file:0{given.digits}d}")
