"""The residual of scanned skin on the device, added to what any method draws.
Kernel: residual.cl.

It is the same in every frame: see docs/scan.md for what was measured of gains that follow stretch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rhytid.device.buffer import Buffer, BufferGroup
from rhytid.device.runtime import Device
from rhytid.domain.residual import Residual
from rhytid.pipeline.vectors import VECTOR
from rhytid.pipeline.work import Square

# That residual.cl takes.
SQUARES_A_LAUNCH = 4


@dataclass(frozen=True)
class ResidualMap(BufferGroup):
    """The residual of a UDIM.

    codes: int16 of each texel.  side: texels per side.  step, middle: of a code and of code 0, mesh
    units.
    """

    codes: Buffer
    side: int
    step: float
    middle: float

    @property
    def _buffers(self) -> tuple[Buffer, ...]:
        return (self.codes,)

    @classmethod
    def upload(cls, device: Device, residual: Residual, udim: int) -> ResidualMap:
        """The map of a UDIM, on the device."""
        codes = residual.codes[udim]
        return cls(device.upload(codes), len(codes), *residual.steps[udim])

    def add(self, device: Device, outs: Sequence[Buffer], squares: Sequence[Square]) -> None:
        """Add it to squares (row, column, texels per side) of level 0, all of one side, which is a
        multiple of VECTOR.

        outs: of each side² float32, mesh units; more may follow.
        """
        for first in range(0, len(outs), SQUARES_A_LAUNCH):
            some = slice(first, first + SQUARES_A_LAUNCH)
            self._add(device, outs[some], squares[some])

    def _add(self, device: Device, outs: Sequence[Buffer], squares: Sequence[Square]) -> None:
        """Add it to SQUARES_A_LAUNCH squares at most."""
        side, none = squares[0][2], SQUARES_A_LAUNCH - len(outs)  # which no work-item looks at
        firsts = [row * self.side + column for row, column, _ in squares] + none * [0]
        device.launch(
            "residual", "add_residual", (side // VECTOR, side, len(outs)),
            self.codes, np.int32(self.side), np.array(firsts, np.int32), np.float32(self.step),
            np.float32(self.middle), np.int32(side), *outs, *none * [outs[0]],
        )  # fmt: skip
