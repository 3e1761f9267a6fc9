"""The broad layer of the wrinkles of one UDIM, which swells the skin: their boxes and arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.pipeline.bends import Bends
from rhytid.pipeline.cushion_elements import (
    APRON,
    LEAST_HALF_WIDTH,
    CushionArrays,
    broad_weight,
    coarse_factor,
    cushion_lists,
)
from rhytid.pipeline.draw_limit import DrawLimit
from rhytid.pipeline.reach import around_wrinkles, limit_cover, sizes_of_ends


@dataclass(frozen=True)
class BroadLayer:
    """The broad layer of every wrinkle of the graph. weights: (M, 1), or (M, 2) where there are
    bends, at both ends; 0 where it swells nothing. low, high: (M, 2) corners of the boxes around
    what is drawn of it at any stretch."""

    graph: WrinkleGraph
    settings: AssetSettings
    bends: Bends | None
    factor: int
    weights: NDArray[np.float32]
    low: NDArray[np.floating]
    high: NDArray[np.floating]

    @classmethod
    def of(
        cls,
        graph: WrinkleGraph,
        ends: NDArray[np.float32],
        settings: AssetSettings,
        bends: Bends | None,
        waves: NDArray[np.float32] | None = None,
    ) -> BroadLayer | None:
        """None where no cushion is wanted."""
        if settings.shape.cushion == 0.0:
            return None
        factor = coarse_factor(graph, settings)
        least = LEAST_HALF_WIDTH * factor / settings.resolution
        broader = settings.shape.cushion_width
        low, high = around_wrinkles(graph, ends, settings, bends, waves, broader, least)
        weights = broad_weight(sizes_of_ends(graph, bends)[1], settings.shape)
        return cls(graph, settings, bends, factor, weights, low, high)

    @property
    def swells(self) -> NDArray[np.bool_]:
        """(M,) whether there is anything of a wrinkle in the layer."""
        found: NDArray[np.bool_] = self.weights.max(axis=1) > 0
        return found

    def reach(
        self, low: NDArray[np.floating], high: NDArray[np.floating]
    ) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
        """Boxes of both layers, with what the spline reads of the broad one beyond a border."""
        swells = self.swells[:, None]
        margin = (APRON + 1) * self.factor / self.settings.resolution
        return (
            np.where(swells, np.minimum(self.low - margin, low), low),
            np.where(swells, np.maximum(self.high + margin, high), high),
        )

    def check(
        self,
        inside: NDArray[np.integer] | NDArray[np.bool_],
        udim: int,
        limit: DrawLimit | None = None,
    ) -> None:
        """Raise LimitError where those of these indices cover too much, or take longer than
        `limit` to draw."""
        texels = self.settings.resolution // self.factor
        low, high = self.low[inside], self.high[inside]
        limit_cover(low, high, texels, "cushions", udim, self.factor)
        if limit is not None:
            limit.check(low, high, texels, "cushion", udim)

    def arrays(self, chosen: NDArray[np.int64], drawn: int, udim: int) -> CushionArrays:
        """Those of the wrinkles with these indices, of which the first `drawn` are listed."""
        listed = chosen[:drawn]
        swells, low, high = self.swells[listed], self.low[listed], self.high[listed]
        self.check(listed[swells], udim)
        nowhere = np.where(swells, 0.0, np.inf)[:, None]  # a box that is in no block
        texels = self.settings.resolution / self.factor * self.settings.shape.cushion_width
        widths = sizes_of_ends(self.graph, self.bends)[0][chosen] * np.float32(texels)
        lists = cushion_lists(low + nowhere, high - nowhere, self.settings, self.factor)
        sizes = np.concatenate([widths, self.weights[chosen]], axis=1)
        return CushionArrays(self.factor, sizes, lists)
