"""What is wrong is said in words that lead on."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from scenes import LAST, add, animate, grid


@pytest.fixture
def sheet(blender: bpy.types.Scene) -> bpy.types.Object:
    rest, faces, uv = grid(16, 12.0)
    obj = add("Sheet", rest, faces, uv)
    animate(obj, "wide", rest * (1.2, 0.9, 1.0))
    obj.rhytid.resolution = "512"
    return obj


def status(obj: bpy.types.Object) -> object:
    from bl_ext.user_default.rhytid import state

    return state.status(obj)


def test_nothing_selected(blender: bpy.types.Scene) -> None:
    with pytest.raises(RuntimeError, match="Select a mesh"):
        bpy.ops.rhytid.send()


def test_no_uv_map(sheet: bpy.types.Object) -> None:
    sheet.data.uv_layers.remove(sheet.data.uv_layers[0])
    with pytest.raises(RuntimeError, match="'Sheet' has no UV map: unwrap it"):
        bpy.ops.rhytid.send()


def test_not_sent(sheet: bpy.types.Object) -> None:
    with pytest.raises(RuntimeError, match="Send the mesh first"):
        bpy.ops.rhytid.bake()


def test_overlap_is_warned_of(blender: bpy.types.Scene, capfd: pytest.CaptureFixture[str]) -> None:
    rest, faces, uv = grid(16, 12.0)
    uv[..., 0] = np.abs(uv[..., 0] - 0.5)
    obj = add("Folded", rest, faces, uv)
    obj.rhytid.resolution = "512"
    bpy.ops.rhytid.send()
    assert [w for w in status(obj).of_mesh if w.startswith("uv-overlap")]
    assert "Warning: uv-overlap: " in capfd.readouterr().out


def test_modifier_that_changes_the_count_is_named(sheet: bpy.types.Object) -> None:
    bpy.ops.rhytid.send()
    modifier = sheet.modifiers.new("Mirror me", "MIRROR")
    modifier.use_axis = (True, False, False)
    told = r"'Sheet' has \d+ vertices, 256 were sent: hide 'Mirror me' in the viewport"
    with pytest.raises(RuntimeError, match=told):
        bpy.ops.rhytid.update()
    modifier.show_viewport = False
    assert bpy.ops.rhytid.update() == {"FINISHED"}


def test_edited_mesh_is_told(sheet: bpy.types.Object) -> None:
    bpy.ops.rhytid.send()
    sheet.data.vertices.add(1)
    sheet.data.update_tag()
    with pytest.raises(RuntimeError, match="257 vertices, 256 were sent: the mesh was edited"):
        bpy.ops.rhytid.update()


def test_object_that_blender_does_not_compute(sheet: bpy.types.Object) -> None:
    bpy.ops.rhytid.send()
    sheet.hide_viewport = True
    bpy.context.scene.frame_set(LAST)
    assert status(sheet).failed
    assert "disabled in viewports" in status(sheet).text


def test_server_goes_while_frames_play(sheet: bpy.types.Object) -> None:
    bpy.ops.rhytid.send()
    path = sheet.rhytid.image.filepath
    bpy.context.preferences.addons[
        "bl_ext.user_default.rhytid"
    ].preferences.server = "http://127.0.0.1:9"
    bpy.context.scene.frame_set(LAST)
    assert status(sheet).failed
    assert status(sheet).text.startswith("No answer from http://127.0.0.1:9")
    assert sheet.rhytid.image.filepath == path


def test_another_machine_needs_online_access(blender: bpy.types.Scene) -> None:
    prefs = bpy.context.preferences.addons["bl_ext.user_default.rhytid"].preferences
    prefs.server = "http://rhytid.test:8717"
    with pytest.raises(RuntimeError, match="may not go online"):
        bpy.ops.rhytid.connect()


def test_server_forgot_the_mesh(sheet: bpy.types.Object) -> None:
    bpy.ops.rhytid.send()
    sheet.rhytid.asset = "0" * 16
    with pytest.raises(RuntimeError, match="Send the mesh again"):
        bpy.ops.rhytid.update()


def test_a_copy_needs_a_material_of_its_own(sheet: bpy.types.Object) -> None:
    bpy.ops.rhytid.send()
    copy = sheet.copy()
    bpy.context.scene.collection.objects.link(copy)
    bpy.context.view_layer.objects.active = copy
    with pytest.raises(RuntimeError, match="'Skin' has the wrinkles of another object"):
        bpy.ops.rhytid.send()
    assert sheet.active_material.node_tree.nodes["rhytid map"].image == sheet.rhytid.image

    copy.data = copy.data.copy()
    copy.material_slots[0].material = copy.active_material.copy()
    assert bpy.ops.rhytid.send() == {"FINISHED"}
    assert copy.rhytid.image != sheet.rhytid.image
