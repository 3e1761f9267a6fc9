"""The residual of scanned skin on the device, added to what any method draws.
Kernel: residual.cl.

It is the same in every frame: see docs/scan.md for what was measured of gains that follow stretch.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rhytid.device.buffer import Buffer, BufferGroup
from rhytid.device.runtime import Device
from rhytid.domain.residual import Residual
from rhytid.pipeline.vectors import VECTOR
from rhytid.pipeline.work import Square


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

    def add(self, device: Device, out: Buffer, square: Square) -> None:
        """Add it to a square (row, column, texels per side) of level 0, whose side is a multiple of
        VECTOR.

        out: side² float32, mesh units; more may follow.
        """
        row, column, side = square
        device.launch(
            "residual", "add_residual", (side // VECTOR, side),
            self.codes, np.int32(self.side), np.int32(row * self.side + column),
            np.float32(self.step), np.float32(self.middle), np.int32(side), out,
        )  # fmt: skip
