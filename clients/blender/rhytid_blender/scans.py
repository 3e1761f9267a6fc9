"""The image that a material displaces with already, read as scanned displacement."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from rhytid_client.hosts import Trouble

from .meshes import Array
from .properties import HEIGHT

# Nodes between image and displacement that leave a grey value as it is.
PLAIN = {"REROUTE", "RGBTOBW", "SEPRGB", "SEPARATE_COLOR"}
# Colour spaces by which the values that Blender reads are those of the file.
AS_STORED = ("Non-Color", "Raw", "Linear")
# How far the scales of an object along its axes may be apart.
_EVEN = 1e-3


@dataclass(frozen=True)
class Displacement:
    """A displacement by an image, as the nodes of an object have it.

    node: the Displacement node.  scale: mesh units of 1 in the image.  midlevel: the value of a
    surface without relief.
    """

    image: bpy.types.Image
    node: Any
    scale: float
    midlevel: float

    def files(self, mesh: dict[str, Array]) -> dict[int, Path | bytes]:
        """The files of the image by UDIM, those that a mesh of `meshes.rest` lies in; their bytes
        where they are packed. Raises Trouble for an image that has none."""
        image, udims = self.image, _udims(mesh)
        if image.is_dirty:
            raise Trouble(f"Image '{image.name}' has changes that are not saved: save it first")
        if image.source not in ("FILE", "TILED"):
            raise Trouble(f"Image '{image.name}' is no image file: save it as one, and open that")
        if image.source == "FILE" and len(udims) > 1:
            listed = ", ".join(map(str, udims))
            raise Trouble(
                f"'{image.name}' is one file, and the mesh lies in the UDIMs {listed}: open its "
                "files as UDIM tiles"
            )
        return {udim: _file(image, udim) for udim in udims}

    def unlink(self) -> None:
        """Take the displacement out of what the material shows; its nodes stay."""
        for link in list(self.node.outputs["Displacement"].links):
            self.node.id_data.links.remove(link)


def displacement_of(obj: bpy.types.Object) -> Displacement:
    """The displacement that the materials of an object show by one image. Raises Trouble that names
    what is there in its place, and how to mend it."""
    found = [one for slot in obj.material_slots if (one := _in_material(slot.material)) is not None]
    if not found:
        raise Trouble(
            f"No material of '{obj.name}' displaces by an image: link an Image Texture to the "
            "Height of a Displacement node, and that to the Material Output"
        )
    images = {image for _, image in found}
    if len(images) > 1 or len({node for node, _ in found}) > 1:
        raise Trouble(f"The materials of '{obj.name}' displace apart: join them to one first")
    node, image = found[0]
    space = str(getattr(image.colorspace_settings, "name", ""))
    if not space.startswith(AS_STORED):
        raise Trouble(
            f"Image '{image.name}' is read by the colour space {space}, which bends its heights: "
            "set it to Non-Color, and Scale and Midlevel again so that the face looks right"
        )
    scale, midlevel = _number(node, "Scale"), _number(node, "Midlevel")
    if node.space == "WORLD":
        scale /= _even_scale(obj)
    return Displacement(image, node, scale, midlevel)


def _in_material(material: bpy.types.Material | None) -> tuple[Any, bpy.types.Image] | None:
    """The Displacement node of a material that is not ours, and its image: that which is shown, or
    the only one."""
    tree = None if material is None else material.node_tree
    if material is None or tree is None:
        return None
    nodes: list[Any] = list(tree.nodes)  # the stubs know only custom types of nodes
    theirs = [n for n in nodes if n.type == "DISPLACEMENT" and n.name != HEIGHT]
    shown = [node for node in theirs if node.outputs["Displacement"].is_linked]
    if any(n.type == "VECTOR_DISPLACEMENT" and n.outputs[0].is_linked for n in nodes):
        raise Trouble(
            "Vector displacement moves skin sideways and cannot be traced: bake it along the normal"
        )
    candidates = shown or theirs
    if len(candidates) > 1:
        raise Trouble(f"'{material.name}' has several Displacement nodes: leave that of the scan")
    return (candidates[0], _image(candidates[0])) if candidates else None


def _image(node: Any) -> bpy.types.Image:
    """The image whose values are the height of a node, as they are."""
    socket = node.inputs["Height"]
    while socket.is_linked:
        before = socket.links[0].from_node
        if before.type == "TEX_IMAGE":
            _check_placed(before)
            image: bpy.types.Image | None = before.image
            if image is None:
                raise Trouble("The Image Texture of the displacement has no image")
            return image
        if before.type not in PLAIN:
            raise Trouble(
                f"'{before.name}' stands between image and displacement and changes its values: "
                "link the image to Height directly, Scale and Midlevel of the node do the rest"
            )
        socket = before.inputs[0]
    raise Trouble("The Height of the Displacement node has no image: link an Image Texture to it")


def _check_placed(texture: Any) -> None:
    """Raise Trouble where an image does not lie as the UV of the mesh have it."""
    vector = texture.inputs["Vector"]
    if not vector.is_linked:
        return
    before, socket = vector.links[0].from_node, vector.links[0].from_socket
    if before.type == "UVMAP" or (before.type == "TEX_COORD" and socket.name == "UV"):
        return
    raise Trouble(
        f"'{before.name}' moves the image on the mesh: link the UV of the mesh to it directly"
    )


def _number(node: Any, name: str) -> float:
    """The value of an input that has no texture."""
    socket = node.inputs[name]
    if not socket.is_linked:
        return float(socket.default_value)
    before = socket.links[0].from_node
    if before.type != "VALUE":
        raise Trouble(
            f"{name} of the Displacement node is linked to '{before.name}': type a number"
        )
    return float(before.outputs[0].default_value)


def _even_scale(obj: bpy.types.Object) -> float:
    """How much larger an object is than its mesh; raises Trouble where that differs by axis."""
    sizes = [abs(float(obj.matrix_world.to_scale()[axis])) for axis in range(3)]
    if max(sizes) > (1.0 + _EVEN) * min(sizes):
        raise Trouble(
            f"'{obj.name}' is scaled unevenly, and its displacement is in world space: apply the "
            "scale (Ctrl A)"
        )
    return sum(sizes) / len(sizes)


def _udims(mesh: dict[str, Array]) -> list[int]:
    """The UDIMs that triangles lie in, by their middles."""
    middles = np.floor(mesh["uv"][mesh["face_uv"]].mean(axis=1)).astype(int)
    return sorted({1001 + int(u) + 10 * int(v) for u, v in middles})


def _file(image: bpy.types.Image, udim: int) -> Path | bytes:
    if image.packed_files:
        return _packed(image, udim)
    path = bpy.path.abspath(image.filepath, library=image.library).replace("<UDIM>", str(udim))
    if not Path(path).is_file():
        raise Trouble(f"Image '{image.name}' has no file for UDIM {udim}: {path} is not there")
    return Path(path)


def _packed(image: bpy.types.Image, udim: int) -> bytes:
    for number, packed in _packed_tiles(image):
        if number == udim or image.source == "FILE":
            return bytes(packed.data)
    raise Trouble(f"Image '{image.name}' has no packed tile for UDIM {udim}")


def _packed_tiles(image: bpy.types.Image) -> Iterator[tuple[int, Any]]:
    for one in image.packed_files:
        yield one.tile_number, one.packed_file
