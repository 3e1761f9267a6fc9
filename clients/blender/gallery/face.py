"""The ICT face, mean identity: its expressions, captured frames, and a mesh file for `rhytid bake`.

The face is of ICT-FaceKit (USC Institute for Creative Technologies, MIT licence). Lengths are
centimetres, y is up and z is forward.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np


@dataclass(frozen=True)
class Face:
    """A face and what it does.

    rest (V, 3); quads (Q, 4); uv (T, 2) and quads_uv (Q, 4).  names and offsets (E, V, 3): the
    expressions, less the rest.  captured (N, E): weights of them by frame, at 30 frames per second.
    """

    rest: np.ndarray
    quads: np.ndarray
    uv: np.ndarray
    quads_uv: np.ndarray
    names: list[str]
    offsets: np.ndarray
    captured: np.ndarray
    combined: dict[str, dict[str, float]]

    @classmethod
    def read(cls, folder: Path) -> Face:
        """The face in a folder with `face.npz`, `performance.npz` and `composites.json`."""
        with np.load(folder / "face.npz") as face:
            mesh = [face[name] for name in ("positions", "quads", "uv", "quads_uv")]
            names = [str(name) for name in face["expr_names"]]
            offsets = face["expr_deltas"].astype(np.float32)
        with np.load(folder / "performance.npz") as performance:
            order = [list(performance["names"]).index(name) for name in names]
            captured = performance["weights"][:, order]
        combined = json.loads((folder / "composites.json").read_text(encoding="utf-8"))
        return cls(*mesh, names, offsets, captured, combined)

    def expression(self, name: str) -> np.ndarray:
        """Weights (E,) of a combination of expressions, such as `smile`."""
        weights = np.zeros(len(self.names), np.float32)
        for part, weight in self.combined[name].items():
            weights[self.names.index(part)] = weight
        return weights

    def moved(self, weights: np.ndarray) -> np.ndarray:
        """Positions (N, V, 3) under weights (N, E)."""
        return self.rest + np.einsum("ne,evd->nvd", weights, self.offsets)

    def write(self, path: Path, weights: np.ndarray) -> None:
        """A mesh file with a frame for each row of weights, and the expressions as its shapes."""
        triangles, corners = (_triangles(q) for q in (self.quads, self.quads_uv))
        np.savez(
            path,
            positions=self.rest,
            faces=triangles,
            uv=self.uv,
            face_uv=corners,
            frames=self.moved(weights).astype(np.float32),
            shapes=(self.rest + self.offsets).astype(np.float32),
            names=np.array(self.names),
        )

    def eyes(self) -> list[tuple[np.ndarray, float]]:
        """Centre (3,) and radius of the spheres through the edges of the lids, left and right."""
        rims = self.rest[self._rims()]
        open_lids = (rims[:, 1] > 2.5) & (rims[:, 1] < 4.6) & (rims[:, 2] > 8.0)
        sides = (rims[open_lids & (sign * rims[:, 0] > 0)] for sign in (1, -1))
        return [_sphere(points.astype(np.float64)) for points in sides]

    def _rims(self) -> np.ndarray:
        """The vertices of edges that one quad alone has."""
        edges = np.stack([self.quads, np.roll(self.quads, -1, axis=1)], axis=-1).reshape(-1, 2)
        edges, counts = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)
        return np.unique(edges[counts == 1])


def _triangles(quads: np.ndarray) -> np.ndarray:
    return quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)


def _sphere(points: np.ndarray) -> tuple[np.ndarray, float]:
    """The sphere nearest to points (N, 3): |p|² = 2 p·c + r² - |c|², by least squares."""
    rows = np.column_stack([2 * points, np.ones(len(points))])
    solved = np.linalg.lstsq(rows, (points**2).sum(axis=1), rcond=None)[0]
    centre = solved[:3]
    return centre, float(np.sqrt(solved[3] + centre @ centre))
