"""Maps follow the frame, in the viewport and in renders."""

from __future__ import annotations

import sys
from pathlib import Path

import bpy
from bpy.app.handlers import persistent

from rhytid_client.hosts import Trouble

from . import images, offline, saving, shine, state, updating
from .properties import ours
from .words import missing_map, missing_shine

# The cameras that were taken away, by scene, to end a render.
_cameras: dict[int, bpy.types.Object] = {}


@persistent  # type: ignore[untyped-decorator]
def after_frame_change(scene: bpy.types.Scene, graph: bpy.types.Depsgraph) -> None:
    """A new frame of the viewport. Those of renders come with `before_render`."""
    if state.is_quiet() or graph.mode == "RENDER":
        return
    drawn = updating.live(scene)
    for obj in drawn:
        updating.quietly(obj, graph, drawn)
    offline.show_frame(scene)


@persistent  # type: ignore[untyped-decorator]
def before_render(scene: bpy.types.Scene, *_: object) -> None:
    """The map of the frame that is about to be rendered.

    The frame is set once more: Blender renders what is animated, and the viewport may show what
    was changed by hand since. Without a map a render in background mode ends with an error.
    """
    if updating.following(scene):
        with state.quiet():
            scene.frame_set(scene.frame_current, subframe=scene.frame_subframe)
    offline.show_frame(scene)
    drawn = updating.rendered(scene)  # what is disabled may be animated, too
    troubles = [_trouble_of_update(scene, obj, drawn) for obj in drawn]
    shown = [obj for obj in updating.in_renders(scene) if obj not in drawn]
    troubles += [_trouble_of_file(scene, obj) for obj in shown]
    for trouble in filter(None, troubles):
        line = f"rhytid: frame {scene.frame_current} has no map of its own: {trouble}"
        print(line, file=sys.stderr, flush=True)  # noqa: T201
    if any(troubles) and bpy.app.background:
        _stop(scene)


@persistent  # type: ignore[untyped-decorator]
def after_render(scene: bpy.types.Scene, *_: object) -> None:
    """A render has ended: the camera that was taken away is there again."""
    camera = _cameras.pop(scene.session_uid, None)
    if camera is not None:
        scene.camera = camera


@persistent  # type: ignore[untyped-decorator]
def after_load(*_: object) -> None:
    """Another file is open: what is known of objects of the one before is no longer true."""
    state.forget()
    _cameras.clear()
    for scene in bpy.data.scenes:
        for obj in scene.objects:
            _trouble_of_file(scene, obj)


def _trouble_of_update(
    scene: bpy.types.Scene, obj: bpy.types.Object, drawn: list[bpy.types.Object]
) -> str:
    try:
        updating.update(obj, updating.graph_of(scene, obj), drawn)
    except Trouble as trouble:
        return str(trouble)
    return ""


def _trouble_of_file(scene: bpy.types.Scene, obj: bpy.types.Object) -> str:
    """What the panel says from now on where a map that an object shows is not there, else "".

    Such a map displaces nothing, or has nothing shine.
    """
    given = ours(obj)
    shown = [(given.image, given.pattern, missing_map)]
    if given.shine and shine.connected(obj, given.shine_image):
        shown.append((given.shine_image, given.shine_pattern, missing_shine))
    for image, pattern, told in shown:
        if missing := _missing(scene, obj, image, pattern):
            status = state.status(obj)
            status.text, status.failed = told(obj.name, str(missing), given.baked), True
            return status.text
    return ""


def _missing(
    scene: bpy.types.Scene, obj: bpy.types.Object, image: bpy.types.Image | None, pattern: str
) -> Path | None:
    """A file that an image of an object needs in this frame and that is not there."""
    if image is None or image.packed_files:
        return None
    given, path = ours(obj), image.filepath
    if given.baked:
        path = offline.path_at(obj, pattern, scene.frame_current)
    found = images.files(image, path, given.udim_list())
    return next((file for file in found if not file.is_file()), None)


def _stop(scene: bpy.types.Scene) -> None:
    """End the render: an exception of a handler would be printed, and the frame rendered.

    Blender ends a render that has no camera: the operator raises RuntimeError, and Blender that was
    started to render ends with status 1.
    """
    if scene.camera is not None:
        _cameras[scene.session_uid] = scene.camera
        scene.camera = None


HANDLERS = (
    ("frame_change_post", after_frame_change),
    ("render_pre", before_render),
    ("render_cancel", after_render),
    ("render_complete", after_render),
    ("load_post", after_load),
    ("save_pre", saving.before_save),
    ("save_post", saving.after_save),
)


def add() -> None:
    """Have Blender call them."""
    for name, handler in HANDLERS:
        getattr(bpy.app.handlers, name).append(handler)


def remove() -> None:
    """Have Blender no longer call them."""
    for name, handler in HANDLERS:
        if handler in getattr(bpy.app.handlers, name):
            getattr(bpy.app.handlers, name).remove(handler)
