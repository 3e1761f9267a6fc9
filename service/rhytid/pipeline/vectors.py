"""The triangles under the texels of each vector of a tile. Kernel: vectors.cl.

Texture coordinates never move, so this is found once per tile; a frame then blends each vector once
for each of its triangles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer, BufferGroup
from rhytid.device.runtime import Device

# Texels that kernels take at once, WIDTH of vectors.clh: the smallest levels are padded to it.
VECTOR = 16
# About what the triangles of a map take where they are many texels wide: it was 4.7 on a real face
# at 256² texels, 2.0 at 1024², 1.4 at 2048² and 1.1 at 4096².
BYTES_A_TEXEL = 1


@dataclass(frozen=True)
class VectorTriangles(BufferGroup):
    """The triangles under the texels of V vectors, on the device.

    firsts (V + 1,) int32: where the members of each vector begin.  members (K, 2) int32: a triangle
    and, as bits, the texels of the vector that lie in it; a bit behind those of a vector that is
    clear (`CLEAR` of vectors.clh).
    """

    firsts: Buffer
    members: Buffer

    @classmethod
    def of(cls, device: Device, triangles: Buffer, texels: int) -> VectorTriangles:
        """From the triangles, int32, of `texels` texels, a multiple of VECTOR."""
        count = texels // VECTOR
        counts = device.empty(count, np.int32)
        device.launch("vectors", "count_triangles", (count,), triangles, counts)
        ends = np.cumsum(device.read(counts, (count,), np.int32), dtype=np.int32)
        counts.release()
        found = cls(
            device.upload(np.append(np.int32(0), ends)), device.empty(2 * int(ends[-1]), np.int32)
        )
        device.launch("vectors", "list_triangles", (count,), triangles, found.firsts, found.members)
        return found

    def numbers(self, device: Device) -> NDArray[np.int32]:
        """The triangles of all vectors, one after the other."""
        members = device.read(self.members, (self.members.nbytes // 8, 2), np.int32)
        found: NDArray[np.int32] = members[:, 0]
        return found

    @property
    def _buffers(self) -> tuple[Buffer, ...]:
        return (self.firsts, self.members)
