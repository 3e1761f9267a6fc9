"""Baked maps and the object that shows them: what stays where something fails or was changed."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import OpenEXR
import pytest
from scenes import add, animate, grid

from conftest import preferences

FRAMES = 3


def sheet() -> bpy.types.Object:
    rest, faces, uv = grid(16, 12.0)
    obj = add("Sheet", rest, faces, uv)
    animate(obj, "wide", rest * (1.2, 0.9, 1.0))
    obj.rhytid.resolution, obj.rhytid.unit = "256", "cm"
    bpy.context.scene.frame_end = FRAMES
    return obj


@pytest.fixture
def baked(blender: bpy.types.Scene, tmp_path: Path) -> tuple[bpy.types.Object, Path]:
    obj, folder = sheet(), tmp_path / "maps"
    bpy.ops.rhytid.send()
    obj.rhytid.folder = str(folder)
    assert bpy.ops.rhytid.bake() == {"FINISHED"}
    return obj, folder


def test_a_bake_is_as_high_as_the_live_map(blender: bpy.types.Scene, tmp_path: Path) -> None:
    """Whatever unit was chosen after the mesh was sent."""
    obj = sheet()
    bpy.ops.rhytid.send()
    obj.rhytid.folder, obj.rhytid.unit = str(tmp_path / "maps"), "mm"
    bpy.ops.rhytid.bake()
    assert obj.rhytid.factor == 1.0


def test_a_new_material_plays_the_sequence(baked: tuple) -> None:
    obj, folder = baked
    bpy.ops.rhytid.open(directory=str(folder), start=4)
    obj.material_slots[0].material = bpy.data.materials.new("New")
    assert bpy.ops.rhytid.set_up() == {"FINISHED"}
    user = obj.active_material.node_tree.nodes["rhytid map"].image_user
    assert (user.frame_duration, user.frame_start, user.frame_offset) == (FRAMES, 4, 0)
    assert user.use_auto_refresh


@pytest.mark.parametrize("why", ["server", "shape"])
def test_what_cannot_be_live_stays_baked(baked: tuple, why: str) -> None:
    obj, _ = baked
    obj.rhytid.factor, obj.rhytid.udims = 10.0, "1001,1002"
    shown, url = obj.rhytid.image.filepath, preferences().server
    if why == "server":
        preferences().server = "http://127.0.0.1:9"
    else:
        obj.hide_viewport = True
    with pytest.raises(RuntimeError, match="No answer" if why == "server" else "disabled in view"):
        bpy.ops.rhytid.update()
    found = (obj.rhytid.baked, obj.rhytid.factor, obj.rhytid.udims, obj.rhytid.image.filepath)
    assert found == (True, 10.0, "1001,1002", shown)

    preferences().server, obj.hide_viewport = url, False
    assert bpy.ops.rhytid.update() == {"FINISHED"}
    assert (obj.rhytid.baked, obj.rhytid.factor, obj.rhytid.udims) == (False, 1.0, "1001")
    assert obj.rhytid.image.source == "FILE"


def test_a_folder_that_does_not_open_changes_nothing(
    blender: bpy.types.Scene, tmp_path: Path
) -> None:
    obj = sheet()
    header = {
        "unit": "parsec",
        "type": OpenEXR.scanlineimage,
        "compression": OpenEXR.NO_COMPRESSION,
    }
    heights = {"Y": np.zeros((4, 4), np.float32)}
    OpenEXR.File(header, heights).write(str(tmp_path / "Sheet.1001.0001.exr"))
    with pytest.raises(RuntimeError, match="Maps in 'parsec' have no known size"):
        bpy.ops.rhytid.open(directory=str(tmp_path))
    assert (obj.rhytid.baked, obj.rhytid.pattern, obj.rhytid.udims) == (False, "", "")


def test_a_copy_does_not_open_maps_over_the_original(baked: tuple) -> None:
    obj, folder = baked
    copy = obj.copy()
    copy.data, copy.rhytid.baked = obj.data.copy(), False
    copy.data.uv_layers[0].name = "other"
    bpy.context.scene.collection.objects.link(copy)
    bpy.context.view_layer.objects.active = copy
    with pytest.raises(RuntimeError, match="has the wrinkles of another object"):
        bpy.ops.rhytid.open(directory=str(folder))
    assert (copy.rhytid.baked, copy.rhytid.uv_map) == (False, "map")
    assert obj.active_material.node_tree.nodes["rhytid uv"].uv_map == "map"

    copy.material_slots[0].material = copy.active_material.copy()
    assert bpy.ops.rhytid.open(directory=str(folder)) == {"FINISHED"}
    assert copy.rhytid.image != obj.rhytid.image


def test_a_copy_of_a_baked_object_is_not_drawn_over_it(baked: tuple) -> None:
    obj, _ = baked
    copy, shown = obj.copy(), obj.rhytid.image.filepath
    bpy.context.scene.collection.objects.link(copy)
    bpy.context.view_layer.objects.active = copy
    with pytest.raises(RuntimeError, match=r"'Sheet.001' shows the map of 'Sheet': give it"):
        bpy.ops.rhytid.update()
    assert (obj.rhytid.image.filepath, obj.rhytid.image.source) == (shown, "SEQUENCE")
