"""Sequences of maps, as `rhytid bake` and the bake operator write them, shown by an object."""

from __future__ import annotations

import bpy

from rhytid_client.hosts import MapSequence, Trouble, units
from rhytid_client.hosts.baking import roughness_of

from . import images, meshes, nodes, shine, state
from .properties import ours
from .typed import mesh_of, scene_of


def opened(obj: bpy.types.Object, maps: MapSequence, start: int | None = None) -> None:
    """Let the object show a sequence from the frame `start`, that of its first number if None.
    Shine of a sequence before is disconnected.

    Raises Trouble, the object as it was, where its unit or its materials do not allow it.
    """
    given, factor = ours(obj), _factor(obj, maps.unit)
    nodes.check(obj, images.own(obj))
    images.part(obj)
    given.baked, given.pattern = True, images.portable(maps.pattern)
    given.digits = maps.digits
    given.first, given.last = maps.frames[0], maps.frames[-1]
    given.start = maps.frames[0] if start is None else start
    given.udims = ",".join(str(udim) for udim in maps.udims)
    given.uv_map, given.factor = meshes.uv_map(obj), factor
    image = images.image_of(obj, images.portable(maps.path(given.first)), list(maps.udims))
    nodes.set_up(obj)
    given.shine_pattern = ""
    shine.disconnect(obj)
    # What was wrong with what the object showed before is no more.
    status = state.status(obj)
    status.text, status.failed, status.of_frame = "", False, _of_another_mesh(obj, maps)
    if maps.tiled:
        _show(obj, scene_of(bpy.context).frame_current)
    else:
        image.source = "SEQUENCE"
        play(obj)


def _of_another_mesh(obj: bpy.types.Object, maps: MapSequence) -> tuple[str, ...]:
    """A warning where maps are of a mesh with more or fewer triangles than the object has without
    modifiers."""
    own = sum(polygon.loop_total - 2 for polygon in mesh_of(obj).polygons)
    if maps.triangles in (None, own):
        return ()
    theirs = f"{maps.name} was baked from a mesh of {maps.triangles} triangles"
    return (f"{theirs}, '{obj.name}' has {own}: are they the maps of this head?",)


def show_shine(obj: bpy.types.Object, maps: MapSequence) -> None:
    """Connect the files of shine of the sequence that the object shows to its materials; raises
    Trouble where none has a Principled BSDF."""
    given, udims, first = ours(obj), list(maps.udims), maps.frames[0]
    shine.set_base(obj, roughness_of(maps.shine.file(udims[0], first)) or given.roughness)
    image = images.shine_of(obj, images.portable(maps.shine.path(first)), udims)
    shine.connect(obj, image)
    given.shine_pattern = images.portable(maps.shine.pattern)
    if not maps.tiled:
        image.source = "SEQUENCE"
    play(obj)


def switch_shine(obj: bpy.types.Object) -> None:
    """Connect shine as the switches of the object are now, or take it out; what is wrong is told by
    the panel."""
    try:
        connect_shine(obj)
    except Trouble as trouble:
        status = state.status(obj)
        status.text, status.failed = str(trouble), True


def connect_shine(obj: bpy.types.Object) -> None:
    """Connect shine that is asked for and of the map that is shown, else take it out. Raises
    Trouble."""
    given, image = ours(obj), ours(obj).shine_image
    if not given.shine:
        shine.disconnect(obj)
    elif image is not None and _is_of_map(obj, image):
        shine.connect(obj, image)
        play(obj)


def _is_of_map(obj: bpy.types.Object, image: bpy.types.Image) -> bool:
    """Whether an image has shine of the map that is shown: files of the same sequence, or drawn
    with it."""
    if ours(obj).baked:
        return ours(obj).shine_pattern != ""
    return image.filepath == state.status(obj).shine_path or shine.connected(obj, image)


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
