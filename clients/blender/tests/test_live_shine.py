"""Shine that is drawn with the map of each frame: on one UDIM and several, saved, missing, and
after the server was away."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from scenes import FIRST, LAST, add, animate, client_of, grid

from conftest import preferences

SHAPE = np.array([1.2, 0.9, 1.0])
ROUGHNESS = 0.3


def sheet(udims: int) -> bpy.types.Object:
    rest, faces, uv = grid(16, 12.0, udims)
    obj = add("Sheet", rest, faces, uv)
    animate(obj, "wide", rest * SHAPE)
    obj.rhytid.resolution, obj.rhytid.unit = "256", "cm"
    obj.rhytid.shine, obj.rhytid.roughness = True, ROUGHNESS
    bpy.ops.rhytid.send()
    return obj


@pytest.fixture
def one(blender: bpy.types.Scene) -> bpy.types.Object:
    return sheet(1)


def tree_of(obj: bpy.types.Object) -> Any:
    return obj.active_material.node_tree


def shining(obj: bpy.types.Object) -> bool:
    return tree_of(obj).nodes["Principled BSDF"].inputs["Roughness"].is_linked


def status(obj: bpy.types.Object) -> Any:
    from bl_ext.user_default.rhytid import state

    return state.status(obj)


def file_of(image: bpy.types.Image, udim: int = 1001) -> Path:
    return Path(bpy.path.abspath(image.filepath.replace("<UDIM>", str(udim))))


def drawn(obj: bpy.types.Object, service: str, shape: np.ndarray, udim: int = 1001) -> bytes:
    """The file of a shape, as the service has its slopes for another client."""
    from rhytid_client.hosts import baking

    client = client_of(service)
    rest = grid(16, 12.0, len(obj.rhytid.udim_list()))[0]
    client.put_frame(obj.rhytid.asset, "test", rest * shape)
    slopes = client.map(
        obj.rhytid.asset, "test", udim, level=2, layer="slopes", sampling="smooth"
    ).array
    return baking.shine(slopes, obj.rhytid.roughness, quick=True)


@pytest.mark.parametrize("udims", [1, 2])
def test_shine_follows_the_frame(blender: bpy.types.Scene, service: str, udims: int) -> None:
    obj = sheet(udims)
    assert shining(obj)
    image = tree_of(obj).nodes["rhytid shine"].image
    assert image == obj.rhytid.shine_image
    assert image.source == ("FILE" if udims == 1 else "TILED")
    assert image.colorspace_settings.name == "Non-Color"
    for frame, shape in ((LAST, SHAPE), (FIRST, np.ones(3))):
        blender.frame_set(frame)
        assert status(obj).text == "Up to date"
        for udim in range(1001, 1001 + udims):
            assert file_of(image, udim).read_bytes() == drawn(obj, service, shape, udim)
    if udims == 2:
        assert [tile.number for tile in image.tiles] == [1001, 1002]


def test_twenty_frames_leave_nothing_behind(
    one: bpy.types.Object, blender: bpy.types.Scene
) -> None:
    image, nodes = one.rhytid.shine_image, len(tree_of(one).nodes)
    for step in range(20):
        blender.frame_set(FIRST + step % 10)
    assert one.rhytid.shine_image == image
    assert len(tree_of(one).nodes) == nodes
    assert len(list(file_of(image).parent.glob("*.png"))) <= 3


def test_it_is_drawn_when_it_is_asked_for(one: bpy.types.Object, service: str) -> None:
    one.rhytid.shine = False
    assert not shining(one)
    before = one.rhytid.shine_image.filepath
    bpy.context.scene.frame_set(LAST)
    assert one.rhytid.shine_image.filepath == before
    one.rhytid.shine = True
    assert bpy.ops.rhytid.update() == {"FINISHED"}
    assert shining(one)
    assert file_of(one.rhytid.shine_image).read_bytes() == drawn(one, service, SHAPE)


def test_it_has_the_roughness_that_is_given(one: bpy.types.Object, service: str) -> None:
    assert bpy.ops.rhytid.update() == {"FINISHED"}
    before = one.rhytid.shine_image.filepath
    assert bpy.ops.rhytid.update() == {"FINISHED"}
    assert one.rhytid.shine_image.filepath == before, "the same was drawn again"
    one.rhytid.roughness = 0.5
    assert bpy.ops.rhytid.update() == {"FINISHED"}
    assert file_of(one.rhytid.shine_image).read_bytes() == drawn(one, service, np.ones(3))
    base = tree_of(one).nodes["rhytid shine formulas"].inputs["Base Roughness"]
    assert base.default_value == 0.5


def test_a_file_that_is_gone_is_drawn_again(one: bpy.types.Object, service: str) -> None:
    file_of(one.rhytid.shine_image).unlink()
    assert bpy.ops.rhytid.update() == {"FINISHED"}
    assert file_of(one.rhytid.shine_image).read_bytes() == drawn(one, service, np.ones(3))


def test_after_the_server_was_away(
    one: bpy.types.Object, blender: bpy.types.Scene, service: str
) -> None:
    shown = one.rhytid.shine_image.filepath
    preferences().server = "http://127.0.0.1:9"
    blender.frame_set(LAST)
    assert status(one).failed
    assert (shining(one), one.rhytid.shine_image.filepath) == (True, shown)
    preferences().server = service
    assert bpy.ops.rhytid.update() == {"FINISHED"}
    assert file_of(one.rhytid.shine_image).read_bytes() == drawn(one, service, SHAPE)


@pytest.mark.parametrize("udims", [1, 2])
def test_a_saved_file_has_it(blender: bpy.types.Scene, tmp_path: Path, udims: int) -> None:
    obj = sheet(udims)
    image, numbers = obj.rhytid.shine_image, range(1001, 1001 + udims)
    expected = [file_of(image, udim).read_bytes() for udim in numbers]
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    shutil.rmtree(Path(bpy.app.tempdir) / "rhytid")
    assert image.filepath.startswith("//rhytid/shot/Sheet.shine.")
    kept = [file_of(image, udim) for udim in numbers]
    assert [file.read_bytes() for file in kept] == expected
    shown = image.filepath
    assert bpy.ops.rhytid.update() == {"FINISHED"}
    assert image.filepath == shown, "what was saved was drawn again"
    blender.frame_set(4)
    for _ in range(3):
        obj.data.vertices[0].co.x += 0.1
        obj.data.update()
        blender.frame_set(blender.frame_current + 1)
        bpy.ops.wm.save_mainfile()
    names = {file.name for file in (tmp_path / "rhytid" / "shot").glob("*.png")}
    assert len(names) == 2 * udims, "older versions"

    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    assert status(bpy.data.objects["Sheet"]).text == ""
    shutil.rmtree(tmp_path / "rhytid")
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    assert status(bpy.data.objects["Sheet"]).text.startswith("The map of 'Sheet' is missing")


def test_the_panel_tells_of_shine_that_is_missing(one: bpy.types.Object, tmp_path: Path) -> None:
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    file_of(one.rhytid.shine_image).unlink()
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    obj = bpy.data.objects["Sheet"]
    assert status(obj).failed
    assert status(obj).text.startswith("The shine of 'Sheet' is missing, its roughness is even: ")
    bpy.context.view_layer.objects.active = obj
    assert bpy.ops.rhytid.update() == {"FINISHED"}
    assert not status(obj).failed


def test_maps_that_are_opened_end_the_trouble_of_those_before(
    one: bpy.types.Object, blender: bpy.types.Scene, tmp_path: Path
) -> None:
    blender.frame_end = 1
    one.rhytid.folder = str(tmp_path / "maps")
    assert bpy.ops.rhytid.bake() == {"FINISHED"}
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    (tmp_path / "maps").rename(tmp_path / "elsewhere")
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    obj = bpy.data.objects["Sheet"]
    assert status(obj).failed
    bpy.context.view_layer.objects.active = obj
    assert bpy.ops.rhytid.open(directory=str(tmp_path / "elsewhere")) == {"FINISHED"}
    assert (status(obj).text, status(obj).failed) == ("", False)


def test_from_baked_frames_to_live_ones(
    one: bpy.types.Object, blender: bpy.types.Scene, service: str, tmp_path: Path
) -> None:
    blender.frame_end = 2
    one.rhytid.folder = str(tmp_path / "maps")
    assert bpy.ops.rhytid.bake() == {"FINISHED"}
    image = one.rhytid.shine_image
    user = tree_of(one).nodes["rhytid shine"].image_user
    for lobes in (False, True):
        one.rhytid.lobes = lobes
        assert (image.source, user.frame_duration) == ("SEQUENCE", 2)
    blender.frame_set(LAST)
    assert bpy.ops.rhytid.update() == {"FINISHED"}
    assert image.source == "FILE"
    assert file_of(image).read_bytes() == drawn(one, service, SHAPE)


def test_a_copy_has_shine_of_its_own(
    one: bpy.types.Object, blender: bpy.types.Scene, service: str
) -> None:
    copy = one.copy()
    copy.data = one.data.copy()
    blender.collection.objects.link(copy)
    copy.material_slots[0].material = one.active_material.copy()
    copy.data.shape_keys.animation_data_clear()
    copy.data.shape_keys.key_blocks["wide"].value = 0.0
    bpy.context.view_layer.objects.active = copy
    assert bpy.ops.rhytid.send() == {"FINISHED"}
    blender.frame_set(LAST)
    assert one.rhytid.shine_image != copy.rhytid.shine_image
    assert tree_of(copy).nodes["rhytid shine"].image == copy.rhytid.shine_image
    assert file_of(one.rhytid.shine_image).read_bytes() == drawn(one, service, SHAPE)


def test_a_material_that_cannot_shine_is_told(one: bpy.types.Object) -> None:
    tree = tree_of(one)
    tree.nodes.remove(tree.nodes["Principled BSDF"])
    one.rhytid.roughness = 0.4
    one.rhytid.shine = False
    one.rhytid.shine = True
    with pytest.raises(RuntimeError, match="has a Principled BSDF: shine is not connected"):
        bpy.ops.rhytid.update()
