"""Painted maps at points of the surface."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.painted_maps import Map, Shares, bilinear, shares
from rhytid.domain.tiles import udim_origin
from rhytid.synthesis.arrays import row_blocks
from rhytid.synthesis.surface import FloatArray, Surface

_MIDDLE = 0.5
# A point on the border of two UDIMs belongs to that of its triangle: so far it is pulled inwards.
_PULL = 1e-4


class Lookup:
    """The maps of one control by UDIM.

    least, most: of all values, those of UDIMs without a map too.  detail: the UV length of the
    smallest texel.  meaning: of texels, shares unless it is given; maps stay as they are, for in
    float32 they may take four times the memory.
    """

    def __init__(
        self,
        surface: Surface,
        maps: Mapping[int, Map],
        meaning: Callable[[Map], Shares] = shares,
    ) -> None:
        self._maps, self._meaning = maps, meaning
        self._centres = surface.uv.mean(axis=1)
        values = [float(shares(f(map))) for map in maps.values() for f in (np.min, np.max)]
        self.least, self.most = min([_MIDDLE, *values]), max([_MIDDLE, *values])
        self.detail = min((1.0 / max(map.shape) for map in maps.values()), default=float("inf"))

    def at(self, triangle: NDArray[Any], uv: NDArray[Any], neutral: float = _MIDDLE) -> Shares:
        """(N,) at uv (N, 2) in their triangles; `neutral` where the UDIM has no map."""
        found = np.full(len(triangle), neutral, np.float32)
        for rows in row_blocks(len(triangle)):
            corner = self._corners(triangle[rows], uv[rows])
            for udim, map in self._maps.items():
                there = np.flatnonzero((corner == udim_origin(udim)).all(axis=1))
                local = uv[rows][there].astype(np.float64) - udim_origin(udim)
                found[rows.start + there] = bilinear(map, local, self._meaning)
        return found

    def _corners(self, triangle: NDArray[Any], uv: NDArray[Any]) -> FloatArray:
        """(N, 2) origins of the UDIMs of points."""
        corner: FloatArray = np.floor(uv + _PULL * (self._centres[triangle] - uv))
        return corner
