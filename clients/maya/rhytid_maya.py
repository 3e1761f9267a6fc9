"""Wrinkles of the rhytid service on a mesh of Maya, shown by Arnold. Not run in Maya.

In the script editor, with `rhytid_client` and this file where Maya's Python finds them:

    import rhytid_maya
    from rhytid_client.hosts import Server, Skin

    server = Server("http://127.0.0.1:8717")
    print(server.tested())
    skin = Skin(rhytid_maya.MayaMesh("head"), server)
    print(skin.send(resolution=4096, expressions=[12, 48]))
    print(skin.bake("/shot/maps"))
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Literal

import maya.api.OpenMaya as om
import numpy as np
from numpy.typing import NDArray

from maya import cmds
from rhytid_client.hosts import Display, MapSequence, MeshArrays, Progress, Scene, Trouble, polygons
from rhytid_client.hosts.sequences import STANDARD, UNPADDED, Style

# Entries of Arnold's and Maya's menus, as attributes have them.
CATCLARK, LINEAR = 1, 2  # aiSubdivType
LINEAR_UV = 2  # aiSubdivUvSmoothing
BILINEAR = 1  # aiFilter of a file node: the default, smart bicubic, may change heights
UDIM_MARI = 3  # uvTilingMode of a file node


class MayaMesh:
    """A polygon mesh of the scene, by the name of its transform or shape.

    iterations: how often Arnold cuts each face in four. Raises Trouble where there is no such mesh.
    """

    # What the API gives is in Maya's internal unit, whatever unit the user works in.
    unit = "cm"

    def __init__(self, name: str, *, iterations: int = 4) -> None:
        self.shape = _shape(name)
        self.name = name.rpartition("|")[2].replace(":", "_")
        self._iterations = iterations

    def rest(self) -> MeshArrays:
        """The mesh before its deformers, in its own space."""
        (plug, *_) = cmds.deformableShape(self.shape, originalGeometry=True) or [""]  # type: ignore[func-returns-value]
        mesh = _mesh(plug or f"{self.shape}.outMesh")
        counts, vertices = mesh.getVertices()
        _, rows = mesh.getAssignedUVs()
        uv = np.stack([np.array(axis) for axis in mesh.getUVs()], axis=-1)
        return polygons(self.name, _points(mesh), counts, vertices, uv, rows)

    def positions(self, frame: int) -> NDArray[np.float64]:
        """(V, 3), in its own space; the scene stays at the frame."""
        cmds.currentTime(frame)
        return _points(_mesh(f"{self.shape}.outMesh"))

    def frame(self) -> int:
        """That of the time slider."""
        # The stubs have no query of the time: the command has.
        return int(cmds.currentTime(query=True))  # type: ignore[call-arg]

    def frames(self) -> Sequence[int]:
        """Those of the playback range."""
        first = cmds.playbackOptions(query=True, minTime=True)
        last = cmds.playbackOptions(query=True, maxTime=True)
        return range(round(first), round(last) + 1)

    @contextmanager
    def working(self, title: str) -> Iterator[Progress]:
        """A progress window, Esc cancels; none where Maya has no windows."""
        shown, batch = self.frame(), cmds.about(batch=True)
        if not batch:
            cmds.progressWindow(title=title, progress=0, maxValue=100, isInterruptable=True)
        try:
            yield _silent if batch else _show
        finally:
            if not batch:
                cmds.progressWindow(endProgress=True)
            cmds.currentTime(shown)

    def style(self, udims: Sequence[int]) -> Style:
        """With several UDIMs frames have no zeros in front."""
        return STANDARD if tuple(udims) == (1001,) else UNPADDED

    def show(self, display: Display) -> list[str]:
        """A file node, a displacement shader, and the attributes of Arnold on the shape."""
        if not cmds.attributeQuery("aiDispHeight", node=self.shape, exists=True):
            raise Trouble("Arnold is not there: load its plug-in 'mtoa', then show the maps again")
        groups = _shading_groups(self.shape, f"rhytid_{self.name}_height")
        texture = _file(f"rhytid_{self.name}_map", display)
        height = _node(f"rhytid_{self.name}_height", "displacementShader")
        # A number displaces along the normal, a colour along itself.
        cmds.connectAttr(f"{texture}.outColorR", f"{height}.displacement", force=True)
        for group in groups:
            cmds.connectAttr(f"{height}.displacement", f"{group}.displacementShader", force=True)
        done = [f"'{texture}' and '{height}' displace {', '.join(groups)}"]
        bound = display.bound
        if bound is None:
            done.append("Left for you: Bounds Padding of the shape, the largest height of the maps")
        _set(height, scale=1.0, aiDisplacementZeroValue=0.0, aiDisplacementPadding=bound or 0.0)
        _set(
            self.shape,
            aiSubdivType=CATCLARK if self._mostly_quads() else LINEAR,
            aiSubdivIterations=self._iterations,
            aiSubdivUvSmoothing=LINEAR_UV,
            aiDispHeight=display.scale,
            aiDispZeroValue=0.0,
            aiDispPadding=bound or 0.0,
            aiDispAutobump=True,
        )
        return done

    def _mostly_quads(self) -> bool:
        counts, _ = _mesh(f"{self.shape}.outMesh").getVertices()
        return bool(2 * sum(count == 4 for count in counts) > len(counts))


def _shape(name: str) -> str:
    if not cmds.objExists(name):
        raise Trouble(f"There is no '{name}' in the scene")
    below = cmds.listRelatives(name, shapes=True, noIntermediate=True, fullPath=True, type="mesh")
    if below:
        return below[0]
    if cmds.objectType(name) == "mesh":
        return name
    raise Trouble(f"'{name}' is no polygon mesh")


def _mesh(plug: str) -> Any:
    """The mesh that a plug holds now, an MFnMesh."""
    return om.MFnMesh(om.MSelectionList().add(plug).getPlug(0).asMObject())


def _points(mesh: Any) -> NDArray[np.float64]:
    points = mesh.getPoints(om.MSpace.kObject)
    return np.array([(point.x, point.y, point.z) for point in points], np.float64).reshape(-1, 3)


def _silent(share: float, text: str) -> bool:
    return True


def _show(share: float, text: str) -> bool:
    cmds.progressWindow(edit=True, progress=round(100 * share), status=text)
    return not cmds.progressWindow(query=True, isCancelled=True)


def _shading_groups(shape: str, height: str) -> list[str]:
    """Those of the shape, which may differ by face; raises Trouble where one of them is that of all
    meshes, or has another displacement than the node `height`."""
    groups = list(dict.fromkeys(cmds.listConnections(shape, type="shadingEngine") or []))
    if not groups or "initialShadingGroup" in groups:
        raise Trouble("Give the mesh a material of its own: the first one is that of all meshes")
    for group in groups:
        plug = f"{group}.displacementShader"
        present = cmds.listConnections(plug, source=True, destination=False) or []
        if present and present != [height]:
            raise Trouble(f"'{group}' has a displacement of its own, '{present[0]}': disconnect it")
    return groups


def _node(name: str, kind: Literal["file", "displacementShader"]) -> str:
    """A node by its name, made where it is not there."""
    if cmds.objExists(name):
        return name
    if kind == "file":
        return cmds.shadingNode(kind, name=name, asTexture=True, isColorManaged=True)
    return cmds.shadingNode(kind, name=name, asShader=True)


def _file(name: str, display: Display) -> str:
    """A file node that plays the maps: raw, linear, tiled or not."""
    maps, made = display.maps, not cmds.objExists(name)
    texture = _node(name, "file")
    if made:
        place = cmds.shadingNode("place2dTexture", asUtility=True, name=f"{name}_uv")
        cmds.connectAttr(f"{place}.outUV", f"{texture}.uvCoord")
        cmds.connectAttr(f"{place}.outUvFilterSize", f"{texture}.uvFilterSize")
    # A rule for files would set the colour space again.
    _set(texture, ignoreColorSpaceFileRules=True, aiFilter=BILINEAR)
    _set(texture, uvTilingMode=UDIM_MARI if maps.tiled else 0)
    first = maps.file(maps.udims[0], maps.frames[0])
    _set_text(texture, colorSpace="Raw", fileTextureName=first.as_posix())
    _play(texture, maps, display.start)
    return texture


def _play(texture: str, maps: MapSequence, start: int) -> None:
    """Let a file node play a sequence from the frame `start`, or show its only frame."""
    several = len(maps.frames) > 1
    _set(texture, useFrameExtension=several, frameOffset=maps.frames[0] - start)
    if maps.tiled:
        frame = "<f>" if several else str(maps.frames[0])
        _set_text(texture, fileTextureNamePattern=maps.tokens(frame).replace("\\", "/"))
    if several and not cmds.listConnections(f"{texture}.frameExtension", destination=False):
        cmds.expression(string=f"{texture}.frameExtension = frame", name=f"{texture}_frame")


def _set(node: str, **values: float) -> None:
    for name, value in values.items():
        cmds.setAttr(f"{node}.{name}", value)


def _set_text(node: str, **values: str) -> None:
    for name, value in values.items():
        cmds.setAttr(f"{node}.{name}", value, type="string")


if TYPE_CHECKING:
    # What `Skin` asks of a host.
    _scene: type[Scene] = MayaMesh
