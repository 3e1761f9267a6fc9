"""The shader as a node of MaterialX.

The blend reads numbers of texture arrays, for which MaterialX has no nodes. So the node is defined
here: for GLSL and ESSL it is the function of the shader, whose textures the program that draws
binds by name, as it does for the passes; everywhere else it reads a height map, from `bake` or from
the last pass. After the MaterialX specification, "Custom Nodes".
"""

from __future__ import annotations

from xml.etree.ElementTree import Element, SubElement, indent, tostring

from rhytid.skin_package.languages import LANGUAGES
from rhytid.skin_package.manifest import Manifest, MaterialX
from rhytid.skin_package.shaders import library

NODE, DEFINITION = "rhytid_height", "ND_rhytid_height_float"
DOCUMENT = "skin.mtlx"
# Of MaterialX: what the language of a target is called here, and what it calls the language.
TARGETS = {"genglsl": "glsl-410", "essl": "glsl-es-300"}
_VERSION = "1.39"
_FUNCTION = "rhytid_height_at"
# Texture coordinates have v up; those of other UDIMs are of the textures that are bound.
_ENTRY = """
// For a node of MaterialX. file: read by targets that have no function of their own.
void rhytid_height_at(sampler2D file, vec2 texcoord, out float result)
{
    vec2 part = vec2(fract(texcoord.x), 1.0 - fract(texcoord.y));
    ivec2 texel = min(ivec2(part * float(RHYTID_RESOLUTION)), RHYTID_RESOLUTION - 1);
    result = rhytid_height(texel);
}
"""
_PRECISION = """precision highp float;
precision highp int;
precision highp sampler2D;
precision highp sampler2DArray;
precision highp usampler2DArray;
"""


def materialx_files() -> MaterialX:
    """Where the files are."""
    named = {target: f"shaders/materialx/height.{target}.glsl" for target in TARGETS}
    return MaterialX(document=DOCUMENT, implementations=named)


def materialx_texts(manifest: Manifest) -> dict[str, bytes]:
    """The document and the functions that it names, by file name."""
    found = {DOCUMENT: _document(manifest)}
    for target, file in manifest.materialx.implementations.items():
        language = LANGUAGES[TARGETS[target]]
        head = _PRECISION if target == "essl" else ""
        side = language.number("int", "RHYTID_RESOLUTION", str(manifest.resolution))
        text = f"{head}{library(manifest, language, 'skin')}{side}\n{_ENTRY}"
        found[file] = text.encode()
    return found


def _document(manifest: Manifest) -> bytes:
    root = Element("materialx", version=_VERSION)
    _definition(root)
    for target, file in manifest.materialx.implementations.items():
        SubElement(
            root, "implementation", name=f"IM_{NODE}_float_{target}", nodedef=DEFINITION,
            file=file, function=_FUNCTION, target=target,
        )  # fmt: skip
    graph = SubElement(root, "nodegraph", name=f"NG_{NODE}_float", nodedef=DEFINITION)
    image = SubElement(graph, "image", name="map", type="float")
    SubElement(image, "input", name="file", type="filename", interfacename="file")
    SubElement(image, "input", name="texcoord", type="vector2", interfacename="texcoord")
    for mode in ("uaddressmode", "vaddressmode"):
        SubElement(image, "input", name=mode, type="string", value="clamp")
    SubElement(graph, "output", name="out", type="float", nodename="map")
    _material(root)
    indent(root)
    return b'<?xml version="1.0"?>\n' + tostring(root) + b"\n"


def _definition(root: Element) -> None:
    said = "displacement of skin along the normal, mesh units"
    made = SubElement(root, "nodedef", name=DEFINITION, node=NODE, nodegroup="texture2d", doc=said)
    file = SubElement(made, "input", name="file", type="filename", uniform="true")
    file.set("value", "height.<UDIM>.exr")
    SubElement(made, "input", name="texcoord", type="vector2", defaultgeomprop="UV0")
    SubElement(made, "output", name="out", type="float", default="0.0")


def _material(root: Element) -> None:
    SubElement(root, NODE, name="skin_height", type="float")
    displacement = SubElement(root, "displacement", name="skin_relief", type="displacementshader")
    SubElement(displacement, "input", name="displacement", type="float", nodename="skin_height")
    SubElement(displacement, "input", name="scale", type="float", value="1.0")
    skin = SubElement(root, "surfacematerial", name="skin", type="material")
    SubElement(
        skin, "input", name="displacementshader", type="displacementshader", nodename="skin_relief"
    )
