"""The real face that tests marked `face` measure on; it lives outside the repository.

RHYTID_FACE_DATA names a folder that holds `ict_face`: face.npz, composites.json,
performance.npz and stretch.md.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

VARIABLE = "RHYTID_FACE_DATA"
MISSING = f"needs the real face: set {VARIABLE}"

Positions = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Face:
    """positions (V, 3) f32, cm.  faces (F, 3).  uv (T, 2) f32.  face_uv (F, 3).

    deltas: (V, 3) f32 offsets from neutral by expression.  composites: weights by name.
    """

    positions: Positions
    faces: NDArray[np.int32]
    uv: NDArray[np.float32]
    face_uv: NDArray[np.int32]
    deltas: Mapping[str, Positions]
    composites: Mapping[str, Mapping[str, float]]

    @property
    def expression_names(self) -> tuple[str, ...]:
        return tuple(self.deltas)

    def composite(self, name: str) -> Positions:
        """(V, 3) positions of a named combination of expressions."""
        return self.evaluate(self.composites[name])

    def expression(self, name: str, weight: float = 1.0) -> Positions:
        """(V, 3) positions of one expression."""
        return self.evaluate({name: weight})

    def captured(self, index: int) -> Positions:
        """(V, 3) positions of one frame of the captured performance."""
        names, weights = performance()
        return self.evaluate(dict(zip(names, weights[index].astype(float), strict=True)))

    def evaluate(self, weights: Mapping[str, float]) -> Positions:
        """(V, 3): neutral plus weighted offsets, summed in double, rounded once."""
        total = self.positions.astype(np.float64)
        for name, weight in weights.items():
            total += weight * self.deltas[name]
        return total.astype(np.float32)


def available() -> bool:
    return bool(os.environ.get(VARIABLE))


@cache
def load_face() -> Face:
    """The neutral face with its expressions; arrays are read-only and shared."""
    with np.load(_folder() / "face.npz", allow_pickle=False) as stored:
        names = [str(name) for name in stored["expr_names"]]
        neutral = [stored[key] for key in ("positions", "faces", "uv", "face_uv")]
        deltas = stored["expr_deltas"]
    for array in (*neutral, deltas):
        array.setflags(write=False)
    composites = json.loads((_folder() / "composites.json").read_text(encoding="utf-8"))
    return Face(*neutral, dict(zip(names, deltas, strict=True)), composites)


@cache
def performance() -> tuple[tuple[str, ...], NDArray[np.float32]]:
    """Names (E,) and weights (N, E) of the captured performance, 30 frames per second."""
    with np.load(_folder() / "performance.npz", allow_pickle=False) as stored:
        return tuple(str(name) for name in stored["names"]), stored["weights"]


def measured_stretch() -> dict[str, dict[str, float]]:
    """The table of stretch.md, measured apart from us: {expression: {column: value}}."""
    lines = (_folder() / "stretch.md").read_text(encoding="utf-8").splitlines()
    header, _, *rows = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in lines
        if line.startswith("|")
    ]
    columns = header[1:]
    return {name: dict(zip(columns, map(float, cells), strict=True)) for name, *cells in rows}


def folder() -> Path:
    """The folder of the data sets."""
    return Path(os.environ[VARIABLE])


def _folder() -> Path:
    return folder() / "ict_face"
