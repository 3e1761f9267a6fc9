"""The nodes that make a material shine by a map of `baking`: its Principled BSDF, and a second lobe
beside it where it may have one. What a material had comes back when they are taken out.

A map has √(ρ₁ ρ₂) in red, and in green and blue, as 2 value - 1, the anisotropy times cosine and
sine of twice the angle of the axis: as such it is filtered without the jump that an angle has. Two
lobes are those of "docs/shine.md": GGX and Beckmann's with alpha'² = (3 alpha² - alpha_0²) / 2.
"""

from __future__ import annotations

from math import pi
from typing import Any

import bpy

from rhytid_client.hosts import Trouble

from .nodes import UV, node_of
from .properties import SHINE, ours, trees

# What of the shader is replaced; the last one where there are two lobes.
_REPLACED = ("Roughness", "Anisotropic", "Anisotropic Rotation", "Tangent", "Specular IOR Level")
# What the inputs of our group that hold what was linked to these are called.
_BEFORE = "{} before"
# Of what groups have in them: others are of another version.
_VERSION = 1
# A map has no longer axis than 1; magenta, shown where an image is missing, has one of 1.4.
_MISSING = 1.2
# The least alpha² and the largest part of a reflection that is divided by.
_LEAST, _MOST = 1e-8, 0.98


def connect(obj: bpy.types.Object, image: bpy.types.Image) -> None:
    """Have each Principled BSDF of the object shine by an image, which `base` of the object is of;
    what was so before is taken out. Raises Trouble where there is none."""
    _take_out(obj, (SHINE,))
    shaders = [
        (tree, node) for tree in trees(obj) for node in tree.nodes if node.type == "BSDF_PRINCIPLED"
    ]
    if not shaders:
        raise Trouble(f"No material of '{obj.name}' has a Principled BSDF: shine is not connected")
    for tree, shader in shaders:
        _connect(tree, shader, image, obj)
    _purge()


def disconnect(obj: bpy.types.Object) -> None:
    """Take out what `connect` made: inputs have the links and values that they had before."""
    _take_out(obj)
    _purge()


def _take_out(obj: bpy.types.Object, kept: tuple[str, ...] = ()) -> None:
    """kept: names of nodes that stay, as they are set."""
    for tree in trees(obj):
        own = [n for n in tree.nodes if n.name.startswith(SHINE) and n.name not in kept]
        for node in own:
            if node.type == "GROUP":
                _give_back(tree, node)
            elif node.type == "ADD_SHADER":
                _close(tree, node)
        for node in own:
            tree.nodes.remove(node)


def _purge() -> None:
    """Remove our groups that no material has."""
    for group in [group for group in bpy.data.node_groups if _version(group) and not group.users]:
        bpy.data.node_groups.remove(group)


def connected(obj: bpy.types.Object, image: bpy.types.Image | None) -> bool:
    """Whether a material of the object shines by the image."""
    nodes = [tree.nodes.get(SHINE) for tree in trees(obj)]
    return any(node is not None and node.image == image for node in nodes)


def set_base(obj: bpy.types.Object, roughness: float) -> None:
    """Keep the roughness of skin without relief that the map of the object was made with."""
    ours(obj).base = roughness
    for tree in trees(obj):
        for node in tree.nodes:
            if node.type == "GROUP" and node.name.startswith(SHINE):
                socket = node.inputs["Base Roughness"]
                if socket.default_value != roughness:
                    socket.default_value = roughness


def _connect(tree: Any, shader: Any, image: bpy.types.Image, obj: bpy.types.Object) -> None:
    uv = node_of(tree, UV, "ShaderNodeUVMap", shader, -950)
    texture = node_of(tree, SHINE, "ShaderNodeTexImage", shader, -750)
    tangent = node_of(tree, f"{SHINE} tangent", "ShaderNodeTangent", shader, -450)
    texture.image, texture.interpolation, texture.extension = image, "Linear", "EXTEND"
    uv.uv_map = tangent.uv_map = ours(obj).uv_map
    tangent.direction_type = "UV_MAP"
    two = ours(obj).lobes and _may_have_two(shader)
    node = _new(tree, "ShaderNodeGroup", "formulas", shader, -250)
    node.node_tree = _group(two)
    node.inputs["Base Roughness"].default_value = ours(obj).base or ours(obj).roughness
    tree.links.new(uv.outputs["UV"], texture.inputs["Vector"])
    tree.links.new(texture.outputs["Color"], node.inputs["Color"])
    for name in _REPLACED[: 5 if two else 4]:
        _take(tree, shader.inputs[name], node.inputs.get(_BEFORE.format(name)) or node.inputs[name])
        of = tangent.outputs["Tangent"] if name == "Tangent" else node.outputs[name]
        tree.links.new(of, shader.inputs[name])
    if two:
        _take(tree, shader.inputs["IOR"], node.inputs["IOR"])
        _lobe(tree, shader, node, tangent)


def _may_have_two(shader: Any) -> bool:
    """Metal and glass have lobes that `Specular IOR Level` says nothing of."""
    inputs = [shader.inputs[name] for name in ("Metallic", "Transmission Weight")]
    plain = not any(socket.is_linked or socket.default_value for socket in inputs)
    return plain and shader.outputs["BSDF"].is_linked


def _take(tree: Any, source: Any, target: Any) -> None:
    """Give an input what another one has: its link, else its value."""
    if source.is_linked:
        tree.links.new(source.links[0].from_socket, target)
    elif not (source.hide_value or target.hide_value):
        target.default_value = source.default_value


def _give_back(tree: Any, node: Any) -> None:
    """Give shaders of a group node the links and values that they had; what was linked or set in
    place of ours since then stays."""
    links = [link for socket in node.outputs for link in socket.links]
    shaders = {at.to_node.name: at.to_node for at in links if at.to_node.type == "BSDF_PRINCIPLED"}
    for shader in shaders.values():
        for name in _REPLACED:
            held = node.inputs.get(_BEFORE.format(name)) or node.inputs.get(name)
            target = shader.inputs[name]
            if held is not None and _is_ours(target):
                tree.links.remove(target.links[0])
                _take(tree, held, target)


def _is_ours(socket: Any) -> bool:
    return bool(socket.is_linked and socket.links[0].from_node.name.startswith(SHINE))


def _lobe(tree: Any, shader: Any, node: Any, tangent: Any) -> None:
    """Beckmann's lobe beside the shader: what the whole reflects, less what the shader has left."""
    add = _new(tree, "ShaderNodeAddShader", "sum", shader, 300)
    for link in list(shader.outputs["BSDF"].links):
        tree.links.new(add.outputs[0], link.to_socket)
    lobe = _new(tree, "ShaderNodeBsdfAnisotropic", "lobe", shader, 50)
    lobe.distribution = "BECKMANN"
    all_of = _new(tree, "ShaderNodeFresnel", "whole", shader, -450)
    own = _new(tree, "ShaderNodeFresnel", "own", shader, -450)
    less = _new(tree, "ShaderNodeMath", "rest", shader, -250)
    tint = _new(tree, "ShaderNodeVectorMath", "tint", shader, -100)
    less.operation, tint.operation = "SUBTRACT", "MULTIPLY"
    colour = shader.inputs["Specular Tint"]
    if colour.is_linked:
        tree.links.new(colour.links[0].from_socket, tint.inputs[1])
    else:
        tint.inputs[1].default_value = colour.default_value[:3]
    pairs = [
        (node.outputs["IOR"], all_of.inputs["IOR"]),
        (node.outputs["Own IOR"], own.inputs["IOR"]),
        (all_of.outputs[0], less.inputs[0]),
        (own.outputs[0], less.inputs[1]),
        (less.outputs[0], tint.inputs[0]),
        (tint.outputs[0], lobe.inputs["Color"]),
        (node.outputs["Roughness"], lobe.inputs["Roughness"]),
        (node.outputs["Lobe Anisotropy"], lobe.inputs["Anisotropy"]),
        (node.outputs["Anisotropic Rotation"], lobe.inputs["Rotation"]),
        (tangent.outputs["Tangent"], lobe.inputs["Tangent"]),
        (shader.outputs["BSDF"], add.inputs[0]),
        (lobe.outputs[0], add.inputs[1]),
    ]
    if shader.inputs["Normal"].is_linked:
        normal = shader.inputs["Normal"].links[0].from_socket
        pairs += [(normal, at.inputs["Normal"]) for at in (lobe, all_of, own)]
    for one, other in pairs:
        tree.links.new(one, other)


def _close(tree: Any, add: Any) -> None:
    """Lead what goes into our sum past it."""
    for link in list(add.outputs[0].links):
        if add.inputs[0].is_linked:
            tree.links.new(add.inputs[0].links[0].from_socket, link.to_socket)


def _new(tree: Any, kind: str, what: str, beside: Any, x: float) -> Any:
    """A node of ours, of one shader: there may be several of a name, which Blender numbers."""
    node = tree.nodes.new(kind)
    node.name = node.label = f"{SHINE} {what}"
    node.location = (beside.location.x + x, beside.location.y - 450)
    return node


def _version(group: Any) -> int:
    return int(group.get(SHINE, 0))


def _group(two: bool) -> Any:
    """The formulas, of one lobe or two; one datablock for all materials."""
    version = 2 * _VERSION + two
    for group in bpy.data.node_groups:
        if _version(group) == version and group.library is None:
            return group
    name = f"Rhytid Shine{', Two Lobes' if two else ''}"
    # The stubs know no kinds of trees.
    group = bpy.data.node_groups.new(name, "ShaderNodeTree")  # type: ignore[arg-type]
    group[SHINE] = version
    _Formulas(group, two).write()
    return group


class _Formulas:
    """The nodes of a group: a map becomes what the shader takes."""

    def __init__(self, group: Any, two: bool) -> None:
        self._group, self._two = group, two
        self._nodes, self._links = group.nodes, group.links

    def write(self) -> None:
        """Make the sockets and the nodes."""
        self._sockets()
        given, out = self._nodes.new("NodeGroupInput"), self._nodes.new("NodeGroupOutput")
        out.location.x = 200
        found = self._one(given.outputs)
        if self._two:
            found |= self._lobes(given.outputs, found)
        for name, socket in found.items():
            self._links.new(socket, out.inputs[name])

    def _sockets(self) -> None:
        values = ["Roughness", "Anisotropic", "Anisotropic Rotation"]
        self._socket("Color", "INPUT", "NodeSocketColor", True)
        self._socket("Base Roughness", "INPUT", "NodeSocketFloat", False)
        for name in values:
            self._socket(_BEFORE.format(name), "INPUT", "NodeSocketFloat", True)
        self._socket(_BEFORE.format("Tangent"), "INPUT", "NodeSocketVector", True)
        for name in ("Specular IOR Level", "IOR") if self._two else ():
            self._socket(name, "INPUT", "NodeSocketFloat", False)
        more = ["Specular IOR Level", "IOR", "Own IOR", "Lobe Anisotropy"] if self._two else []
        for name in values + more:
            self._socket(name, "OUTPUT", "NodeSocketFloat", False)

    def _socket(self, name: str, way: str, kind: str, hidden: bool) -> None:
        socket = self._group.interface.new_socket(name, in_out=way, socket_type=kind)
        socket.hide_value = hidden

    def _one(self, given: Any) -> dict[str, Any]:
        """What one lobe takes. A missing map is skin without relief."""
        red = self._node("ShaderNodeSeparateColor", given["Color"]).outputs["Red"]
        axis = self._node("ShaderNodeVectorMath", given["Color"], (0, 2, 2), (0, -1, -1))
        axis.operation = "MULTIPLY_ADD"
        length = self._node("ShaderNodeVectorMath", axis.outputs["Vector"])
        length.operation = "LENGTH"
        parts = self._node("ShaderNodeSeparateXYZ", axis.outputs["Vector"]).outputs
        there = self._math("LESS_THAN", length.outputs["Value"], _MISSING)
        base = given["Base Roughness"]
        more = self._math("SUBTRACT", red, base)
        angle = self._math("ARCTAN2", parts["Z"], parts["Y"])
        return {
            "Roughness": self._math("MULTIPLY_ADD", there, more, base),
            "Anisotropic": self._math("MULTIPLY", there, length.outputs["Value"]),
            "Anisotropic Rotation": self._math("MULTIPLY", angle, 0.25 / pi),
        }

    def _lobes(self, given: Any, one: dict[str, Any]) -> dict[str, Any]:
        """What two lobes take in place of it: w = alpha_0² / (alpha'₁ alpha'₂) is the share of GGX.
        Reflections are of IOR (1 + g) / (1 - g) at g², the part of light that is reflected."""
        base = self._math("POWER", given["Base Roughness"], 4.0)
        both = self._math("POWER", one["Roughness"], 4.0)
        ratio = self._math("MULTIPLY_ADD", one["Anisotropic"], -0.9, 1.0)
        along = self._wider(self._math("DIVIDE", both, ratio), base)
        across = self._wider(self._math("MULTIPLY", both, ratio), base)
        product = self._math("SQRT", self._math("MULTIPLY", along, across))
        share = self._math("DIVIDE", base, product)
        ratio = self._math("SQRT", self._math("DIVIDE", across, along))
        lean = self._math("DIVIDE", self._math("SUBTRACT", 1.0, ratio), 0.9)
        level = given["Specular IOR Level"]
        off = self._math("SUBTRACT", given["IOR"], 1.0)
        g = self._math("DIVIDE", off, self._math("ADD", given["IOR"], 1.0))
        g = self._math("MULTIPLY", g, self._math("SQRT", self._math("MULTIPLY", level, 2.0)))
        return {
            "Roughness": self._math("POWER", product, 0.25),
            "Anisotropic": self._math("MINIMUM", lean, 1.0),
            "Specular IOR Level": self._math("MULTIPLY", level, share),
            "IOR": self._ior(g),
            "Own IOR": self._ior(self._math("MULTIPLY", g, self._math("SQRT", share))),
            "Lobe Anisotropy": self._math("SUBTRACT", self._math("SQRT", ratio), 1.0),
        }

    def _wider(self, squared: Any, base: Any) -> Any:
        """alpha'² of alpha²: 3 variances in place of 2, and none that is below none."""
        wide = self._math("MULTIPLY_ADD", squared, 1.5, self._math("MULTIPLY", base, -0.5))
        least = self._math("MAXIMUM", base, _LEAST)
        return self._math("MINIMUM", self._math("MAXIMUM", wide, least), 1.0)

    def _ior(self, g: Any) -> Any:
        g = self._math("MINIMUM", g, _MOST)
        return self._math("DIVIDE", self._math("ADD", 1.0, g), self._math("SUBTRACT", 1.0, g))

    def _math(self, operation: str, *values: Any) -> Any:
        node = self._node("ShaderNodeMath", *values)
        node.operation = operation
        return node.outputs[0]

    def _node(self, kind: str, *values: Any) -> Any:
        node = self._nodes.new(kind)
        for socket, value in zip(node.inputs, values, strict=False):
            if isinstance(value, bpy.types.NodeSocket):
                self._links.new(value, socket)
            else:
                socket.default_value = value
        return node
