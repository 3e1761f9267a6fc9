"""What profiles draw from, and the attributes of their files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.formats.tile_header import TileHeader
from rhytid.textures.chart import Chart
from rhytid.textures.padding import Padding
from rhytid.textures.tangents import Posed

Facts = dict[str, str | int | float]
# The values are data, not colours: the attribute of OpenEXR, and in plain words.
_RAW: Facts = {"colour_space": "raw", "colorInteropID": "data"}


@dataclass(frozen=True, eq=False)
class FrameMap:
    """One UDIM of one frame. What takes long is a call, which computes it once.

    header: of the map.  depth: of a furrow of strength 1, mesh units.  heights: (R, R) float32
    displacement, mesh units, row 0 at the top.  padding: what its texels next to islands show.
    chart: its texels on the mesh.  posed: the surface of the frame.  weights: (F, 3, 2) of corners,
    stretch and compression.
    """

    header: TileHeader
    depth: float
    heights: Callable[[], NDArray[np.float32]]
    padding: Callable[[], Padding]
    chart: Callable[[], Chart]
    posed: Callable[[], Posed]
    weights: Callable[[], NDArray[np.float64]]

    def bordered(self) -> NDArray[np.float32]:
        """The displacement, within the padding that of the nearest texel inside."""
        return self.padding().padded(self.heights())

    def padded(self) -> NDArray[np.float32]:
        """The displacement, outside of the islands that of the nearest texel inside."""
        return self.chart().padded(self.heights())


def attributes(header: TileHeader, facts: Facts, values: NDArray[Any]) -> Facts:
    """The attributes written beside the texels.

    facts: of the profile, `scale` among them.  values: what the texels stand for; their `minimum`
    and `maximum` are attributes.
    """
    ends = {"minimum": float(values.min()), "maximum": float(values.max())}
    return {**header.attributes(), **facts, **ends, **_RAW}
