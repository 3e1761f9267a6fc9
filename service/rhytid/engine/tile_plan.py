"""A tile or a map that is named and not drawn yet."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.engine.messages import TileDescription
from rhytid.formats.tile_header import TileHeader

Tile = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class TilePlan:
    """A tile or a map that is named and not drawn yet.

    draw: its displacement (n, n) float32, mesh units, row 0 at the top; raises BusyError where too
    many wait for the device.
    """

    description: TileDescription
    draw: Callable[[], Tile]

    @property
    def key(self) -> str:
        """As of `TileDescription`."""
        return self.description.key

    @property
    def header(self) -> TileHeader:
        """As of `TileDescription`."""
        return self.description.header

    @property
    def side(self) -> int:
        """As of `TileDescription`."""
        return self.description.side
