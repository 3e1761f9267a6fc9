"""How maps are cut into pages so that every WebGL2 takes them, and their levels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.errors import LimitError
from rhytid.support import cancellation

# What every WebGL2 has at least: texels a side, and layers of an array.
MOST_SIDE, MOST_LAYERS = 2048, 256
Codes = NDArray[np.integer]


@dataclass(frozen=True)
class Paging:
    """Squares of `size` texels a side that maps of `resolution` texels a side are cut into."""

    resolution: int
    size: int

    @classmethod
    def of(cls, resolution: int, maps: int) -> Paging:
        """Raises LimitError where so many maps need more layers than WebGL2 has."""
        paging = cls(resolution, min(resolution, MOST_SIDE))
        layers = paging.count * maps
        if layers > MOST_LAYERS:
            raise LimitError(
                f"{maps} maps of {resolution} texels a side are {layers} layers of {paging.size}; "
                f"WebGL2 has {MOST_LAYERS}: a lower resolution, or fewer bins or samples, fit"
            )
        return paging

    @property
    def across(self) -> int:
        """Pages a row."""
        return self.resolution // self.size

    @property
    def count(self) -> int:
        """All pages."""
        return self.across**2

    def cut(self, maps: Codes) -> Codes:
        """(pages * K, size, size) from maps (K, R, R): page by page, row by row."""
        n, size = self.across, self.size
        cut = maps.reshape(len(maps), n, size, n, size).transpose(1, 3, 0, 2, 4)
        pages: Codes = cut.reshape(-1, size, size)
        return pages


def pyramid(maps: Codes, count: int) -> list[Codes]:
    """(K, n, n) and `count` - 1 coarser levels, each the means of 2 x 2 texels of the level before
    it was rounded."""
    k, side = maps.shape[:2]
    levels = [maps, *(np.empty((k, side >> n, side >> n), maps.dtype) for n in range(1, count))]
    for i, finest in enumerate(cancellation.check_each(maps)):
        means = finest.astype(np.float32)
        for level in levels[1:]:
            half = len(means) // 2
            means = means.reshape(half, 2, half, 2).mean(axis=(1, 3))
            level[i] = np.rint(means)
    return levels
