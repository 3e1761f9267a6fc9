"""A look: the baked maps that displace a mesh, and how a scene has them; as a MaterialX document.

The document is a displacement network, whose frames are a token of the file name. After the
MaterialX specification, "Filename Substitutions" and "Shader Nodes". Written as version 1.38, which
libraries from 2021 on read. `usda.py` writes a look as USD text.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from rhytid.domain.lengths import millimetres
from rhytid.errors import InputError
from rhytid.exports.look_shine import DEFAULTS, FILTERS, SHINE, SURFACE, Map

FIRST_UDIM, LAST_UDIM = 1001, 1100  # those that USD has
_NUMBER = re.compile(r"[0-9]+", re.ASCII)
_VERSION = "1.38"


@dataclass(frozen=True)
class Look:
    """Maps called NAME.<UDIM>.<FRAME>.exr, and the scene that is displaced by them.

    The files of the look lie beside the maps.  udims: ascending.  frames: what file names have for
    FRAME: numbers, ascending, or one name.  unit, scene_unit: of length, of the maps and of the
    scene.  uv: the primvar of texture coordinates.  fps: frames per second of the scene.  bind: the
    path of a mesh that gets the material, or None.  material: the path of a material that gets the
    displacement; None: a new one is made.  shine: whether that has the roughness and anisotropy of
    maps called NAME.roughness.<UDIM>.<FRAME>.png and NAME.anisotropy.<UDIM>.<FRAME>.png.
    """

    name: str
    udims: tuple[int, ...]
    frames: tuple[str, ...]
    unit: str
    scene_unit: str
    uv: str = "st"
    fps: float = 24.0
    bind: str | None = None
    material: str | None = None
    shine: bool = False

    def __post_init__(self) -> None:
        outside = [udim for udim in self.udims if not FIRST_UDIM <= udim <= LAST_UDIM]
        if outside:
            raise InputError(f"UDIM {outside[0]}: USD reads {FIRST_UDIM} to {LAST_UDIM}")
        if len(self.frames) > 1:
            self.frame_token()
        if self.bind is not None and self.bind in (self.material, f"/Looks/{self.identifier}"):
            raise InputError(f"{self.bind} is a material: it cannot be the mesh as well")

    @property
    def identifier(self) -> str:
        """The name as an identifier of USD and MaterialX: letters, digits and '_', no digit
        first."""
        text = re.sub(r"[^A-Za-z0-9_]", "_", self.name)
        return f"_{text}" if text[0].isdigit() else text

    @property
    def scale(self) -> float:
        """The factor from the unit of the maps to that of the scene; raises InputError where either
        has no known length."""
        if self.unit == self.scene_unit:
            return 1.0
        return float(f"{_length(self.unit) / _length(self.scene_unit):.12g}")

    def file(self, frame: str) -> str:
        """The file name of the map of a frame, with <UDIM> for the number unless UDIM 1001 is the
        only one."""
        udim = str(FIRST_UDIM) if self.udims == (FIRST_UDIM,) else "<UDIM>"
        return f"{self.name}.{udim}.{frame}.exr"

    def shine_file(self, map: Map, frame: str) -> str:
        """The same of a map of shine."""
        return f"{self.name}.{map}{self.file(frame).removeprefix(self.name)[:-4]}.png"

    def frame_token(self) -> str:
        """The token in file names that MaterialX replaces by the number of a frame, or the name of
        the only frame.

        Raises InputError where frames have names, or numbers of different padding.
        """
        if len(self.frames) == 1:
            return self.frames[0]
        named = [frame for frame in self.frames if not _NUMBER.fullmatch(frame)]
        if named:
            raise InputError(f"frame {named[0]} has no number: --frame chooses the one to show")
        digits = min(map(len, self.frames))
        for frame in self.frames:
            if f"{int(frame):0{digits}d}" != frame:
                raise InputError(f"frame {frame} is not padded as others are, to {digits} digits")
        return "{frame}" if digits == 1 else f"{{0{digits}frame}}"


def _length(unit: str) -> float:
    length = millimetres(unit)
    if length is None:
        raise InputError(f"{unit!r} is no known unit of length: maps cannot be scaled")
    return length


def materialx_look(look: Look) -> bytes:
    """The MaterialX document of a look: an image of heights, its displacement, and a material that
    has it."""
    root = Element("materialx", version=_VERSION)
    name = look.identifier
    graph = SubElement(root, "nodegraph", name=f"{name}_heights")
    image = SubElement(graph, "image", name="heights", type="float")
    _set_image(image, look.file(look.frame_token()), ("float", "0"), "linear")
    SubElement(graph, "output", name="out", type="float", nodename="heights")
    moved = SubElement(root, "displacement", name=f"{name}_displacement", type="displacementshader")
    _input(moved, "displacement", "float", nodegraph=f"{name}_heights", output="out")
    _input(moved, "scale", "float", value=repr(look.scale))
    if look.shine:
        _add_shine(root, look)
    surface = SubElement(root, "standard_surface", name=f"{name}_surface", type="surfaceshader")
    for input, type, _ in SURFACE if look.shine else ():
        _input(surface, input, type, nodegraph=f"{name}_shine", output=input)
    material = SubElement(root, "surfacematerial", name=name, type="material")
    for kind in ("surface", "displacement"):
        shader = f"{kind}shader"
        _input(material, shader, shader, nodename=f"{name}_{kind}")
    indent(root)
    text: str = tostring(root, "unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'.encode()


def _set_image(image: Element, name: str, default: tuple[str, str], filter: str) -> None:
    file = _input(image, "file", "filename", value=name)
    file.set("colorspace", "none")
    _input(image, "default", default[0], value=default[1])
    for mode in ("uaddressmode", "vaddressmode"):
        _input(image, mode, "string", value="clamp")
    _input(image, "filtertype", "string", value=filter)


def _add_shine(root: Element, look: Look) -> None:
    """The graph of roughness and anisotropy."""
    graph = SubElement(root, "nodegraph", name=f"{look.identifier}_shine")
    for node in SHINE:
        made = SubElement(graph, node.category, name=node.name, type=node.type)
        if node.map is not None:
            name = look.shine_file(node.map, look.frame_token())
            _set_image(made, name, ("color3", DEFAULTS[node.map]), FILTERS[node.map])
        for input, type, value in node.values:
            _input(made, input, type, value=value)
        for input, type, other in node.links:
            _input(made, input, type, nodename=other)
    for input, type, source in SURFACE:
        SubElement(graph, "output", name=input, type=type, nodename=source)


def _input(node: Element, name: str, type: str, **more: str) -> Element:
    return SubElement(node, "input", {"name": name, "type": type, **more})
