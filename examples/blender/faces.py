"""Faces with expressions, read from files: of the demo, and of the ICT FaceKit as tests have it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Face:
    """positions: (V, 3).  faces: (F, 3 or 4).  corner_uv: (F, 3 or 4, 2).  shapes: positions (V, 3)
    of each expression by its name.  mixes: weights of expressions that make another one."""

    positions: Floats
    faces: NDArray[np.int32]
    corner_uv: Floats
    shapes: Mapping[str, Floats]
    mixes: Mapping[str, Mapping[str, float]]

    def weights(self, name: str) -> dict[str, float]:
        """How much of which shapes an expression is; ends the program for an unknown one."""
        if name in self.mixes:
            return dict(self.mixes[name])
        if name not in self.shapes:
            raise SystemExit(f"no expression {name!r}: {', '.join([*self.mixes, *self.shapes])}")
        return {name: 1.0}


def read(path: Path) -> Face:
    """The face of a .npz with `shapes` and `names`, or of a folder of ICT FaceKit's data."""
    if path.is_dir():
        return _ict(path)
    with np.load(path) as stored:
        if "shapes" not in stored or "names" not in stored:
            raise SystemExit(f"{path} has no expressions: shapes (E, V, 3) and names (E,)")
        shapes = dict(zip(map(str, stored["names"]), stored["shapes"], strict=True))
        uv = stored["uv"][stored["face_uv"]]
        return _face(stored["positions"], stored["faces"], uv, shapes, {})


def _ict(folder: Path) -> Face:
    with np.load(folder / "face.npz") as stored:
        positions = stored["positions"]
        names = [str(name) for name in stored["expr_names"]]
        shapes = {n: positions + d for n, d in zip(names, stored["expr_deltas"], strict=True)}
        uv = stored["uv"][stored["quads_uv"]]
        mixes = json.loads((folder / "composites.json").read_text(encoding="utf-8"))
        return _face(positions, stored["quads"], uv, shapes, mixes)


def _face(
    positions: Floats,
    faces: NDArray[np.int32],
    corner_uv: Floats,
    shapes: Mapping[str, Floats],
    mixes: Mapping[str, Mapping[str, float]],
) -> Face:
    floats = {name: np.ascontiguousarray(shape, np.float32) for name, shape in shapes.items()}
    corners = np.ascontiguousarray(corner_uv, np.float32)
    return Face(np.asarray(positions, np.float32), faces, corners, floats, mixes)
