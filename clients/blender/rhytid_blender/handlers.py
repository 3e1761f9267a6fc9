"""Maps follow the frame, in the viewport and in renders."""

from __future__ import annotations

import os
import sys

import bpy
from bpy.app.handlers import persistent

from rhytid_client.hosts import Trouble

from . import offline, state, updating


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
    was changed by hand since. Without a map a render in background mode ends with status 1.
    """
    if updating.following(scene):
        with state.quiet():
            scene.frame_set(scene.frame_current, subframe=scene.frame_subframe)
    offline.show_frame(scene)
    drawn = updating.rendered(scene)  # what is disabled may be animated, too
    for obj in drawn:
        _render_update(scene, obj, drawn)


@persistent  # type: ignore[untyped-decorator]
def after_load(*_: object) -> None:
    """Another file is open: what is known of objects of the one before is no longer true."""
    state.forget()


def _render_update(
    scene: bpy.types.Scene, obj: bpy.types.Object, drawn: list[bpy.types.Object]
) -> None:
    try:
        updating.update(obj, updating.graph_of(scene, obj), drawn)
    except Trouble as trouble:
        _failed(scene, trouble)


def _failed(scene: bpy.types.Scene, trouble: Trouble) -> None:
    line = f"rhytid: frame {scene.frame_current} has no map of its own: {trouble}"
    print(line, file=sys.stderr, flush=True)  # noqa: T201
    if bpy.app.background:
        # An exception of a handler would be printed, and the frame rendered with an older map.
        os._exit(1)


HANDLERS = (
    ("frame_change_post", after_frame_change),
    ("render_pre", before_render),
    ("load_post", after_load),
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
