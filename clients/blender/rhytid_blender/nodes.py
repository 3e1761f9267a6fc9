"""The nodes that displace a material, set up so that nobody need know how."""

from __future__ import annotations

from typing import Any

import bpy

from rhytid_client.hosts import Trouble

from .properties import HEIGHT, SHINE, ours, scale, trees
from .typed import mesh_of, tree_of
from .words import shared

# By these names they are found again.
UV, TEXTURE, GREEN, SUM = "rhytid uv", "rhytid map", "rhytid green", "rhytid sum"


def set_up(obj: bpy.types.Object) -> list[str]:
    """Give every material of the object our displacement; returns what was done.

    A displacement that a material has is kept, and ours added to it. Raises Trouble for a material
    that shows the wrinkles of another object.
    """
    check(obj, ours(obj).image)
    done = []
    if not any(slot.material for slot in obj.material_slots):
        mesh_of(obj).materials.append(bpy.data.materials.new("Skin"))
        done.append("a material 'Skin'")
    for material in _materials(obj):
        _displace(material, obj)
        done.append(f"displacement of '{material.name}': Non-Color, linear, midlevel 0, both")
    scale(obj)
    return done


def check(obj: bpy.types.Object, image: bpy.types.Image | None) -> None:
    """Raise Trouble for a material that shows the wrinkles of another object.

    image: what the object is to show, None for one that is yet to be made.
    """
    for material in _materials(obj):
        texture = material.node_tree and material.node_tree.nodes.get(TEXTURE)
        if texture and texture.image != image and _of_another(material, texture.image, obj):
            raise Trouble(shared(material.name))


def _materials(obj: bpy.types.Object) -> set[bpy.types.Material]:
    return {slot.material for slot in obj.material_slots if slot.material}


def play(obj: bpy.types.Object, count: int, start: int, first: int) -> None:
    """Let the image play `count` files from the one numbered `first`, at the frame `start`.

    Blender shows the file of number frame - frame_start + 1 + frame_offset.
    """
    for tree in trees(obj):
        for name in (TEXTURE, SHINE):
            if name in tree.nodes:
                user = tree.nodes[name].image_user
                user.frame_duration, user.frame_start = count, start
                user.frame_offset = first - 1
                user.use_cyclic, user.use_auto_refresh = False, True


def _displace(material: bpy.types.Material, obj: bpy.types.Object) -> None:
    tree = tree_of(material)
    output = _output(tree)
    uv = node_of(tree, UV, "ShaderNodeUVMap", output, -950)
    texture = node_of(tree, TEXTURE, "ShaderNodeTexImage", output, -750)
    green = node_of(tree, GREEN, "ShaderNodeSeparateColor", output, -450)
    height = node_of(tree, HEIGHT, "ShaderNodeDisplacement", output, -300)
    uv.uv_map = ours(obj).uv_map
    texture.image = ours(obj).image
    # Cubic of Cycles is a B-spline: it flattens what is a few texels wide.
    texture.interpolation, texture.extension = "Linear", "EXTEND"
    height.space, height.inputs["Midlevel"].default_value = "OBJECT", 0.0
    tree.links.new(uv.outputs["UV"], texture.inputs["Vector"])
    # A map is grey. Where its file is missing Blender shows magenta, whose green is 0: smooth skin.
    tree.links.new(texture.outputs["Color"], green.inputs["Color"])
    tree.links.new(green.outputs["Green"], height.inputs["Height"])
    _connect(tree, height, output)
    material.displacement_method = "BOTH"


def _of_another(material: bpy.types.Material, image: Any, obj: bpy.types.Object) -> bool:
    """Whether the image that the material shows is the map of another object that has it."""
    if image is None:
        return False
    others = [o for o in bpy.data.objects if o != obj and ours(o).image == image]
    return any(slot.material == material for other in others for slot in other.material_slots)


def _connect(tree: Any, height: Any, output: Any) -> None:
    """Lead our height to the output, over a sum where another displacement is there."""
    target = output.inputs["Displacement"]
    present = target.links[0].from_socket if target.is_linked else None
    if present is None or present.node == height:
        tree.links.new(height.outputs["Displacement"], target)
        return
    both = node_of(tree, SUM, "ShaderNodeVectorMath", output, -150)
    if present.node != both:
        both.operation = "ADD"
        tree.links.new(present, both.inputs[0])
        tree.links.new(both.outputs["Vector"], target)
    tree.links.new(height.outputs["Displacement"], both.inputs[1])


def _output(tree: Any) -> Any:
    found = tree.get_output_node("CYCLES")
    return found if found is not None else tree.nodes.new("ShaderNodeOutputMaterial")


def node_of(tree: Any, name: str, kind: str, beside: Any, x: float) -> Any:
    """The node of a name, made where it is not there, left of another one."""
    node = tree.nodes.get(name)
    if node is None:
        node = tree.nodes.new(kind)
        node.name = node.label = name
        node.location = (beside.location.x + x, beside.location.y - 250)
    return node
