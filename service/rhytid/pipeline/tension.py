"""Mesh tension, an isotropic stretch (Raman et al. 2023). Kernel: tension.cl."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.device.runtime import Device
from rhytid.domain.mesh import Mesh
from rhytid.pipeline.stretch_buffers import LogLimit, StretchBuffers


class Tension:
    """Per vertex the mean ratio of its edges' lengths, per triangle the mean log of them."""

    def __init__(self, device: Device, mesh: Mesh) -> None:
        offsets, neighbours, rest = edges_by_vertex(mesh)
        self._device = device
        self._vertices = len(mesh.positions)
        self._edges = (device.upload(offsets), device.upload(neighbours), device.upload(rest))

    def launch(
        self, frame: Buffer, faces: Buffer, triangles: int, limit: LogLimit, found: StretchBuffers
    ) -> None:
        """Fill `found` for the first `triangles`; the rest is unstretched."""
        self._device.launch(
            "tension", "vertex_tension", (self._vertices,), frame, *self._edges, found.tension
        )
        self._device.launch(
            "tension", "stretch_tension", (found.count,),
            found.tension, faces, np.int32(triangles), np.float32(limit.most),
            found.ratios, found.axes, found.logs, defines=limit.defines,
        )  # fmt: skip

    def release(self) -> None:
        """Give the memory back."""
        for buffer in self._edges:
            buffer.release()


def edges_by_vertex(
    mesh: Mesh,
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.float32]]:
    """The edges of each vertex: offsets (V + 1,), the other ends (2E,), 1 / neutral length (2E,).

    An edge counts once however many triangles share it. One without length does not count, nor
    one so short that no float32 holds the inverse of its length.
    """
    pairs = np.stack([mesh.faces.reshape(-1), np.roll(mesh.faces, -1, axis=1).reshape(-1)], axis=1)
    edges = np.unique(np.sort(pairs, axis=1), axis=0)
    both = np.concatenate([edges, edges[:, ::-1]])
    both = both[np.lexsort((both[:, 1], both[:, 0]))]
    ends = mesh.positions[both].astype(np.float64)
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    usable = length >= np.finfo(np.float32).tiny
    both, length = both[usable], length[usable]
    count = np.bincount(both[:, 0], minlength=len(mesh.positions))
    offsets = np.concatenate([[0], np.cumsum(count)]).astype(np.int32)
    return offsets, both[:, 1].astype(np.int32), (1.0 / length).astype(np.float32)
