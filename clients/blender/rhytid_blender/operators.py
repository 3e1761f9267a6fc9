"""The buttons of the panel."""

from __future__ import annotations

from collections.abc import Generator
from typing import Any

import bpy

from rhytid_client import Asset
from rhytid_client.hosts import Scan, Trouble
from rhytid_client.hosts.trouble import NOT_SENT
from rhytid_client.hosts.units import guessed_unit
from rhytid_client.hosts.work import Step

from . import connection, images, meshes, nodes, offline, rendering, scans, state, updating
from .properties import ours, scale
from .typed import OperatorPart, Result, scene_of
from .words import NO_MESH, copied
from .working import Worker


def active(context: bpy.types.Context) -> bpy.types.Object:
    """The mesh that is worked on; raises Trouble."""
    obj = context.object
    if obj is None or obj.type != "MESH":
        raise Trouble(NO_MESH)
    return obj


class Simple(OperatorPart):
    """A part of an operator that does one thing and says what it did."""

    def execute(self, context: bpy.types.Context) -> Result:
        """Do it."""
        try:
            self.report({"INFO"}, self.done(context))
        except Trouble as trouble:
            self.report({"ERROR"}, str(trouble))
            return {"CANCELLED"}
        return {"FINISHED"}

    def done(self, context: bpy.types.Context) -> str:
        """What was done, in words; raises Trouble."""
        raise NotImplementedError


class RHYTID_OT_connect(Simple, bpy.types.Operator):
    """Ask the server whether it is there and computes"""

    bl_idname, bl_label = "rhytid.connect", "Test the Connection"

    def done(self, context: bpy.types.Context) -> str:
        """Ask it."""
        return connection.server().tested()


class Sender(Worker):
    """A part of an operator that sends the mesh and shows the skin that comes back."""

    def displacement(self, obj: bpy.types.Object) -> scans.Displacement | None:
        """What is sent as a scan, in place of skin that is grown; raises Trouble."""
        return None

    def steps(self, context: bpy.types.Context) -> Generator[Step, None, None]:
        """Send, wait, set up, draw."""
        obj, scene = active(context), scene_of(context)
        mesh, theirs = meshes.rest(obj), self.displacement(obj)
        settings = _settings(obj, mesh["positions"])
        server, shapes = connection.server(), meshes.shapes(obj)
        scan = None
        if theirs is not None:
            how = {"scale": theirs.scale, "midlevel": theirs.midlevel}
            scan = Scan(theirs.files(mesh), how)
        asset = yield from server.sending(mesh, settings, shapes, obj.name, scan)
        _sent(obj, asset, settings["unit"])
        updating.update(obj, updating.graph_of(scene, obj))
        if theirs is not None:  # ours holds it
            nodes.check(obj, ours(obj).image)
            theirs.unlink()
        done = [*nodes.set_up(obj), *rendering.set_up(obj, scene)]
        offline.connect_shine(obj)
        self.report({"INFO"}, "Set up: " + "; ".join(done))
        for warning in state.status(obj).of_mesh:
            self.report({"WARNING"}, warning)


class RHYTID_OT_send(Sender, bpy.types.Operator):
    """Send the shape without modifiers, and its shape keys, and have wrinkles grown on it; then set
    material, modifier and Cycles up, and draw the first map"""

    bl_idname, bl_label = "rhytid.send", "Send the Mesh"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  as Blender wants it


class RHYTID_OT_move(Sender, bpy.types.Operator):
    """Send the mesh with the image that its material displaces with, a scan or a sculpt, and show
    the same relief with lines that move in its place"""

    bl_idname, bl_label = "rhytid.move", "Make It Move"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  as Blender wants it

    def displacement(self, obj: bpy.types.Object) -> scans.Displacement | None:
        """That of its materials."""
        return scans.displacement_of(obj)


def _settings(obj: bpy.types.Object, positions: meshes.Array) -> dict[str, Any]:
    resolution, unit = int(ours(obj).resolution), ours(obj).unit
    if unit == "auto":
        unit = guessed_unit(positions)
    return {"resolution": resolution, "tile_size": min(resolution, 512), "unit": unit}


def _sent(obj: bpy.types.Object, asset: Asset, unit: str) -> None:
    given, status = ours(obj), state.status(obj)
    given.asset, given.vertices, given.sent_unit = asset.id, asset.vertices, unit
    images.part(obj)
    given.udims = ",".join(str(udim) for udim in asset.udims)
    given.uv_map, given.factor, given.baked = meshes.uv_map(obj), 1.0, False
    status.of_mesh, status.digest = tuple(str(warning) for warning in asset.warnings), ""


class RHYTID_OT_update(Simple, bpy.types.Operator):
    """Draw the map of the present shape"""

    bl_idname, bl_label = "rhytid.update", "Draw Now"

    def done(self, context: bpy.types.Context) -> str:
        """Draw it, live."""
        obj, scene = active(context), scene_of(context)
        if not ours(obj).asset:
            raise Trouble(NOT_SENT)
        if ours(obj).baked:
            _live_again(obj, scene)
        else:
            _draw_now(obj, scene)
        scale(obj)
        return "The map is that of the present shape"


def _draw_now(obj: bpy.types.Object, scene: bpy.types.Scene) -> None:
    updating.update(obj, updating.graph_of(scene, obj), updating.live(scene))


def _live_again(obj: bpy.types.Object, scene: bpy.types.Scene) -> None:
    """Draw instead of playing baked maps; where that fails, the object goes on playing them."""
    given, other = ours(obj), images.sharer(obj)
    if other is not None:
        raise Trouble(copied(obj.name, other.name))
    before = given.udims
    with connection.server().client() as client:
        given.udims = ",".join(str(udim) for udim in client.asset(given.asset).udims)
    try:
        _draw_now(obj, scene)
    except Trouble:
        given.udims = before
        raise
    given.baked, given.factor, given.shine_pattern = False, 1.0, ""


class RHYTID_OT_set_up(Simple, bpy.types.Operator):
    """Set material, modifier and Cycles up once more, after they were changed"""

    bl_idname, bl_label = "rhytid.set_up", "Set Up Material and Cycles"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  as Blender wants it

    def done(self, context: bpy.types.Context) -> str:
        """Set it up."""
        obj = active(context)
        if ours(obj).image is None:
            raise Trouble(NOT_SENT)
        done = nodes.set_up(obj)
        offline.connect_shine(obj)
        offline.play(obj)
        return "; ".join([*done, *rendering.set_up(obj, scene_of(context))])


class RHYTID_OT_calibrate(Worker, bpy.types.Operator):
    """Make the precomputed maps for the stretch of the present shape: choose a strong expression"""

    bl_idname, bl_label = "rhytid.calibrate", "Calibrate from This Frame"

    def steps(self, context: bpy.types.Context) -> Generator[Step, None, None]:
        """Send the frame and wait for the maps."""
        obj = active(context)
        now = updating.positions(obj, updating.graph_of(scene_of(context), obj))
        yield from connection.server().calibrating(ours(obj).asset, now)
        state.status(obj).digest = ""
        self.report({"INFO"}, "Precomputed maps are made for this stretch")


class RHYTID_OT_cancel(bpy.types.Operator):
    """End the work that is being done"""

    bl_idname, bl_label = "rhytid.cancel", "Cancel"

    def execute(self, context: bpy.types.Context) -> Result:
        """Have it end at its next step."""
        state.work().cancelled = True
        return {"FINISHED"}


CLASSES = (
    RHYTID_OT_connect,
    RHYTID_OT_send,
    RHYTID_OT_move,
    RHYTID_OT_update,
    RHYTID_OT_set_up,
    RHYTID_OT_calibrate,
    RHYTID_OT_cancel,
)
