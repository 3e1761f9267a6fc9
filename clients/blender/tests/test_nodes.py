"""The nodes of a material, set up again after they were changed."""

from __future__ import annotations

from typing import Any

import bpy
from scenes import add, grid


def test_a_link_into_the_sum_is_mended(blender: bpy.types.Scene) -> None:
    """Beside a displacement that the material had before."""
    obj = add("Sheet", *grid(4, 12.0))
    obj.rhytid.image = bpy.data.images.new("map", 4, 4)
    obj.data.materials.append(bpy.data.materials.new("Skin"))
    obj.active_material.use_nodes = True
    tree = obj.active_material.node_tree
    nodes, links = tree.nodes, tree.links
    theirs = nodes.new("ShaderNodeDisplacement")
    links.new(theirs.outputs[0], tree.get_output_node("CYCLES").inputs["Displacement"])
    for _ in range(2):
        assert bpy.ops.rhytid.set_up() == {"FINISHED"}
        assert sources(nodes["rhytid sum"]) == [theirs, nodes["rhytid height"]]
        links.remove(nodes["rhytid sum"].inputs[1].links[0])


def sources(node: Any) -> list[Any]:
    """The nodes whose outputs go into the two inputs of a sum."""
    return [socket.links[0].from_node for socket in node.inputs[:2] if socket.is_linked]
