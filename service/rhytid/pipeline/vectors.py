"""The triangles under the texels of each vector of a tile. Kernel: vectors.cl.

Texture coordinates never move, so this is found once per tile; a frame then blends each vector once
for each of its triangles.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer, BufferGroup
from rhytid.device.programs import NO_DEFINES
from rhytid.device.runtime import Device

# Texels that kernels take at once, WIDTH of vectors.clh: the smallest levels are padded to it.
VECTOR = 16
# About what the triangles of a map take where they are many texels wide: it was 4.7 on a real face
# at 256² texels, 2.0 at 1024², 1.4 at 2048² and 1.1 at 4096².
BYTES_A_TEXEL = 1


def squares(side: int) -> dict[str, object]:
    """The defines with which the vectors of a map of `side` texels per row, a multiple of 4, are
    squares of four rows."""
    return {"SQUARES": side}


def in_rows(vectors: NDArray[np.integer], side: int) -> NDArray[np.integer]:
    """(side, side) rows of a map from its vectors (side²/VECTOR, VECTOR), which are squares."""
    found: NDArray[np.integer] = vectors.reshape(side // 4, side // 4, 4, 4).swapaxes(1, 2)
    return found.reshape(side, side)


@dataclass(frozen=True)
class VectorTriangles(BufferGroup):
    """The triangles under the texels of V vectors, on the device.

    firsts (V + 1,) int32: where the members of each vector begin.  members (K, 2) int32: a triangle
    and, as bits, the texels of the vector that lie in it.
    """

    firsts: Buffer
    members: Buffer

    @classmethod
    def of(
        cls,
        device: Device,
        triangles: Buffer,
        texels: int,
        defines: Mapping[str, object] = NO_DEFINES,
    ) -> VectorTriangles:
        """From the triangles, int32, of `texels` texels, a multiple of VECTOR.

        defines: those of `squares` where vectors are squares, none where they are of a row.
        """
        count = texels // VECTOR
        counts = device.empty(count, np.int32)
        device.launch("vectors", "count_triangles", (count,), triangles, counts, defines=defines)
        ends = np.cumsum(device.read(counts, (count,), np.int32), dtype=np.int32)
        counts.release()
        found = cls(
            device.upload(np.append(np.int32(0), ends)), device.empty(2 * int(ends[-1]), np.int32)
        )
        device.launch(
            "vectors", "list_triangles", (count,), triangles, found.firsts, found.members,
            defines=defines,
        )  # fmt: skip
        return found

    @property
    def _buffers(self) -> tuple[Buffer, ...]:
        return (self.firsts, self.members)
