"""Roughness and anisotropy of a look, as nodes of MaterialX: from the maps `roughness` and
`anisotropy` of `rhytid bake` to three inputs of Standard Surface.

Its anisotropy makes alpha along roughness² / aspect and across roughness² aspect, aspect = (1 -
anisotropy)^½, after MaterialX' node `roughness_anisotropy`; alpha is the square of the roughness in
the maps, red along the axis and green across it. The axis becomes the tangent: an angle would take
a node whose inputs have other names in each version of MaterialX.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

# The name and type of an input, and its value or the node that it is connected to.
Input = tuple[str, str, str]
Map = Literal["roughness", "anisotropy"]


@dataclass(frozen=True)
class Node:
    """A node of MaterialX.

    definition: its id in the library.  category, type: as a document has them.  values: inputs with
    a value.  links: inputs that are another node.  map: the file of an image.
    """

    name: str
    definition: str
    category: str
    type: str
    values: tuple[Input, ...] = ()
    links: tuple[Input, ...] = ()
    map: Map | None = None


def _image(name: str, map: Map) -> Node:
    return Node(name, "ND_image_color3", "image", "color3", map=map)


def _channel(name: str, of: str, index: int) -> Node:
    value = ("index", "integer", str(index))
    link = ("in", "color3", of)
    return Node(name, "ND_extract_color3", "extract", "float", (value,), (link,))


def _float(name: str, category: str, one: str, other: str) -> Node:
    """Of two nodes or values."""
    given = (("in1", "float", one), ("in2", "float", other))
    values = tuple(i for i in given if i[2][0].isdigit())
    links = tuple(i for i in given if not i[2][0].isdigit())
    return Node(name, f"ND_{category}_float", category, "float", values, links)


def _scaled(name: str, vector: str, by: str) -> Node:
    links = (("in1", "vector3", vector), ("in2", "float", by))
    return Node(name, "ND_multiply_vector3FA", "multiply", "vector3", (), links)


# Roughness below this is as smooth as glass.
LEAST = "0.001"
SHINE = (
    _image("Roughness", "roughness"),
    _channel("First", "Roughness", 0),
    _channel("Second", "Roughness", 1),
    # Of a base roughness of 0 both may be 0, whose ratio is no number.
    _float("Along", "max", "First", LEAST),
    _float("Across", "max", "Second", LEAST),
    _float("Product", "multiply", "Along", "Across"),
    Node("Both", "ND_sqrt_float", "sqrt", "float", (), (("in", "float", "Product"),)),
    _float("Ratio", "divide", "Across", "Along"),
    _float("Squared", "multiply", "Ratio", "Ratio"),
    _float("Strength", "subtract", "1", "Squared"),
    _image("Axis", "anisotropy"),
    _channel("Red", "Axis", 0),
    _channel("Green", "Axis", 1),
    _float("OnT", "subtract", "Red", "0.5"),
    _float("OnB", "subtract", "Green", "0.5"),
    Node("Tangent", "ND_tangent_vector3", "tangent", "vector3", (("space", "string", "world"),)),
    Node(
        "Bitangent", "ND_bitangent_vector3", "bitangent", "vector3", (("space", "string", "world"),)
    ),
    _scaled("AlongT", "Tangent", "OnT"),
    _scaled("AlongB", "Bitangent", "OnB"),
    Node(
        "Sum", "ND_add_vector3", "add", "vector3", (),
        (("in1", "vector3", "AlongT"), ("in2", "vector3", "AlongB")),
    ),
    Node("Direction", "ND_normalize_vector3", "normalize", "vector3", (),
         (("in", "vector3", "Sum"),)),
)  # fmt: skip
# Inputs of Standard Surface, and the nodes that they are connected to.
SURFACE: tuple[Input, ...] = (
    ("specular_roughness", "float", "Both"),
    ("specular_anisotropy", "float", "Strength"),
    ("tangent", "vector3", "Direction"),
)
# Where a file has nothing, and how it is filtered: an axis jumps by half a turn.
DEFAULTS: dict[Map, str] = {"roughness": "0.4, 0.4, 0", "anisotropy": "1, 0.5, 0"}
FILTERS: dict[Map, str] = {"roughness": "linear", "anisotropy": "closest"}
