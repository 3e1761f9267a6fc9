"""A displacement that the material has already is sent, and moves."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import OpenEXR
import pytest
from PIL import Image
from scenes import FIRST, LAST, add, animate, client_of, grid

SIDE, SCALE, MIDLEVEL = 256, 0.4, 0.5
Codes = np.ndarray


def relief(seed: int) -> Codes:
    """(SIDE, SIDE) codes of 16 bits: furrows of some directions and a swell."""
    rng = np.random.default_rng(seed)
    row, column = np.mgrid[:SIDE, :SIDE].astype(float)
    heights = 0.02 * np.sin(column / 25.0)
    for _ in range(40):
        x, y, angle = *rng.uniform(30, SIDE - 30, 2), rng.uniform(0, np.pi)
        along = (column - x) * np.cos(angle) + (row - y) * np.sin(angle)
        across = (row - y) * np.cos(angle) - (column - x) * np.sin(angle)
        heights -= 0.06 * np.exp(-((across / 2.0) ** 2) - (along / 14.0) ** 4)
    return np.rint(65535 * (heights / SCALE + MIDLEVEL)).astype(np.uint16)


def heights(codes: Codes) -> np.ndarray:
    return (codes / 65535.0 - MIDLEVEL) * SCALE


@pytest.fixture
def sheet(blender: bpy.types.Scene) -> bpy.types.Object:
    """With a material of its own; it is pressed together at LAST."""
    return sheet_of(1)


def sheet_of(udims: int) -> bpy.types.Object:
    rest, faces, uv = grid(32, 12.0, udims)
    obj = add("Sheet", rest, faces, uv)
    animate(obj, "pressed", rest * (0.8, 1.1, 1.0))
    obj.rhytid.resolution = str(SIDE)
    obj.data.materials.append(bpy.data.materials.new("Scanned"))
    obj.active_material.use_nodes = True
    return obj


def displaced(obj: bpy.types.Object, image: bpy.types.Image, between: str = "") -> Any:
    """The Displacement node, with an image before it."""
    image.colorspace_settings.name = "Non-Color"
    tree = obj.active_material.node_tree
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image, last = image, texture.outputs["Color"]
    if between:
        node = tree.nodes.new(between)
        tree.links.new(last, node.inputs[0])
        last = node.outputs[0]
    node = tree.nodes.new("ShaderNodeDisplacement")
    node.inputs["Scale"].default_value, node.inputs["Midlevel"].default_value = SCALE, MIDLEVEL
    tree.links.new(last, node.inputs["Height"])
    output = tree.get_output_node("CYCLES")
    tree.links.new(node.outputs["Displacement"], output.inputs["Displacement"])
    return node


def png(path: Path, seed: int = 3) -> bpy.types.Image:
    Image.fromarray(relief(seed)).save(path)
    return bpy.data.images.load(str(path))


def shown(obj: bpy.types.Object, udim: int = 1001) -> np.ndarray:
    path = bpy.path.abspath(obj.rhytid.image.filepath).replace("<UDIM>", str(udim))
    found = OpenEXR.File(path, separate_channels=True).channels()["Y"].pixels
    return np.asarray(found)


def test_one_click_makes_it_move(sheet: bpy.types.Object, tmp_path: Path, service: str) -> None:
    node = displaced(sheet, png(tmp_path / "head.png"), "ShaderNodeRGBToBW")
    assert bpy.ops.rhytid.move() == {"FINISHED"}
    wanted = heights(relief(3))
    assert np.abs(shown(sheet) - wanted).max() <= 0.51 * SCALE / 65535
    tree = sheet.active_material.node_tree
    source = tree.get_output_node("CYCLES").inputs["Displacement"].links[0].from_node
    assert source.name == "rhytid height"
    assert not node.outputs["Displacement"].is_linked
    assert client_of(service).asset(sheet.rhytid.asset).wrinkles > 20

    bpy.context.scene.frame_set(LAST)
    assert np.abs(shown(sheet) - wanted).max() > 0.005
    bpy.context.scene.frame_set(FIRST)
    first = sheet.rhytid.asset
    assert bpy.ops.rhytid.move() == {"FINISHED"}
    assert sheet.rhytid.asset == first
    assert np.abs(shown(sheet) - wanted).max() <= 0.51 * SCALE / 65535


def test_tiles_in_world_space_and_packed(blender: bpy.types.Scene, tmp_path: Path) -> None:
    for udim in (1001, 1002):
        Image.fromarray(relief(udim)).save(tmp_path / f"head.{udim}.png")
    obj = sheet_of(2)
    obj.scale = (2.0, 2.0, 2.0)
    bpy.context.view_layer.update()
    image = bpy.data.images.load(str(tmp_path / "head.1001.png"))
    image.source, image.filepath = "TILED", str(tmp_path / "head.<UDIM>.png")
    image.tiles.new(1002)
    node = displaced(obj, image)
    node.space = "WORLD"
    image.pack()
    for udim in (1001, 1002):
        (tmp_path / f"head.{udim}.png").unlink()
    assert bpy.ops.rhytid.move() == {"FINISHED"}
    for udim in (1001, 1002):
        wanted = heights(relief(udim)) / 2.0
        assert np.abs(shown(obj, udim) - wanted).max() <= 0.26 * SCALE / 65535, udim


def nothing(obj: bpy.types.Object, folder: Path) -> None:
    pass


def generated(obj: bpy.types.Object, folder: Path) -> None:
    displaced(obj, bpy.data.images.new("drawn", 4, 4))


def curved(obj: bpy.types.Object, folder: Path) -> None:
    image = png(folder / "a.png")
    displaced(obj, image)
    image.colorspace_settings.name = "sRGB"


def between(obj: bpy.types.Object, folder: Path) -> None:
    displaced(obj, png(folder / "a.png"), "ShaderNodeMath")


def linked_scale(obj: bpy.types.Object, folder: Path) -> None:
    node, tree = displaced(obj, png(folder / "a.png")), obj.active_material.node_tree
    tree.links.new(tree.nodes.new("ShaderNodeTexNoise").outputs[0], node.inputs["Scale"])


def gone(obj: bpy.types.Object, folder: Path) -> None:
    displaced(obj, png(folder / "a.png"))
    (folder / "a.png").unlink()


def vectors(obj: bpy.types.Object, folder: Path) -> None:
    tree = obj.active_material.node_tree
    node, output = tree.nodes.new("ShaderNodeVectorDisplacement"), tree.get_output_node("CYCLES")
    tree.links.new(node.outputs[0], output.inputs["Displacement"])


WRONG = [
    (nothing, "No material of 'Sheet' displaces by an image: link an Image Texture"),
    (generated, "'drawn' (is no image file: save it|has changes that are not saved)"),
    (curved, "colour space sRGB, which bends its heights: set it to Non-Color"),
    (between, "'Math' stands between image and displacement"),
    (linked_scale, "Scale of the Displacement node is linked to 'Noise Texture'"),
    (gone, r"'a\.png' has no file for UDIM 1001"),
    (vectors, "Vector displacement moves skin sideways"),
]


@pytest.mark.parametrize(("make", "told"), WRONG, ids=lambda one: getattr(one, "__name__", ""))
def test_what_cannot_be_read_is_named(
    sheet: bpy.types.Object, tmp_path: Path, make: Any, told: str
) -> None:
    make(sheet, tmp_path)
    with pytest.raises(RuntimeError, match=told):
        bpy.ops.rhytid.move()
    assert sheet.rhytid.asset == ""
