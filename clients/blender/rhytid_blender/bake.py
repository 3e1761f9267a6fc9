"""Maps of all frames as files, and folders of them opened."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import bpy
from bpy.props import IntProperty, StringProperty

from . import connection, images, offline, rendering, state, updating
from .operators import Simple, active
from .words import NOT_SENT, Trouble
from .working import Step, Worker

DIGITS = 4


class RHYTID_OT_bake(Worker, bpy.types.Operator):
    """Draw the frames of the scene as EXR files, then show these: renders need no server then"""

    bl_idname, bl_label = "rhytid.bake", "Bake the Frames"

    def steps(self, context: bpy.types.Context) -> Iterator[Step]:
        """A frame a step; the frame that was shown comes back, whatever happens."""
        obj, scene = active(context), context.scene
        if not obj.rhytid.asset:
            raise Trouble(NOT_SENT)
        folder = folder_of(obj)
        frames = range(max(scene.frame_start, 0), scene.frame_end + 1)
        if not frames:
            raise Trouble("The scene has no frames from 0 on")
        shown, name, udims = scene.frame_current, images.slug(obj.name), []
        try:
            for done, frame in enumerate(frames):
                yield done / len(frames), f"frame {frame} of {frames[-1]}", 0.0
                udims = _written(obj, scene, frame, folder / name)
        finally:
            with state.quiet():
                scene.frame_set(shown)
        pattern = str(folder / f"{name}.<UDIM>.<FRAME>.exr")
        unit = obj.rhytid.sent_unit
        maps = offline.Sequence(name, pattern, udims, list(frames), DIGITS, unit)
        offline.opened(obj, maps)
        count = "1 frame" if len(frames) == 1 else f"{len(frames)} frames"
        self.report({"INFO"}, f"{count} in {folder}")


def _written(obj: bpy.types.Object, scene: bpy.types.Scene, frame: int, start: Path) -> list[int]:
    """Draw a frame and write its files; their UDIMs."""
    with state.quiet():
        scene.frame_set(frame)
    now = updating.positions(obj, updating.graph_of(scene, obj))
    asked = updating.query(obj, "exr16" if obj.rhytid.half else "exr")
    with connection.server() as client:
        udims = list(client.asset(obj.rhytid.asset).udims)
    maps, _ = connection.drawn(obj.rhytid.asset, f"bake-{start.name}", now, udims, asked)
    for udim, data in maps.items():
        images.replaced(start.with_name(f"{start.name}.{udim}.{frame:0{DIGITS}d}.exr"), data)
    return udims


def folder_of(obj: bpy.types.Object) -> Path:
    """Where maps of the object are baked to, made where it is not there; raises Trouble."""
    given = obj.rhytid.folder
    if given.startswith("//") and not bpy.data.filepath:
        raise Trouble("Save the .blend first, or choose a folder that is not beside it")
    folder = Path(bpy.path.abspath(given))
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as exc:
        raise Trouble(f"Maps cannot be written to {folder}: {exc}") from exc
    return folder


class RHYTID_OT_open(Simple, bpy.types.Operator):
    """Show the maps of a folder that 'rhytid bake' wrote, with material and Cycles set up"""

    bl_idname, bl_label = "rhytid.open", "Open Baked Maps"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  as Blender wants it

    directory: StringProperty(subtype="DIR_PATH")
    name: StringProperty(name="Name", description="NAME of NAME.<UDIM>.<FRAME>.exr; empty for any")
    start: IntProperty(
        name="First frame at",
        description="The frame of the scene that plays the first file; -1 for the file's number",
        default=-1,
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Let the folder be chosen."""
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def done(self, context: bpy.types.Context) -> str:
        """Open it."""
        obj = active(context)
        folder = Path(bpy.path.abspath(self.directory))
        maps = offline.found(folder, self.name)
        offline.opened(obj, maps, None if self.start < 0 else self.start)
        done = rendering.set_up(obj, context.scene)
        first, last = maps.frames[0], maps.frames[-1]
        return "; ".join([f"Files {first} to {last} of {maps.name}", *done])


CLASSES = (RHYTID_OT_bake, RHYTID_OT_open)
