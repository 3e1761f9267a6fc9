"""Maps of all frames as files, and folders of them opened."""

from __future__ import annotations

from collections.abc import Generator
from pathlib import Path
from typing import TYPE_CHECKING

import bpy
from bpy.props import IntProperty, StringProperty

from rhytid_client.hosts import MapSequence, Trouble, found
from rhytid_client.hosts.baking import baking
from rhytid_client.hosts.files import folder_at, slug
from rhytid_client.hosts.sequences import STANDARD
from rhytid_client.hosts.trouble import NOT_SENT
from rhytid_client.hosts.work import Step

from . import connection, meshes, offline, rendering, state, updating
from .operators import Simple, active
from .properties import ours
from .typed import Result, scene_of, window_manager_of
from .working import Worker


class RHYTID_OT_bake(Worker, bpy.types.Operator):
    """Draw the frames of the scene as EXR files, then show these: renders need no server then"""

    bl_idname, bl_label = "rhytid.bake", "Bake the Frames"

    def steps(self, context: bpy.types.Context) -> Generator[Step, None, None]:
        """A frame a step; the frame that was shown comes back, whatever happens."""
        obj, scene = active(context), scene_of(context)
        if not ours(obj).asset:
            raise Trouble(NOT_SENT)
        maps = _sequence(obj, scene)
        drawing = updating.drawing(obj, "exr16" if ours(obj).half else "exr")
        shown = scene.frame_current

        def positions(frame: int) -> meshes.Array:
            with state.quiet():
                scene.frame_set(frame)
            return updating.positions(obj, updating.graph_of(scene, obj))

        try:
            server, asset = connection.server(), ours(obj).asset
            shine = ours(obj).roughness if ours(obj).shine else None
            yield from baking(server, asset, maps, positions, drawing, shine)
        finally:
            with state.quiet():
                scene.frame_set(shown)
        offline.opened(obj, maps)
        if ours(obj).shine:
            offline.show_shine(obj, maps)
        count = "1 frame" if len(maps.frames) == 1 else f"{len(maps.frames)} frames"
        self.report({"INFO"}, f"{count} in {Path(maps.pattern).parent}")


def _sequence(obj: bpy.types.Object, scene: bpy.types.Scene) -> MapSequence:
    """The maps of the scene's frames, which are to be made; raises Trouble."""
    folder = folder_of(obj)
    frames = range(max(scene.frame_start, 0), scene.frame_end + 1)
    if not frames:
        raise Trouble("The scene has no frames from 0 on")
    with connection.server().client() as client:
        udims = client.asset(ours(obj).asset).udims
    # Without a unit: maps of this mesh are in units of it, whatever was chosen since.
    return MapSequence.of(folder, slug(obj.name), STANDARD, udims, frames)


def folder_of(obj: bpy.types.Object) -> Path:
    """Where maps of the object are baked to, made where it is not there; raises Trouble."""
    given = ours(obj).folder
    if given.startswith("//") and not bpy.data.filepath:
        raise Trouble("Save the .blend first, or choose a folder that is not beside it")
    return folder_at(Path(bpy.path.abspath(given)))


class RHYTID_OT_open(Simple, bpy.types.Operator):
    """Show the maps of a folder that 'rhytid bake' wrote, with material and Cycles set up"""

    bl_idname, bl_label = "rhytid.open", "Open Baked Maps"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  as Blender wants it

    if TYPE_CHECKING:
        directory: str
        name: str
        start: int
    else:  # Blender reads annotations, which hold calls
        directory: StringProperty(subtype="DIR_PATH")
        name: StringProperty(
            name="Name", description="NAME of NAME.<UDIM>.<FRAME>.exr; empty for any"
        )
        start: IntProperty(
            name="First frame at",
            description="The frame of the scene that plays the first file; -1 for its number",
            default=-1,
        )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> Result:
        """Let the folder be chosen."""
        window_manager_of(context).fileselect_add(self)
        return {"RUNNING_MODAL"}

    def done(self, context: bpy.types.Context) -> str:
        """Open it."""
        obj = active(context)
        folder = Path(bpy.path.abspath(self.directory))
        maps = found(folder, self.name)
        offline.opened(obj, maps, None if self.start < 0 else self.start)
        if ours(obj).shine and maps.shine.file(maps.udims[0], maps.frames[0]).exists():
            offline.show_shine(obj, maps)
        done = rendering.set_up(obj, scene_of(context))
        for warning in state.status(obj).of_frame:
            self.report({"WARNING"}, warning)
        first, last = maps.frames[0], maps.frames[-1]
        return "; ".join([f"Files {first} to {last} of {maps.name}", *done])


CLASSES = (RHYTID_OT_bake, RHYTID_OT_open)
