"""What is called up to date is shown, and drawn for the object whose map it is."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import OpenEXR
import pytest
from scenes import FIRST, LAST, add, animate, client_of, grid

SHAPE = np.array([1.2, 0.9, 1.0])


@pytest.fixture
def sheet(blender: bpy.types.Scene) -> bpy.types.Object:
    rest, faces, uv = grid(16, 12.0)
    obj = add("Sheet", rest, faces, uv)
    animate(obj, "wide", rest * SHAPE)
    obj.rhytid.resolution = "256"
    bpy.ops.rhytid.send()
    return obj


@pytest.fixture
def copy(sheet: bpy.types.Object) -> bpy.types.Object:
    """A copy whose mesh has the same shape keys, and is not the same."""
    made = sheet.copy()
    made.data = sheet.data.copy()
    bpy.context.scene.collection.objects.link(made)
    return made


def status(obj: bpy.types.Object) -> Any:
    from bl_ext.user_default.rhytid import state

    return state.status(obj)


def still(obj: bpy.types.Object) -> None:
    obj.data.shape_keys.animation_data_clear()
    obj.data.shape_keys.key_blocks["wide"].value = 0.0


def shows_its_shape(obj: bpy.types.Object, service: str) -> bool:
    """Whether its image shows the map of the whole shape."""
    client, asset = client_of(service), obj.rhytid.asset
    client.put_frame(asset, "test", grid(16, 12.0)[0] * SHAPE)
    expected = client.map(asset, "test", 1001, sampling="smooth").array
    path = bpy.path.abspath(obj.rhytid.image.filepath)
    found = OpenEXR.File(path, separate_channels=True).channels()["Y"].pixels
    return bool(np.abs(found - expected).max() <= 1e-4 * np.abs(expected).max())


@pytest.mark.parametrize("what", ["deleted", "another"])
def test_a_map_that_is_not_shown_is_drawn(sheet: bpy.types.Object, service: str, what: str) -> None:
    bpy.context.scene.frame_set(LAST)
    before = sheet.rhytid.image.filepath
    if what == "deleted":
        Path(before).unlink()
    else:
        sheet.rhytid.image.filepath = "//another.exr"
    assert bpy.ops.rhytid.update() == {"FINISHED"}
    assert sheet.rhytid.image.filepath != before
    assert shows_its_shape(sheet, service)


def test_nothing_is_known_of_another_file(sheet: bpy.types.Object) -> None:
    assert status(sheet).text == "Up to date"
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    assert add("Sheet", *grid(16, 12.0)).rhytid.asset == ""
    assert status(bpy.data.objects["Sheet"]).text == ""


def test_a_copy_does_not_draw_over_the_original(
    sheet: bpy.types.Object, copy: bpy.types.Object, service: str
) -> None:
    still(copy)
    bpy.context.scene.frame_set(LAST)
    assert shows_its_shape(sheet, service)
    assert status(sheet).text == "Up to date"
    told = "'Sheet.001' shows the map of 'Sheet': give it a material of its own, then send it"
    assert (status(copy).text, status(copy).failed) == (told, True)
    bpy.context.view_layer.objects.active = copy
    with pytest.raises(RuntimeError, match=told):
        bpy.ops.rhytid.update()

    copy.material_slots[0].material = copy.active_material.copy()
    assert bpy.ops.rhytid.send() == {"FINISHED"}
    bpy.context.scene.frame_set(FIRST)
    bpy.context.scene.frame_set(LAST)
    assert not status(copy).failed
    assert shows_its_shape(sheet, service)
    assert not shows_its_shape(copy, service)


def test_a_copy_of_the_same_shape_shows_the_same_map(
    sheet: bpy.types.Object, copy: bpy.types.Object, service: str
) -> None:
    bpy.context.scene.frame_set(LAST)
    assert (status(sheet).text, status(copy).text) == ("Up to date", "Up to date")
    assert sheet.rhytid.image.filepath == status(sheet).path
    assert shows_its_shape(copy, service)


def test_a_copy_draws_where_the_original_is_not_rendered(
    sheet: bpy.types.Object,
    copy: bpy.types.Object,
    service: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As after a copy was made to be worked on, and the original put away."""
    from bl_ext.user_default.rhytid import handlers

    monkeypatch.setattr(handlers, "_stop", lambda scene: pytest.fail("the render was stopped"))
    still(sheet)
    sheet.hide_render = sheet.hide_viewport = True
    bpy.context.scene.frame_current = LAST
    handlers.before_render(bpy.context.scene)
    assert shows_its_shape(copy, service)
    bpy.context.scene.frame_set(FIRST)
    bpy.context.scene.frame_set(LAST)
    assert shows_its_shape(copy, service)
    assert status(copy).text == "Up to date"


@pytest.mark.parametrize("how", ["object", "collection", "excluded"])
def test_what_is_not_rendered_ends_no_render(
    sheet: bpy.types.Object, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    from bl_ext.user_default.rhytid import handlers

    ended: list[bpy.types.Scene] = []
    monkeypatch.setattr(handlers, "_stop", ended.append)
    scene = bpy.context.scene
    aside = bpy.data.collections.new("aside")
    scene.collection.children.link(aside)
    aside.objects.link(sheet)
    scene.collection.objects.unlink(sheet)
    if how == "excluded":
        bpy.context.view_layer.layer_collection.children["aside"].exclude = True
    else:
        hidden = sheet if how == "object" else aside
        hidden.hide_render = hidden.hide_viewport = True
    handlers.before_render(scene)
    assert ended == []

    if how != "excluded":
        hidden.hide_render = False
        handlers.before_render(scene)
        assert ended == [scene]
