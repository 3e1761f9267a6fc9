"""A Houdini that is made up: SOPs with polygons, materials with nodes and parameters, calls as the
stub has them. It refuses parameters and inputs that are not there, and values of another kind."""

from __future__ import annotations

import sys
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
from fake_maya import CUBE, FACES, UV
from signatures import Stub

import stubs

STUB = Stub(stubs.HOUDINI)
# By SideFX's documentation.
PARMS: dict[str, dict[str, type]] = {
    "mtlximage": {
        "signature": str, "file": str, "default": float, "uaddressmode": str, "vaddressmode": str,
        "filtertype": str, "filecolorspace": str,
    },
    "mtlxdisplacement": {"signature": str, "displacement": float, "scale": float},
    "subnetconnector": {"parmname": str},
}  # fmt: skip
INPUTS = {
    "mtlximage": ("texcoord",),
    "mtlxdisplacement": ("displacement", "scale"),
    "suboutput": ("surface", "displacement"),
    "subnetconnector": ("suboutput",),
}
# Numbers of vertices in the whole geometry: not in the order of the polygons.
ORDER = np.random.default_rng(1).permutation(4 * len(FACES))


class Interrupted(Exception):
    """hou.OperationInterrupted."""


@STUB.like("Point")
class Point:
    def __init__(self, number: int) -> None:
        self._number = number

    def number(self) -> int:
        return self._number


@STUB.like("Vertex")
class Vertex:
    def __init__(self, point: int, linear: int) -> None:
        self._point, self._linear = point, linear

    def point(self) -> Point:
        return Point(self._point)

    def linearNumber(self) -> int:
        return self._linear


@STUB.like("Polygon")
class Polygon:
    def __init__(self, points: tuple[int, ...], linear: list[int], kind: object) -> None:
        self._points, self._linear, self._kind = points, linear, kind

    def type(self) -> object:
        return self._kind

    def numVertices(self) -> int:
        return len(self._points)

    def vertices(self) -> list[Vertex]:
        return [Vertex(*both) for both in zip(self._points, self._linear, strict=True)]


@STUB.like("Attrib")
class Attrib:
    def __init__(self, size: int) -> None:
        self._size = size

    def size(self) -> int:
        return self._size


@STUB.like("Geometry")
class Geometry:
    """The cube of Maya's fake, its corners the other way round, as Houdini has them."""

    def __init__(self, wide: float, uv: str, kind: object) -> None:
        self._points = CUBE * (wide, 1, 1)
        self._uv, self._kind = uv, kind

    def prims(self) -> tuple[Polygon, ...]:
        numbers = ORDER.reshape(len(FACES), 4).tolist()
        return tuple(
            Polygon(face[::-1], linear, self._kind)
            for face, linear in zip(FACES, numbers, strict=True)
        )

    def pointFloatAttribValuesAsString(self, name: str) -> bytes:
        if name == "uv":
            return np.pad(CUBE[:, :2], ((0, 0), (0, 1))).astype(np.float32).tobytes()
        return self._points.astype(np.float32).tobytes()

    def vertexFloatAttribValuesAsString(self, name: str) -> bytes:
        corners = np.array([(*uv, 0.0) for _ in FACES for uv in UV[::-1]], np.float32)
        values = np.empty_like(corners)
        values[ORDER] = corners
        return values.tobytes()

    def findVertexAttrib(self, name: str) -> Attrib | None:
        return Attrib(3) if self._uv == "vertex" else None

    def findPointAttrib(self, name: str) -> Attrib | None:
        return Attrib(3) if self._uv == "point" else None


@STUB.like("SopNode")
class SopNode:
    def __init__(self, houdini: Houdini, path: str) -> None:
        self._houdini, self._path = houdini, path

    def path(self) -> str:
        return self._path

    def geometry(self) -> Geometry | None:
        return self._houdini.made(1.0)

    def geometryAtFrame(self, frame: float) -> Geometry | None:
        return self._houdini.made(1.0 + 0.1 * frame)


@STUB.like("Parm")
class Parm:
    def __init__(self, node: VopNode, name: str) -> None:
        self._node, self._name = node, name

    def set(self, value: object) -> None:
        wanted = PARMS[self._node.kind][self._name]
        if not isinstance(value, wanted):
            raise TypeError(f"{self._name} takes {wanted}, not {value!r}")
        self._node.values[self._name] = value

    def eval(self) -> object:
        return self._node.values[self._name]


@STUB.like("VopNode")
class VopNode:
    """A node of a material, or the material."""

    def __init__(self, path: str, kind: str) -> None:
        self._path, self.kind = path, kind
        self.values: dict[str, object] = {}
        self.inside: dict[str, VopNode] = {}
        self.inputs: dict[str, tuple[VopNode, str]] = {}

    def path(self) -> str:
        return self._path

    def type(self) -> SimpleNamespace:
        return SimpleNamespace(name=lambda: self.kind)

    def node(self, name: str) -> VopNode | None:
        return self.inside.get(name)

    def children(self) -> tuple[VopNode, ...]:
        return tuple(self.inside.values())

    def createNode(self, kind: str, name: str) -> VopNode:
        assert name not in self.inside
        made = self.inside[name] = VopNode(f"{self._path}/{name}", kind)
        return made

    def parm(self, name: str) -> Parm | None:
        return Parm(self, name) if name in PARMS.get(self.kind, {}) else None

    def inputNames(self) -> tuple[str, ...]:
        return INPUTS[self.kind]

    def setNamedInput(self, name: str, node: VopNode, output: str) -> None:
        assert output == "out"
        if name not in INPUTS[self.kind]:
            raise ValueError(f"{self._path} has no input {name}")
        self.inputs[name] = (node, output)

    def setInput(self, index: int, node: VopNode, output: int = 0) -> None:
        self.inputs[INPUTS[self.kind][index]] = (node, "out")


@STUB.like("InterruptableOperation")
class Operation:
    """The dialog of the scene that was made last."""

    last: Operation | None = None

    def __init__(self, name: str, long_name: str, open_interrupt_dialog: bool = False) -> None:
        assert open_interrupt_dialog
        self.told: list[tuple[float, str]] = []
        self.interrupted = self.open = False
        Operation.last = self

    def __enter__(self) -> Operation:
        self.open = True
        return self

    def __exit__(self, *exc: object) -> None:
        self.open = False

    def updateLongProgress(self, share: float, text: str) -> None:
        assert self.open
        if self.interrupted:
            raise Interrupted
        self.told.append((share, text))


class Houdini:
    """The session."""

    def __init__(self) -> None:
        self.uv, self.windows, self.polygon = "vertex", True, object()
        self.kind, self.empty = self.polygon, False
        self.material = VopNode("/stage/library/skin", "subnet")
        self.material.createNode("suboutput", "Material_Outputs_and_AOVs")

    def made(self, wide: float) -> Geometry | None:
        return None if self.empty else Geometry(wide, self.uv, self.kind)

    def at(self, path: str) -> object:
        if path == self.material.path():
            return self.material
        return SopNode(self, path) if path.startswith("/obj/face/") else None


def install(houdini: Houdini) -> None:
    """Put the module in the place of Houdini's."""

    class Hou:
        @staticmethod
        def node(path: str) -> object:
            return houdini.at(path)

        @staticmethod
        def intFrame() -> int:
            return 5

        @staticmethod
        def isUIAvailable() -> bool:
            return houdini.windows

    @STUB.like("playbar")
    class Playbar:
        def frameRange(self) -> tuple[float, float]:
            return 1.0, 24.0

    assert "Polygon" in STUB.text_of("primType")
    made: Any = STUB.module(Hou)
    hou = ModuleType("hou")
    vars(hou).update({n: getattr(made, n) for n in dir(made) if not n.startswith("_")})
    vars(hou).update(
        SopNode=SopNode, Geometry=Geometry, InterruptableOperation=Operation,
        OperationInterrupted=Interrupted, playbar=Playbar(),
        primType=SimpleNamespace(Polygon=houdini.polygon),
    )  # fmt: skip
    sys.modules["hou"] = hou
