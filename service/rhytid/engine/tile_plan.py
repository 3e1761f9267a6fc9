"""A tile or a map that is named and not drawn yet."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.formats.tile_header import TileHeader

Tile = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class TilePlan:
    """A tile or a map that is named and not drawn yet.

    key: names its content; two plans with the same key draw the same bytes.  header: what a file of
    it says of itself.  draw: its displacement (n, n) float32, mesh units, row 0 at the top; raises
    BusyError where too many wait for the device.  side: n.  key_now: after `draw`, the key that the
    same address had when it was drawn; None where that takes planning again.
    """

    key: str
    header: TileHeader
    side: int
    draw: Callable[[], Tile]
    key_now: Callable[[], str] | None = None

    @property
    def nbytes(self) -> int:
        """Of its displacement."""
        return 4 * self.side**2
