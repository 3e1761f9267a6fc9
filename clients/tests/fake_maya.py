"""A Maya that is made up: nodes with attributes, a mesh that moves with time, calls as the stub has
them. It refuses what Maya refuses: nodes and attributes that are not there, text set as a number,
an attribute that is led from elsewhere, a second progress window."""

from __future__ import annotations

import sys
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
from signatures import Stub

import stubs

STUB = Stub(stubs.MAYA)
TEXT = {"fileTextureName", "fileTextureNamePattern", "colorSpace"}
# Of Maya's and of Arnold's documentation; those of Arnold are there while its plug-in is loaded.
KINDS = {
    "file": {
        *("fileTextureName", "fileTextureNamePattern", "colorSpace", "ignoreColorSpaceFileRules"),
        *("uvTilingMode", "useFrameExtension", "frameExtension", "frameOffset", "uvCoord"),
        *("uvFilterSize", "outColor", "outColorR", "outAlpha", "aiFilter"),
    },
    "place2dTexture": {"outUV", "outUvFilterSize"},
    "displacementShader": {
        *("displacement", "scale", "aiDisplacementZeroValue", "aiDisplacementPadding"),
        "aiDisplacementAutoBump",
    },
    "mesh": {
        *("outMesh", "aiSubdivType", "aiSubdivIterations", "aiSubdivUvSmoothing", "aiDispHeight"),
        *("aiDispZeroValue", "aiDispPadding", "aiDispAutobump"),
    },
    "shadingEngine": {"displacementShader", "surfaceShader"},
    "transform": set(),
}
CUBE = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], np.float64)
FACES = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
UV = [(0, 0), (0.25, 0), (0.25, 0.25), (0, 0.25)]


class Maya:
    """The scene."""

    def __init__(self) -> None:
        self.kinds = {"head": "transform", "headShape": "mesh", "skinSG": "shadingEngine"}
        self.kinds |= {"headShapeOrig": "mesh", "camera": "transform"}
        self.values: dict[str, object] = {}
        self.links: dict[str, str] = {}
        self.groups = ["skinSG"]
        self.deformed, self.arnold, self.batch = True, True, False
        self.time, self.uv_ids = 5, [0, 1, 2, 3] * len(FACES)
        self.window: dict[str, object] | None = None
        self.cancelled = False

    def points(self, plug: str) -> np.ndarray:
        """Wider with time, but for the shape before the deformers."""
        still = plug.startswith("headShapeOrig") or not self.deformed
        return CUBE if still else CUBE * (1.0 + 0.1 * self.time, 1.0, 1.0)

    def check(self, plug: str) -> None:
        node, _, name = plug.partition(".")
        attributes = KINDS[self.kinds[node]]
        if name not in attributes or (name.startswith("ai") and not self.arnold):
            raise RuntimeError(f"No object matches name: {plug}")

    def loads(self, plug: str) -> np.ndarray:
        self.check(plug)
        return self.points(plug)


def commands(maya: Maya) -> Any:
    """maya.cmds of a scene."""

    class Cmds:
        @staticmethod
        def objExists(name: str) -> bool:
            return name in maya.kinds

        @staticmethod
        def objectType(name: str) -> str:
            return maya.kinds[name]

        @staticmethod
        def listRelatives(name: str, **flags: object) -> list[str] | None:
            assert flags == {
                "shapes": True, "noIntermediate": True, "fullPath": True, "type": "mesh",
            }  # fmt: skip
            return ["headShape"] if name == "head" else None

        @staticmethod
        def deformableShape(shape: str, originalGeometry: bool) -> list[str]:
            return ["headShapeOrig.outMesh" if maya.deformed else ""]

        @staticmethod
        def about(batch: bool) -> bool:
            return maya.batch

        @staticmethod
        def playbackOptions(query: bool, **flags: bool) -> float:
            return 1.0 if "minTime" in flags else 24.0

        @staticmethod
        def attributeQuery(name: str, node: str, exists: bool) -> bool:
            known = name in KINDS[maya.kinds[node]]
            return known and (maya.arnold or not name.startswith("ai"))

        @staticmethod
        def listConnections(plug: str, **flags: object) -> list[str] | None:
            if flags.get("type") == "shadingEngine":
                return maya.groups or None
            maya.check(plug)
            source = maya.links.get(plug)
            return [source.partition(".")[0]] if source else None

        @staticmethod
        def shadingNode(kind: str, name: str, **flags: bool) -> str:
            assert name not in maya.kinds
            assert len(set(flags) & {"asTexture", "asShader", "asUtility"}) == 1
            maya.kinds[name] = kind
            return name

        @staticmethod
        def connectAttr(source: str, target: str, force: bool = False) -> str:
            maya.check(source)
            maya.check(target)
            if target in maya.links and not force:
                raise RuntimeError(f"The attribute '{target}' is already connected")
            maya.links[target] = source
            return target

        @staticmethod
        def setAttr(plug: str, value: object, type: str | None = None) -> None:
            maya.check(plug)
            if (plug.partition(".")[2] in TEXT) != (type == "string"):
                raise RuntimeError(f"setAttr: {plug}: type does not match")
            if plug in maya.links:
                raise RuntimeError(f"setAttr: {plug} is locked or connected")
            maya.values[plug] = value

        @staticmethod
        def expression(string: str, name: str) -> str:
            plug, _, says = string.partition(" = ")
            maya.check(plug)
            assert says == "frame"
            maya.links[plug] = f"{name}.output"
            return name

        @staticmethod
        def progressWindow(**flags: object) -> bool:
            if flags.get("query"):
                assert maya.window is not None
                return maya.cancelled
            if flags.get("endProgress"):
                maya.window = None
            elif flags.get("edit"):
                assert maya.window is not None
                maya.window |= flags
            else:
                assert maya.window is None
                maya.window = flags
            return True

    checked: Any = STUB.module(Cmds)

    def current_time(frame: int | None = None, *, query: bool = False) -> int:
        """By Autodesk's reference it can be queried; the stub leaves that out."""
        assert query is (frame is None)
        maya.time = maya.time if frame is None else frame
        return maya.time

    checked.currentTime = staticmethod(current_time)
    return checked


class Mesh:
    """MFnMesh, of the data that a plug holds; its methods as in Autodesk's reference."""

    def __init__(self, held: tuple[Maya, str]) -> None:
        self._maya, self._plug = held

    def getPoints(self, space: int) -> list[SimpleNamespace]:
        assert space == 2
        points = self._maya.points(self._plug)
        return [SimpleNamespace(x=x, y=y, z=z, w=1.0) for x, y, z in points]

    def getVertices(self) -> tuple[list[int], list[int]]:
        return [4] * len(FACES), [corner for face in FACES for corner in face]

    def getAssignedUVs(self) -> tuple[list[int], list[int]]:
        return [4] * (len(self._maya.uv_ids) // 4), self._maya.uv_ids

    def getUVs(self) -> tuple[list[float], list[float]]:
        u, v = zip(*UV, strict=True)
        return list(u), list(v)


def install(maya: Maya) -> None:
    """Put the modules in the place of Maya's."""

    class Selection:
        def add(self, plug: str) -> Selection:
            maya.check(plug)
            self._plug = plug
            return self

        def getPlug(self, index: int) -> Selection:
            assert index == 0
            return self

        def asMObject(self) -> tuple[Maya, str]:
            return maya, self._plug

    top, api, cmds, om = (
        ModuleType(n) for n in ("maya", "maya.api", "maya.cmds", "maya.api.OpenMaya")
    )
    vars(om).update(MFnMesh=Mesh, MSelectionList=Selection, MSpace=SimpleNamespace(kObject=2))
    vars(api).update(OpenMaya=om)
    made = commands(maya)
    vars(cmds).update({n: getattr(made, n) for n in dir(made) if not n.startswith("_")})
    vars(top).update(api=api, cmds=cmds)
    for module in (top, api, cmds, om):
        sys.modules[module.__name__] = module
