"""Tangent frames of the triangles of a frame, for slopes on its surface. Kernel: tangents.cl.

The frame is that of normal maps (`exports/textures/tangents.py`), but with unit vectors: T is the
interpolated tangent (MikkTSpace) in the plane of the interpolated normal n, B is sign n x T.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer, BufferGroup
from rhytid.device.runtime import Device

# Floats of a triangle, TERMS of slope_terms.clh.
TERMS = 32
Corners = NDArray[np.int64]


@dataclass(frozen=True)
class _Joined(BufferGroup):
    """Corners that share a vector: the number of it of each corner, int32 (F, 3), and the corners
    of each, int32, which begin at `firsts`."""

    count: int
    numbers: Buffer
    firsts: Buffer
    corners: Buffer

    @classmethod
    def of(cls, device: Device, numbers: Corners) -> _Joined:
        """numbers: (F, 3)."""
        flat = numbers.reshape(-1)
        ends = np.append(0, np.cumsum(np.bincount(flat)))
        order = np.argsort(flat, kind="stable")
        arrays = (part.astype(np.int32) for part in (flat, ends, order))
        return cls(len(ends) - 1, *(device.upload(array) for array in arrays))

    @property
    def _buffers(self) -> tuple[Buffer, ...]:
        return (self.numbers, self.firsts, self.corners)


@dataclass(frozen=True)
class TangentMesh(BufferGroup):
    """What of the tangent frames of a mesh does not change with the frame."""

    count: int
    faces: Buffer
    uv: Buffer
    places: _Joined
    vertices: _Joined

    @classmethod
    def of(
        cls,
        device: Device,
        faces: NDArray[np.int32],
        uv: NDArray[np.float64],
        places: Corners,
        vertices: Corners,
        signs: NDArray[np.float64],
    ) -> TangentMesh:
        """uv: (F, 3, 2) of corners, in texels of level 0.  places, vertices: (F, 3) of corners,
        numbers of those that share a normal, and a tangent.  signs: (F,) of the area in UV, 0 where
        there are none."""
        held = device.upload(faces), device.upload(_uv_terms(uv, signs))
        return cls(len(faces), *held, _Joined.of(device, places), _Joined.of(device, vertices))

    @property
    def _buffers(self) -> tuple[Buffer | _Joined, ...]:
        return (self.faces, self.uv, self.places, self.vertices)

    def terms(self, device: Device, positions: NDArray[np.float32]) -> Buffer:
        """TERMS float32 of each triangle, for slopes.cl.  positions: (V, 3) of the frame."""
        held = device.upload(positions)
        faces, places, vertices = self.faces, self.places, self.vertices
        normals, tangents = (
            device.empty(3 * part.count, np.float32) for part in (places, vertices)
        )
        out = device.empty(TERMS * self.count, np.float32)
        of = (places.firsts, places.corners, normals)
        device.launch("tangents", "normals", (places.count,), held, faces, *of)
        of = (vertices.firsts, vertices.corners, tangents)
        device.launch(
            "tangents", "tangents", (vertices.count,),
            held, faces, places.numbers, normals, self.uv, *of,
        )  # fmt: skip
        device.launch(
            "tangents", "terms", (self.count,),
            held, faces, places.numbers, vertices.numbers, normals, tangents, self.uv, out,
        )  # fmt: skip
        for buffer in (held, normals, tangents):
            buffer.release()
        return out


def _uv_terms(uv: NDArray[np.float64], signs: NDArray[np.float64]) -> NDArray[np.float32]:
    """(F, 10) what tangents.cl has of each triangle in UV."""
    edges = uv[:, 1:] - uv[:, :1]
    (b_x, b_y), (c_x, c_y) = (edges[:, k].T for k in (0, 1))
    area = b_x * c_y - b_y * c_x
    inverse = np.where(area != 0.0, 1.0 / np.where(area != 0.0, area, 1.0), 0.0)
    middle = np.floor(uv.mean(axis=1))
    return np.column_stack(
        [edges.reshape(-1, 4), inverse, middle - uv[:, 0], middle, signs]
    ).astype(np.float32)
