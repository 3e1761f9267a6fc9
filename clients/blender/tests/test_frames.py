"""Maps follow the frames of an animation, and are those that the service draws."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import OpenEXR
import pytest
from scenes import FIRST, LAST, add, animate, client_of, counts, face, grid, share


def shown(obj: bpy.types.Object) -> np.ndarray:
    """The texels of the file that the image of an object shows."""
    path = bpy.path.abspath(obj.rhytid.image.filepath)
    return OpenEXR.File(path, separate_channels=True).channels()["Y"].pixels


def asked(
    service: str, obj: bpy.types.Object, positions: np.ndarray, udim: int = 1001
) -> np.ndarray:
    """The map of positions, from the service."""
    client, asset = client_of(service), obj.rhytid.asset
    client.put_frame(asset, "test", positions)
    return client.map(asset, "test", udim, method=obj.rhytid.method, sampling="smooth").array


@pytest.fixture
def sent(blender: bpy.types.Scene) -> tuple[bpy.types.Object, np.ndarray, np.ndarray]:
    obj, rest, shape = face()
    obj.rhytid.resolution = "512"
    assert bpy.ops.rhytid.send() == {"FINISHED"}
    return obj, rest, shape


def test_the_mesh_arrives_in_its_order(service: str, sent: tuple) -> None:
    obj, rest, _ = sent
    client = client_of(service)
    assert np.allclose(client.positions(obj.rhytid.asset, "neutral"), rest, atol=1e-6)
    assert client.asset(obj.rhytid.asset).settings["unit"] == "cm"


@pytest.mark.parametrize("method", ["redraw", "binned"])
def test_maps_follow_the_frame(service: str, sent: tuple, method: str) -> None:
    obj, rest, shape = sent
    obj.rhytid.method = method
    maps = []
    for frame in (LAST, 4, FIRST):
        bpy.context.scene.frame_set(frame)
        maps.append(shown(obj))
        positions = (rest + share(frame) * (shape - rest)).astype(np.float32)
        expected = asked(service, obj, positions)
        assert np.abs(maps[-1] - expected).max() <= 1e-4 * np.abs(expected).max()
    assert np.abs(maps[0] - maps[2]).max() > 0.01 * np.abs(maps[0]).max()


def test_twenty_frames_leave_nothing_behind(sent: tuple) -> None:
    obj, _, _ = sent
    scene = bpy.context.scene
    scene.frame_set(LAST)
    before, image, paths = counts(), obj.rhytid.image, set()
    for step in range(20):
        scene.frame_set(FIRST + step % 10)
        paths.add(image.filepath)
    assert counts() == before
    assert obj.rhytid.image == image
    assert len(paths) == 20
    assert len(list(Path(image.filepath).parent.glob("Face.*"))) <= 3


def test_the_same_shape_is_drawn_once(sent: tuple) -> None:
    obj, _, _ = sent
    bpy.context.scene.frame_set(LAST)
    path = obj.rhytid.image.filepath
    bpy.context.scene.frame_set(LAST + 5)
    assert obj.rhytid.image.filepath == path


def test_no_frame_stays_on_the_server(service: str, sent: tuple) -> None:
    bpy.context.scene.frame_set(LAST)
    names = [frame.name for frame in client_of(service).frames(sent[0].rhytid.asset)]
    assert [name for name in names if name.startswith("host-")] == []


def test_an_armature_moves_the_map(service: str, blender: bpy.types.Scene) -> None:
    rest, faces, uv = grid(24, 12.0)
    obj = add("Arm", rest, faces, uv)
    obj.vertex_groups.new(name="bone").add(np.flatnonzero(rest[:, 0] > 6.0).tolist(), 1.0, "ADD")
    rig = bpy.data.objects.new("Rig", bpy.data.armatures.new("Rig"))
    blender.collection.objects.link(rig)
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    bone = rig.data.edit_bones.new("bone")
    bone.head, bone.tail = (0, 0, 0), (1, 0, 0)
    bpy.ops.object.mode_set(mode="OBJECT")
    obj.modifiers.new("Armature", "ARMATURE").object = rig
    bpy.context.view_layer.objects.active = obj
    obj.rhytid.resolution = "512"
    bpy.ops.rhytid.send()
    for frame, x in ((1, 1.0), (5, 1.1)):
        rig.pose.bones["bone"].scale = (1.0, x, 1.0)
        rig.pose.bones["bone"].keyframe_insert("scale", frame=frame)
    blender.frame_set(5)

    moved = rest * np.where(rest[:, :1] > 6.0, (1.1, 1.0, 1.0), 1.0)
    assert np.abs(shown(obj) - asked(service, obj, moved)).max() <= 1e-4 * np.abs(shown(obj)).max()


def test_tiles_of_several_udims(service: str, blender: bpy.types.Scene) -> None:
    rest, faces, uv = grid(32, 6.0, udims=2)
    obj = add("Two", rest, faces, uv)
    animate(obj, "wide", rest * (1.2, 0.9, 1.0))
    obj.rhytid.resolution = "512"
    bpy.ops.rhytid.send()
    blender.frame_set(LAST)

    image = obj.rhytid.image
    assert image.source == "TILED"
    assert [tile.number for tile in image.tiles] == [1001, 1002]
    for udim in (1001, 1002):
        path = image.filepath.replace("<UDIM>", str(udim))
        found = OpenEXR.File(path, separate_channels=True).channels()["Y"].pixels
        expected = asked(service, obj, rest * (1.2, 0.9, 1.0), udim)
        assert np.abs(found - expected).max() <= 1e-4 * np.abs(expected).max()
