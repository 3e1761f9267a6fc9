"""The panel, in the sidebar of the 3D viewport."""

from __future__ import annotations

import textwrap
from typing import Literal

import bpy

from . import state
from .preferences import preferences
from .properties import ours
from .typed import there

_WIDTH = 44
Icon = Literal["ERROR", "CHECKMARK", "INFO"]


class RHYTID_PT_main(bpy.types.Panel):
    """Server, mesh, look, bake."""

    bl_idname, bl_label = "RHYTID_PT_main", "Rhytid"
    bl_space_type, bl_region_type, bl_category = "VIEW_3D", "UI", "Rhytid"

    def draw(self, context: bpy.types.Context) -> None:
        """From the server down to the files."""
        layout = there(self.layout, "a layout")
        layout.use_property_split, layout.use_property_decorate = True, False
        layout.prop(preferences(), "server")
        layout.prop(preferences(), "key")
        layout.operator("rhytid.connect", icon="URL")
        if state.work().running:
            _progress(layout)
        obj = context.object
        if obj is None or obj.type != "MESH":
            layout.label(text="Select a mesh", icon="INFO")
            return
        _mesh(layout, obj)
        if ours(obj).image is not None:
            _look(layout, obj)
        _shine(layout, obj)
        _files(layout, obj)
        _status(layout, obj)


def _progress(layout: bpy.types.UILayout) -> None:
    work = state.work()
    row = layout.row()
    row.progress(factor=work.share, text=work.text)
    row.operator("rhytid.cancel", text="", icon="CANCEL")


def _mesh(layout: bpy.types.UILayout, obj: bpy.types.Object) -> None:
    column = layout.column()
    column.prop(ours(obj), "resolution")
    column.prop(ours(obj), "unit")
    again = "Send the Mesh Again" if ours(obj).asset else "Send the Mesh"
    column.operator("rhytid.send", text=again, icon="EXPORT")
    column.operator("rhytid.move", icon="MOD_DISPLACE")
    if ours(obj).sent_unit:
        column.label(text=f"{ours(obj).vertices} vertices, in {ours(obj).sent_unit}")


def _look(layout: bpy.types.UILayout, obj: bpy.types.Object) -> None:
    column = layout.column()
    column.prop(ours(obj), "strength")
    if ours(obj).asset:
        column.prop(ours(obj), "method")
        column.prop(ours(obj), "smooth")
        column.prop(ours(obj), "live")
        if ours(obj).method == "binned":
            column.operator("rhytid.calibrate")
        text = "Draw Live Again" if ours(obj).baked else "Draw Now"
        column.operator("rhytid.update", text=text, icon="FILE_REFRESH")
    column.operator("rhytid.set_up", icon="NODETREE")


def _shine(layout: bpy.types.UILayout, obj: bpy.types.Object) -> None:
    column = layout.column()
    column.prop(ours(obj), "shine")
    if ours(obj).shine:
        column.prop(ours(obj), "roughness")
        column.prop(ours(obj), "lobes")


def _files(layout: bpy.types.UILayout, obj: bpy.types.Object) -> None:
    column = layout.column()
    if ours(obj).asset:
        column.prop(ours(obj), "folder")
        column.prop(ours(obj), "half")
        column.operator("rhytid.bake", icon="RENDER_ANIMATION")
    column.operator("rhytid.open", icon="FILE_FOLDER")


def _status(layout: bpy.types.UILayout, obj: bpy.types.Object) -> None:
    status = state.status(obj)
    if status.text:
        _text(layout, status.text, "ERROR" if status.failed else "CHECKMARK")
    for warning in (*status.of_mesh, *status.of_frame):
        _text(layout, warning, "INFO")


def _text(layout: bpy.types.UILayout, text: str, icon: Icon) -> None:
    box = layout.box().column(align=True)
    for at, line in enumerate(textwrap.wrap(text, _WIDTH)):
        row = box.row()
        row.alert = icon == "ERROR"
        row.label(text=line, icon=icon if at == 0 else "BLANK1")


CLASSES = (RHYTID_PT_main,)
