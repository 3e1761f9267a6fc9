"""A procedural face with expressions, for demonstrations, figures and tests. In cm, facing +z."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh
from rhytid.errors import FrameError, MeshError
from rhytid_lab.samples.face_expressions import EXPRESSIONS
from rhytid_lab.samples.face_shape import (
    MOUTH,
    MOUTH_HALF_WIDTH,
    Chart,
    Grid,
    chart,
    cut,
    rounded_grid,
    sculpt,
)
from rhytid_lab.samples.fields import Field, ramp
from rhytid_lab.samples.flatten import flatten
from rhytid_lab.samples.grids import grid_faces

_SCALE = 1.1
_LIP_GAP = 0.12
_MARGIN = 0.02

Pose = Mapping[str, float]


@dataclass(frozen=True, eq=False)
class SampleFace:
    """A neutral mesh in cm, +y up, +z forward, and what its vertices do in each expression.

    expressions: name -> (V, 3) float32 offsets at full strength.
    """

    mesh: Mesh
    expressions: dict[str, NDArray[np.float32]]

    def pose(self, weights: Pose) -> NDArray[np.float32]:
        """(V, 3) positions under a weighted sum of expressions; FrameError for an unknown name."""
        positions = self.mesh.positions.astype(np.float64)
        for name, weight in weights.items():
            if name not in self.expressions:
                known = ", ".join(sorted(self.expressions))
                raise FrameError(f"expression {name!r}: one of {known}")
            positions += weight * self.expressions[name].astype(np.float64)
        return positions.astype(np.float32)

    def animation(self, keys: Sequence[str | Pose], frames: int) -> NDArray[np.float32]:
        """(frames, V, 3): neutral to the first key and back, then the next, eased by a quintic.

        A key is the name of an expression or a pose. The first and last frame are neutral. Raises
        FrameError without keys, or with fewer than two frames per key.
        """
        if not keys or frames < 2 * len(keys):
            raise FrameError(
                f"{frames} frames for {len(keys)} keys: at least one key, two frames each"
            )
        time = np.linspace(0, len(keys), frames)
        poses: list[Pose] = [{key: 1.0} if isinstance(key, str) else key for key in keys]
        return np.stack([self._moment(poses, t) for t in time])

    def _moment(self, poses: Sequence[Pose], time: float) -> NDArray[np.float32]:
        index = min(int(time), len(poses) - 1)
        strength = float(ramp(1 - abs(2 * (time - index) - 1), 0, 1))
        return self.pose({name: strength * weight for name, weight in poses[index].items()})


def procedural_face(resolution: int = 96) -> SampleFace:
    """A smooth, symmetric face of 2 · resolution² triangles, about 18 cm wide and 24 cm tall.

    One chart in UDIM 1001, as rigid as possible, inside [0.02, 0.98]. The mouth is a slit: its
    line is doubled between the corners, closed in the neutral pose and a little open in UV.
    Raises MeshError unless `resolution` is even and from 16 to 512.
    """
    if resolution % 2 or not 16 <= resolution <= 512:
        raise MeshError(f"resolution {resolution}: an even number from 16 to 512")
    grid = rounded_grid(resolution)
    whole = chart(grid.angle.ravel(), grid.q.ravel())
    points = _symmetric(sculpt(whole), grid)
    faces, count = grid_faces(resolution), len(points)
    line = grid.lips(whole.x)
    keep = np.concatenate([np.arange(count), line])
    cut_faces = cut(faces, line, grid.row, count)
    upper = (whole.q > MOUTH + 1e-9)[keep]
    upper[count:] = True
    uv = _open_mouth(_symmetric_uv(_unroll(points, faces, grid), grid)[keep], whole.at(keep), upper)
    positions = (_SCALE * points[keep]).astype(np.float32)
    mesh = Mesh(positions, cut_faces, _fitted(uv), cut_faces)
    moves = {n: move(whole.at(keep), points[keep], upper) for n, move in EXPRESSIONS.items()}
    return SampleFace(mesh, {n: (_SCALE * move).astype(np.float32) for n, move in moves.items()})


def _symmetric(points: Field, grid: Grid) -> Field:
    """The same points with rounding errors between the two sides removed."""
    return 0.5 * (points + points[grid.mirror] * (-1, 1, 1))


def _unroll(points: Field, faces: NDArray[np.int32], grid: Grid) -> Field:
    start = np.stack([8.5 * grid.angle.ravel(), grid.q.ravel()], axis=-1)
    return flatten(points, faces, start)


def _symmetric_uv(plane: Field, grid: Grid) -> Field:
    """Turned upright and centred, then made symmetric."""
    middle = len(grid.q) // 2
    line = plane.reshape(*grid.q.shape, 2)[:, middle]
    up = (line[-1] - line[0]) / np.linalg.norm(line[-1] - line[0])
    centred = plane - line.mean(axis=0)
    upright = np.stack([centred @ (up[1], -up[0]), centred @ up], axis=-1)
    return 0.5 * (upright + upright[grid.mirror] * (-1, 1))


def _open_mouth(plane: Field, c: Chart, upper: NDArray[np.bool_]) -> Field:
    """Upper and lower lip moved apart, so that the slit is a lens in UV."""
    across = np.clip(np.abs(c.x) / MOUTH_HALF_WIDTH, 0, 1)
    gap: Field = _LIP_GAP * (1 - across**2) * np.exp(-0.5 * ((c.q - MOUTH) / 0.6) ** 2)
    opened: Field = plane + np.stack([np.zeros_like(gap), np.where(upper, gap, -gap)], axis=-1)
    return opened


def _fitted(plane: Field) -> Field:
    """Scaled evenly into the middle of UDIM 1001, inside the margin."""
    low, high = plane.min(axis=0), plane.max(axis=0)
    scale = (1 - 2 * _MARGIN) / (high - low).max()
    uv: Field = np.clip((plane - (low + high) / 2) * scale + 0.5, _MARGIN, 1 - _MARGIN)
    return uv
