"""Wrinkles of the rhytid service on a mesh of Houdini, shown by Karma. Not run in Houdini.

In a shelf tool, with `rhytid_client` and this file where Houdini's Python finds them:

    import rhytid_houdini
    from rhytid_client.hosts import Server, Skin

    server = Server("http://127.0.0.1:8717")
    print(server.tested())
    face = rhytid_houdini.HoudiniMesh(
        "/obj/face/OUT", rest="/obj/face/neutral", material="/stage/materiallibrary1/skin"
    )
    skin = Skin(face, server)
    print(skin.send(resolution=4096, expressions=[12, 48]))
    print(skin.bake("/shot/maps"))
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, cast

import hou
import numpy as np
from numpy.typing import NDArray

from rhytid_client.hosts import (
    Display,
    MapSequence,
    MeshArrays,
    Progress,
    Scene,
    Trouble,
    polygons,
    welded,
)
from rhytid_client.hosts.sequences import STANDARD, Style
from rhytid_client.hosts.trouble import no_uv

IMAGE, HEIGHT = "rhytid_map", "rhytid_height"
Floats = NDArray[np.float32]


class HoudiniMesh:
    """Polygons of a SOP.

    path: of the SOP that is animated.  rest: of one with the same points that is not.  unit: what
    one unit of the scene is.  material: of a Karma Material Builder, needed where maps are shown.
    """

    def __init__(self, path: str, *, rest: str, unit: str = "m", material: str = "") -> None:
        self.unit = unit
        self._animated, self._rest = _sop(path), _sop(rest)
        self.name = "_".join(path.strip("/").split("/")[-2:])
        self._material = material

    def rest(self) -> MeshArrays:
        """The polygons of the SOP that is not animated."""
        geometry = _geometry(self._rest.geometry(), self._rest)
        counts, corners = [], []
        for prim in geometry.prims():
            if prim.type() != hou.primType.Polygon:
                raise Trouble(f"{self._rest.path()} has primitives that are no polygons")
            counts.append(prim.numVertices())
            corners += [(v.point().number(), v.linearNumber()) for v in prim.vertices()]
        vertices, linear = np.array(corners, np.int32).reshape(-1, 2).T
        uv, rows = _uv(geometry, vertices, linear, self.name)
        return polygons(self.name, _points(geometry), counts, vertices, uv, rows, clockwise=True)

    def positions(self, frame: int) -> Floats:
        """(V, 3); the playbar stays where it is."""
        return _points(_geometry(self._animated.geometryAtFrame(frame), self._animated))

    def frame(self) -> int:
        """That of the playbar."""
        return hou.intFrame()

    def frames(self) -> Sequence[int]:
        """Those of the playbar's range."""
        first, last = hou.playbar.frameRange()
        return range(round(first), round(last) + 1)

    @contextmanager
    def working(self, title: str) -> Iterator[Progress]:
        """Houdini's dialog of operations that Esc interrupts; none where it has no windows."""
        if not hou.isUIAvailable():
            yield _silent
            return
        with hou.InterruptableOperation(title, title, open_interrupt_dialog=True) as operation:

            def show(share: float, text: str) -> bool:
                try:
                    operation.updateLongProgress(share, text)
                except hou.OperationInterrupted:
                    return False
                return True

            yield show

    def style(self, udims: Sequence[int]) -> Style:
        """Names as `rhytid bake` has them."""
        return STANDARD

    def show(self, display: Display) -> list[str]:
        """MaterialX nodes in the material: an image, its displacement, the output."""
        found = hou.node(self._material)
        if found is None:
            raise Trouble(f"There is no material '{self._material}': give that of the mesh")
        builder = cast("hou.OpNode", found)
        output, slot = _output(builder)
        image, height = (
            _node(builder, IMAGE, "mtlximage"),
            _node(builder, HEIGHT, "mtlxdisplacement"),
        )
        # A number, which no colour space converts, and none outside of the map.
        _set(image, signature="default", file=_file(display.maps, display.start), default=0.0)
        _set(image, uaddressmode="clamp", vaddressmode="clamp", filtertype="linear")
        _set(image, filecolorspace="Raw")
        _set(height, scale=display.scale)
        height.setNamedInput("displacement", image, "out")
        output.setInput(slot, height, 0)
        bound = (
            "the largest height of the maps" if display.bound is None else f"{display.bound:.6g}"
        )
        return [
            f"{image.path()} and {height.path()} displace {builder.path()}",
            "Left for you, in Render Geometry Settings: True Displacement, Displacement Bound "
            f"{bound}; on the mesh: faceVaryingLinearInterpolation all",
        ]


def _sop(path: str) -> hou.SopNode:
    node = hou.node(path)
    if not isinstance(node, hou.SopNode):
        raise Trouble(f"{path} is no SOP")
    return node


def _geometry(geometry: hou.Geometry | None, node: hou.SopNode) -> hou.Geometry:
    if geometry is None:
        raise Trouble(f"{node.path()} has no geometry")
    return geometry


def _points(geometry: hou.Geometry) -> Floats:
    return np.frombuffer(geometry.pointFloatAttribValuesAsString("P"), np.float32).reshape(-1, 3)


def _uv(
    geometry: hou.Geometry, vertices: NDArray[np.int32], linear: NDArray[np.int32], name: str
) -> tuple[Floats, NDArray[np.int32]]:
    """uv (T, 2) and the row of each corner, from `uv` of vertices, else of points.

    vertices: (C,) points of corners.  linear: (C,) their numbers in the whole geometry, which often
    are not in the order of the polygons.
    """
    if attribute := geometry.findVertexAttrib("uv"):
        values = geometry.vertexFloatAttribValuesAsString("uv")
        corners = np.frombuffer(values, np.float32).reshape(-1, attribute.size())[linear, :2]
        return welded(vertices, corners)
    if attribute := geometry.findPointAttrib("uv"):
        values = geometry.pointFloatAttribValuesAsString("uv")
        points = np.frombuffer(values, np.float32).reshape(-1, attribute.size())[:, :2]
        return points, vertices
    raise Trouble(no_uv(name))


def _silent(share: float, text: str) -> bool:
    return True


def _node(parent: hou.OpNode, name: str, kind: str) -> hou.OpNode:
    """A node by its name, made where it is not there."""
    return parent.node(name) or parent.createNode(kind, name)


def _output(builder: hou.OpNode) -> tuple[hou.OpNode, int]:
    """The node that displacement goes out by, and which input of it; raises Trouble."""
    for node in builder.children():
        kind = node.type().name()
        if kind == "suboutput" and "displacement" in node.inputNames():
            return node, node.inputNames().index("displacement")
        name = node.parm("parmname")
        if kind == "subnetconnector" and name is not None and name.eval() == "displacement":
            return node, 0
    raise Trouble(f"{builder.path()} has no output for displacement: make a Karma Material Builder")


def _file(maps: MapSequence, start: int) -> str:
    """The path with Houdini's tokens: the file of a frame follows the playbar."""
    if len(maps.frames) == 1:
        return maps.tokens(f"{maps.frames[0]:0{maps.digits}d}")
    offset = maps.frames[0] - start
    if offset:
        return maps.tokens(f"`padzero({maps.digits}, $F + {offset})`")
    return maps.tokens(f"$F{maps.digits}" if maps.digits > 1 else "$F")


def _set(node: hou.OpNode, **values: float | str) -> None:
    for name, value in values.items():
        parm = node.parm(name)
        if parm is None:
            raise Trouble(f"{node.path()} has no '{name}': this version of Houdini is another one")
        parm.set(value)


if TYPE_CHECKING:
    # What `Skin` asks of a host.
    _scene: type[Scene] = HoudiniMesh
