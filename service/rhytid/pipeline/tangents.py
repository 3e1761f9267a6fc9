"""Tangent frames of the triangles of a frame, for slopes on its surface. Kernel: tangents.cl.

The frame is that of normal maps (`exports/textures/tangents.py`), but with unit vectors: T is the
interpolated tangent (MikkTSpace) in the plane of the interpolated normal n, B is sign n x T.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer, BufferGroup
from rhytid.device.runtime import Device

# Floats of a triangle, TERMS of slope_terms.clh.
TERMS = 32
Corners = NDArray[np.int64]


def _places(corners: list[tuple[int, ...]]) -> NDArray[np.float64]:
    """(n, 3) shares of the corners."""
    shares: NDArray[np.float64] = np.array(corners) / np.sum(corners, axis=1, keepdims=True)
    return shares


# Where the turn of a triangle is taken for a polynomial of fourth degree; and where the
# polynomial is tried.
_LATTICE = _places([(4 - j - k, j, k) for j in range(5) for k in range(5 - j)])
_TRIED = _places(
    [corners for a, b in ((7, 1), (5, 3)) for corners in itertools.permutations((a, b, 0))]
    + [(6, 1, 1), (1, 6, 1), (1, 1, 6), (1, 1, 1)]
)


def _fitted() -> NDArray[np.float32]:
    """(21, 16) of `fit` in tangents.cl: shares of the corners in both kinds of places, and what the
    angle in a place of the lattice adds to the coefficients (1, u, v, uu, uv, vv, ..)."""
    u, v = (_LATTICE[:, 1:] - 1 / 3).T
    powers = np.column_stack([u ** (d - k) * v**k for d in range(5) for k in range(d + 1)])
    lattice = np.vstack([_LATTICE, _places([(1, 1, 1)])])
    adds = np.pad(np.linalg.inv(powers).T, ((0, 0), (0, 1)))
    return np.vstack([lattice.T, _TRIED.T, adds]).astype(np.float32)


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

    def joined(self, device: Device, shares: Buffer) -> Buffer:
        """Of each vector, the unit sum of the shares of its corners."""
        out = device.empty(3 * self.count, np.float32)
        device.launch("tangents", "joined", (self.count,), shares, self.firsts, self.corners, out)
        return out


@dataclass(frozen=True)
class TangentMesh(BufferGroup):
    """What of the tangent frames of a mesh does not change with the frame."""

    count: int
    faces: Buffer
    uv: Buffer
    places: _Joined
    vertices: _Joined
    fitted: Buffer

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
        joined = _Joined.of(device, places), _Joined.of(device, vertices)
        return cls(len(faces), *held, *joined, device.upload(_fitted()))

    @property
    def _buffers(self) -> tuple[Buffer | _Joined, ...]:
        return (self.faces, self.uv, self.places, self.vertices, self.fitted)

    def terms(self, device: Device, positions: NDArray[np.float32]) -> Buffer:
        """TERMS float32 of each triangle, for slopes.cl.  positions: (V, 3) of the frame."""
        held, shares = device.upload(positions), device.empty(9 * self.count, np.float32)
        shape, out = (held, self.faces), device.empty(TERMS * self.count, np.float32)
        places, vertices = self.places, self.vertices
        self._launch(device, "normal_shares", *shape, shares)
        normals = places.joined(device, shares)
        self._launch(device, "tangent_shares", *shape, places.numbers, normals, self.uv, shares)
        tangents = vertices.joined(device, shares)
        frames = (places.numbers, vertices.numbers, normals, tangents)
        self._launch(device, "terms", *shape, *frames, self.uv, self.fitted, out)
        for buffer in (held, shares, normals, tangents):
            buffer.release()
        return out

    def _launch(self, device: Device, kernel: str, *arguments: Buffer) -> None:
        """For each triangle."""
        device.launch("tangents", kernel, (self.count,), *arguments)


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
