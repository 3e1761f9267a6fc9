"""Shine, where it is asked for: files beside the maps, connected to the Principled BSDF."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
from scenes import add, animate, client_of, grid

LAST = 2


@pytest.fixture
def sheet(blender: bpy.types.Scene, tmp_path: Path) -> bpy.types.Object:
    rest, faces, uv = grid(16, 12.0)
    obj = add("Sheet", rest, faces, uv)
    animate(obj, "wide", rest * (1.2, 0.9, 1.0))
    obj.rhytid.resolution, obj.rhytid.unit = "256", "cm"
    obj.rhytid.folder = str(tmp_path / "maps")
    bpy.context.scene.frame_end = LAST
    obj.data.materials.append(bpy.data.materials.new("Skin"))
    obj.active_material.use_nodes = True
    bpy.ops.rhytid.send()
    return obj


def test_nothing_is_connected_unless_asked(sheet: bpy.types.Object, tmp_path: Path) -> None:
    assert bpy.ops.rhytid.bake() == {"FINISHED"}
    assert len(list((tmp_path / "maps").iterdir())) == LAST
    shader = sheet.active_material.node_tree.nodes["Principled BSDF"]
    assert not any(socket.is_linked for socket in shader.inputs)


def test_shine_is_baked_and_connected(
    service: str, sheet: bpy.types.Object, tmp_path: Path
) -> None:
    sheet.rhytid.shine, sheet.rhytid.roughness = True, 0.3
    for _ in range(2):  # once more changes nothing
        assert bpy.ops.rhytid.bake() == {"FINISHED"}
    tree = sheet.active_material.node_tree
    shader, texture = tree.nodes["Principled BSDF"], tree.nodes["rhytid shine"]
    names = ("Roughness", "Anisotropic", "Anisotropic Rotation", "Tangent")
    assert all(shader.inputs[name].is_linked for name in names)
    assert texture.image.colorspace_settings.name == "Non-Color"
    assert (texture.image.source, texture.image_user.frame_duration) == ("SEQUENCE", LAST)
    assert sum(node.type == "TEX_IMAGE" for node in tree.nodes) == 2

    client, rest = client_of(service), grid(16, 12.0)[0]
    client.put_frame(sheet.rhytid.asset, "test", rest)
    moments = (
        client.map(sheet.rhytid.asset, "test", 1001, level=2, layer="slopes", sampling="smooth")
        .array[20, 30]
        .astype(float)
    )
    covariance = moments[[2, 3, 3, 4]].reshape(2, 2) - np.outer(moments[:2], moments[:2])
    variance, axes = np.linalg.eigh(covariance)
    along, across = np.sqrt(0.3**4 + 2.0 * variance[::-1])
    red, green, blue = pixels(tmp_path / "maps" / "Sheet.shine.1001.0001.png")[20, 30]
    assert red == pytest.approx((along * across) ** 0.25, abs=1e-4)
    assert np.hypot(green, blue) == pytest.approx((1.0 - across / along) / 0.9, abs=1e-3)
    axis = np.exp(0.5j * np.angle(green + 1j * blue))
    assert abs(axis.real * axes[0, 1] + axis.imag * axes[1, 1]) == pytest.approx(1.0, abs=1e-3)


def test_shine_goes_with_the_sequence_that_it_is_of(
    sheet: bpy.types.Object, tmp_path: Path
) -> None:
    sheet.rhytid.shine = True
    bpy.ops.rhytid.bake()
    tree, other = sheet.active_material.node_tree, tmp_path / "other"
    other.mkdir()
    for file in (tmp_path / "maps").glob("*.exr"):
        (other / file.name).write_bytes(file.read_bytes())
    roughness = tree.nodes["Principled BSDF"].inputs["Roughness"]
    for folder, linked in ((other, False), (tmp_path / "maps", True)):
        assert bpy.ops.rhytid.open(directory=str(folder)) == {"FINISHED"}
        assert roughness.is_linked == linked
    sheet.rhytid.shine = False
    bpy.ops.rhytid.bake()
    assert not roughness.is_linked


def test_shine_of_several_udims_goes_by_the_frame(blender: bpy.types.Scene, tmp_path: Path) -> None:
    rest, faces, uv = grid(16, 12.0, udims=2)
    obj = add("Two", rest, faces, uv)
    animate(obj, "wide", rest * (1.2, 0.9, 1.0))
    obj.rhytid.resolution, obj.rhytid.unit, obj.rhytid.shine = "256", "cm", True
    obj.rhytid.folder = str(tmp_path / "maps")
    blender.frame_end = LAST
    obj.data.materials.append(bpy.data.materials.new("Skin"))
    obj.active_material.use_nodes = True
    bpy.ops.rhytid.send()
    assert bpy.ops.rhytid.bake() == {"FINISHED"}
    image = obj.active_material.node_tree.nodes["rhytid shine"].image
    assert image.source == "TILED"
    assert [tile.number for tile in image.tiles] == [1001, 1002]
    assert image.colorspace_settings.name == "Non-Color"
    for frame in (LAST, 1):
        blender.frame_set(frame)
        for udim in (1001, 1002):
            file = Path(bpy.path.abspath(image.filepath.replace("<UDIM>", str(udim))))
            assert file.name == f"Two.shine.{udim}.{frame:04d}.png"
            assert file.is_file()


def pixels(path: Path) -> np.ndarray:
    """(h, w, 3): red, and 2 value - 1 of green and blue."""
    image = bpy.data.images.load(str(path))
    image.colorspace_settings.name = "Non-Color"
    width, height = image.size
    values = np.array(image.pixels[:]).reshape(height, width, 4)[::-1, :, :3]
    return values * (1, 2, 2) - (0, 1, 1)
