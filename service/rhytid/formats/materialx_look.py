"""A look as a MaterialX document: a displacement network, its frames as a token of the file name.

After the MaterialX specification, "Filename Substitutions" and "Shader Nodes". Written as version
1.38, which libraries from 2021 on read.
"""

from __future__ import annotations

from xml.etree.ElementTree import Element, SubElement, indent, tostring

from rhytid.formats.look import Look

_VERSION = "1.38"


def materialx_look(look: Look) -> bytes:
    """The document: an image of heights, its displacement, and a material that has it."""
    root = Element("materialx", version=_VERSION)
    name = look.identifier
    graph = SubElement(root, "nodegraph", name=f"{name}_heights")
    image = SubElement(graph, "image", name="heights", type="float")
    file = _input(image, "file", "filename", value=look.file(look.frame_token()))
    file.set("colorspace", "none")
    _input(image, "default", "float", value="0")
    for mode in ("uaddressmode", "vaddressmode"):
        _input(image, mode, "string", value="clamp")
    _input(image, "filtertype", "string", value="linear")
    SubElement(graph, "output", name="out", type="float", nodename="heights")
    moved = SubElement(root, "displacement", name=f"{name}_displacement", type="displacementshader")
    _input(moved, "displacement", "float", nodegraph=f"{name}_heights", output="out")
    _input(moved, "scale", "float", value=repr(look.scale))
    SubElement(root, "standard_surface", name=f"{name}_surface", type="surfaceshader")
    material = SubElement(root, "surfacematerial", name=name, type="material")
    for kind in ("surface", "displacement"):
        shader = f"{kind}shader"
        _input(material, shader, shader, nodename=f"{name}_{kind}")
    indent(root)
    text: str = tostring(root, "unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'.encode()


def _input(node: Element, name: str, type: str, **more: str) -> Element:
    return SubElement(node, "input", {"name": name, "type": type, **more})
