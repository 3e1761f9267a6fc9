"""Nodes of shine: what they compute, and that a material is as it was without them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import OpenEXR
import pytest
from cameras import look_down
from scenes import add, grid

BASE = 0.3
# Roughness along and across of a texel, and the angle of its axis.
ALONG, ACROSS, ANGLE = 0.42, 0.35, np.radians(35.0)
IOR, LEVEL = 1.45, 0.6


@pytest.fixture
def sheet(blender: bpy.types.Scene) -> bpy.types.Object:
    """A sheet with our nodes, and a Principled BSDF that has links and values."""
    obj = add("Sheet", *grid(4, 12.0))
    obj.data.materials.append(bpy.data.materials.new("Skin"))
    obj.active_material.use_nodes = True
    obj.rhytid.image = bpy.data.images.new("map", 4, 4)
    obj.rhytid.uv_map, obj.rhytid.roughness = "map", BASE
    assert bpy.ops.rhytid.set_up() == {"FINISHED"}
    tree = obj.active_material.node_tree
    shader, value = shader_of(obj), tree.nodes.new("ShaderNodeValue")
    mix = tree.nodes.new("ShaderNodeMixShader")
    shader.inputs["IOR"].default_value, shader.inputs["Specular IOR Level"].default_value = (
        IOR,
        LEVEL,
    )
    shader.inputs["Anisotropic"].default_value = 0.2
    tree.links.new(value.outputs[0], shader.inputs["Roughness"])
    output = tree.get_output_node("CYCLES")
    tree.links.new(shader.outputs[0], mix.inputs[1])
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
    return obj


def shader_of(obj: bpy.types.Object) -> Any:
    return obj.active_material.node_tree.nodes["Principled BSDF"]


def image(red: float, green: float, blue: float) -> bpy.types.Image:
    made = bpy.data.images.new("shine", 1, 1, float_buffer=True)
    made.colorspace_settings.name = "Non-Color"
    made.pixels[:] = (red, green, blue, 1.0)
    return made


def map_of(along: float, across: float, angle: float) -> bpy.types.Image:
    """As `baking.shine` has it."""
    strength = (1.0 - (across / along) ** 2) / 0.9
    axis = 0.5 + 0.5 * strength * np.array([np.cos(2 * angle), np.sin(2 * angle)])
    return image(np.sqrt(along * across), *axis)


def shines(obj: bpy.types.Object, shown: bpy.types.Image, lobes: bool = True) -> Any:
    """Connect; the node of the formulas."""
    from bl_ext.user_default.rhytid import shine

    obj.rhytid.shine, obj.rhytid.shine_image, obj.rhytid.lobes = True, shown, lobes
    shine.connect(obj, shown)
    return obj.active_material.node_tree.nodes["rhytid shine formulas"]


def dull(obj: bpy.types.Object) -> None:
    from bl_ext.user_default.rhytid import shine

    shine.disconnect(obj)


def facts(tree: Any) -> tuple[set[Any], ...]:
    """Nodes, links and values of a tree."""
    links = {(at.from_node.name, at.from_socket.name, at.to_node.name, at.to_socket.identifier)
             for at in tree.links}  # fmt: skip
    values = {
        (node.name, socket.identifier, str(np.array(socket.default_value).round(6).tolist()))
        for node in tree.nodes
        for socket in node.inputs
        if hasattr(socket, "default_value") and not socket.is_linked
    }
    return {node.name for node in tree.nodes}, links, values


def differing(some: tuple[set[Any], ...], others: tuple[set[Any], ...]) -> list[Any]:
    return [fact for pair in zip(some, others, strict=True) for fact in pair[0] ^ pair[1]]


def rendered(obj: bpy.types.Object, node: Any, names: list[str], folder: Path) -> list[float]:
    """What Cycles has of outputs of a node, as light."""
    scene, tree = bpy.context.scene, obj.active_material.node_tree
    light, parts = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("Emission", "CombineColor"))
    for name, socket in zip(names, parts.inputs, strict=False):
        tree.links.new(node.outputs[name], socket)
    tree.links.new(parts.outputs[0], light.inputs["Color"])
    surface = tree.get_output_node("CYCLES").inputs["Surface"]
    tree.links.new(light.outputs[0], surface)
    scene.world = bpy.data.worlds.new("world")
    look_down(scene, (6.0, 6.0), 0.1, 3)
    scene.render.filepath = str(folder / "light.exr")
    bpy.ops.render.render(write_still=True)
    parts = OpenEXR.File(scene.render.filepath, separate_channels=True).parts
    seen = {name: part.channels[name].pixels for part in parts for name in part.channels}
    colours = {name[-1]: pixels for name, pixels in seen.items() if "Combined." in name}
    return [float(colours[letter][1, 1]) for letter in "RGB"[: len(names)]]


@pytest.mark.parametrize("lobes", [False, True])
def test_a_material_is_as_it_was_once_shine_is_taken_out(
    sheet: bpy.types.Object, lobes: bool
) -> None:
    tree = sheet.active_material.node_tree
    before, groups = facts(tree), len(bpy.data.node_groups)
    found = map_of(ALONG, ACROSS, ANGLE)
    shines(sheet, found, lobes)
    once = facts(tree)
    assert differing(once, before) != []
    shines(sheet, found, lobes)
    assert differing(facts(tree), once) == []
    sheet.rhytid.lobes = not lobes
    assert differing(facts(tree), once) != []
    sheet.rhytid.lobes = lobes
    assert differing(facts(tree), once) == []
    sheet.rhytid.shine = False
    assert differing(facts(tree), before) == []
    assert len(bpy.data.node_groups) == groups


def test_what_a_material_had_still_counts(sheet: bpy.types.Object) -> None:
    """The sum goes where the shader went, the lobe has its normal, and a level that was changed at
    our node goes back to the shader."""
    tree = sheet.active_material.node_tree
    shader, nodes, normal = shader_of(sheet), tree.nodes, tree.nodes.new("ShaderNodeNormalMap")
    tree.links.new(normal.outputs[0], shader.inputs["Normal"])
    node = shines(sheet, map_of(ALONG, ACROSS, ANGLE))
    add, lobe = nodes["rhytid shine sum"], nodes["rhytid shine lobe"]
    assert [link.to_node.type for link in add.outputs[0].links] == ["MIX_SHADER"]
    assert [at.links[0].from_node for at in add.inputs] == [shader, lobe]
    assert lobe.inputs["Normal"].links[0].from_node == normal
    node.inputs["Specular IOR Level"].default_value = 0.25
    dull(sheet)
    assert shader.inputs["Specular IOR Level"].default_value == 0.25


@pytest.mark.parametrize("lobes", [False, True])
def test_what_was_linked_and_set_since_stays(sheet: bpy.types.Object, lobes: bool) -> None:
    tree, shader = sheet.active_material.node_tree, shader_of(sheet)
    shines(sheet, map_of(ALONG, ACROSS, ANGLE), lobes)
    painted = tree.nodes.new("ShaderNodeValue")
    tree.links.new(painted.outputs[0], shader.inputs["Roughness"])
    tree.links.remove(shader.inputs["Anisotropic"].links[0])
    shader.inputs["Anisotropic"].default_value = 0.7
    before = facts(tree)
    dull(sheet)
    assert shader.inputs["Roughness"].links[0].from_node == painted
    assert not shader.inputs["Anisotropic"].is_linked
    assert shader.inputs["Anisotropic"].default_value == pytest.approx(0.7)
    assert not shader.inputs["Tangent"].is_linked
    assert {name for name in before[0] if not name.startswith("rhytid shine")} == facts(tree)[0]


def test_a_shader_that_was_copied_is_given_back_too(sheet: bpy.types.Object) -> None:
    tree, shader = sheet.active_material.node_tree, shader_of(sheet)
    node = shines(sheet, map_of(ALONG, ACROSS, ANGLE), lobes=False)
    value = node.inputs["Roughness before"].links[0].from_node
    copy = tree.nodes.new("ShaderNodeBsdfPrincipled")
    for name in ("Roughness", "Anisotropic"):
        tree.links.new(node.outputs[name], copy.inputs[name])
    dull(sheet)
    for one in (shader, copy):
        assert one.inputs["Roughness"].links[0].from_node == value
        assert not one.inputs["Anisotropic"].is_linked


@pytest.mark.parametrize("name", ["Metallic", "Transmission Weight"])
def test_metal_and_glass_have_one_lobe(sheet: bpy.types.Object, name: str) -> None:
    shader = shader_of(sheet)
    shader.inputs[name].default_value = 0.5
    shines(sheet, map_of(ALONG, ACROSS, ANGLE))
    assert "rhytid shine lobe" not in sheet.active_material.node_tree.nodes
    assert not shader.inputs["Specular IOR Level"].is_linked
    assert shader.inputs["Roughness"].is_linked


def test_two_lobes_are_those_of_the_recipe(sheet: bpy.types.Object, tmp_path: Path) -> None:
    node = shines(sheet, map_of(ALONG, ACROSS, ANGLE))
    alpha = np.sqrt((3 * np.array([ALONG, ACROSS]) ** 4 - BASE**4) / 2)
    share = BASE**2 * BASE**2 / alpha.prod()
    names = ["Roughness", "Anisotropic", "Anisotropic Rotation"]
    found = rendered(sheet, node, names, tmp_path)
    lean = (1 - alpha[1] / alpha[0]) / 0.9
    assert found == pytest.approx([alpha.prod() ** 0.25, lean, ANGLE / (2 * np.pi)], abs=1e-4)
    found = rendered(sheet, node, ["Specular IOR Level", "IOR", "Own IOR"], tmp_path)
    reflected = ((IOR - 1) / (IOR + 1)) ** 2 * 2 * LEVEL
    assert found[0] == pytest.approx(LEVEL * share, rel=1e-4)
    assert [((n - 1) / (n + 1)) ** 2 for n in found[1:]] == pytest.approx(
        [reflected, share * reflected], rel=1e-3
    )
    # Light that is below 0 is none: the anisotropy of the lobe is.
    lobe = sheet.active_material.node_tree.nodes["rhytid shine lobe"]
    assert lobe.inputs["Anisotropy"].links[0].from_socket == node.outputs["Lobe Anisotropy"]
    ends = node.node_tree.nodes
    turn = ends.new("ShaderNodeMath")
    turn.operation = "ADD"
    out = next(n for n in ends if n.type == "GROUP_OUTPUT").inputs["Lobe Anisotropy"]
    node.node_tree.links.new(out.links[0].from_socket, turn.inputs[0])
    turn.inputs[1].default_value = 1.0
    node.node_tree.links.new(turn.outputs[0], out)
    assert rendered(sheet, node, ["Lobe Anisotropy"], tmp_path) == pytest.approx(
        [np.sqrt(alpha[1] / alpha[0])], rel=1e-4
    )


@pytest.mark.parametrize("lobes", [False, True])
@pytest.mark.parametrize("missing", [False, True])
def test_skin_without_relief_has_its_own_roughness(
    sheet: bpy.types.Object, tmp_path: Path, lobes: bool, missing: bool
) -> None:
    """And so has skin whose map is missing, which Blender shows in magenta."""
    shown = image(1.0, 0.0, 1.0) if missing else map_of(BASE, BASE, 0.0)
    node = shines(sheet, shown, lobes)
    names = ["Roughness", "Anisotropic", "Anisotropic Rotation"]
    found = rendered(sheet, node, names, tmp_path)[:2]
    assert found == pytest.approx([BASE, 0.0], abs=1e-4)


def test_it_can_be_undone(sheet: bpy.types.Object) -> None:
    before, groups = facts(sheet.active_material.node_tree), len(bpy.data.node_groups)
    bpy.ops.ed.undo_push(message="before")
    shines(sheet, map_of(ALONG, ACROSS, ANGLE))
    bpy.ops.ed.undo_push(message="shine")
    assert bpy.ops.ed.undo() == {"FINISHED"}
    assert differing(facts(bpy.data.materials["Skin"].node_tree), before) == []
    assert len(bpy.data.node_groups) == groups
