"""Which wrinkles swell the skin between them, how broadly, and at which resolution: found once per
asset.

The same wrinkles are drawn a second time, broad and soft, so that the skin between furrows swells.
That layer is smooth: it is drawn coarse (cushion.py) and upsampled by a cubic B-spline.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.asset_settings import CUSHION_THRESHOLD, AssetSettings, ShapeSettings
from rhytid.domain.graph import ORIGINAL, WrinkleGraph
from rhytid.pipeline.cells import CellLists, list_by_cell
from rhytid.pipeline.reach import Bends, Box, around_wrinkles, limit_cover, sizes_of_ends
from rhytid.pipeline.work import DrawLimit, work_by_cell

# Coarse texels per side of a block of the layer, and around it what the spline reads of others.
COARSE_BLOCK, APRON = 64, 2
THRESHOLD = CUSHION_THRESHOLD
# Coarse texels: a line that is narrower is drawn so wide, and shallower, so that its mean stays.
LEAST_HALF_WIDTH = 1.25
# Coarse texels squared: what is taken from the square of a half width, for the spline widens lines.
WIDENED = 1.5
# Coarse texels in the median half width, at least, where the layer is drawn at less than a half.
CARRIED = 1.5
# The spline changes lines the more the fewer samples they have. Where a line is narrower in the UV
# of one side of a seam its half width there has as much more than CARRIED, up to so many times.
UNEVEN = 1.6
FACTORS = (16, 8, 4, 2)


@dataclass(frozen=True)
class CushionArrays:
    """The broad layer of a UDIM's wrinkles.

    factor: texels of the map per coarse texel.  sizes: of every wrinkle, as in WrinkleArrays, but
    of the broad layer, with half widths in coarse texels.  lists: by block of the coarse map, of
    the wrinkles that swell the skin.
    """

    factor: int
    sizes: NDArray[np.float32]
    lists: CellLists


@dataclass(frozen=True)
class BroadLayer:
    """The broad layer of every wrinkle of a graph.

    factor: texels of the map per coarse texel.  weights: (M, 1), or (M, 2) at both ends where there
    are bends; 0 where a wrinkle swells nothing.  low, high: (M, 2) corners of the boxes that the
    layer of each wrinkle stays in at any stretch.
    """

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
        lines: Box,
        settings: AssetSettings,
        bends: Bends | None,
        waves: NDArray[np.float32] | None = None,
    ) -> BroadLayer | None:
        """The broad layer of a graph, `lines` as in `around_wrinkles`; None where the settings have
        no cushion."""
        if settings.shape.cushion == 0.0:
            return None
        factor = coarse_factor(graph, settings)
        least = LEAST_HALF_WIDTH * factor / settings.resolution
        broader = settings.shape.cushion_width
        low, high = around_wrinkles(graph, lines, settings, bends, waves, broader, least)
        weights = broad_weight(sizes_of_ends(graph, bends)[1], settings.shape)
        return cls(graph, settings, bends, factor, weights, low, high)

    @cached_property
    def swells(self) -> NDArray[np.bool_]:
        """(M,) whether each wrinkle has a weight in the layer."""
        found: NDArray[np.bool_] = np.maximum.reduce(list(self.weights.T)) > 0
        return found

    def reach(
        self, low: NDArray[np.floating], high: NDArray[np.floating]
    ) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
        """Boxes (M, 2), (M, 2) around both layers, from those of the narrow one; with what the
        spline reads of the broad one beyond a border."""
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
        """Raise LimitError where the wrinkles `inside` cover too much, or take longer than `limit`
        to draw."""
        texels = self.settings.resolution // self.factor
        low, high = self.low[inside], self.high[inside]
        limit_cover(low, high, texels, "cushions", udim, self.factor)
        if limit is not None:
            limit.check(low, high, texels, "cushion", udim)

    def arrays(self, chosen: NDArray[np.int64], drawn: int, udim: int) -> CushionArrays:
        """The arrays of the wrinkles `chosen`, of which the first `drawn` are in the lists."""
        listed = chosen[:drawn]
        swells, low, high = self.swells[listed], self.low[listed], self.high[listed]
        self.check(listed[swells], udim)
        nowhere = np.where(swells, 0.0, np.inf)[:, None]  # a box that is in no block
        texels = self.settings.resolution / self.factor * self.settings.shape.cushion_width
        widths = sizes_of_ends(self.graph, self.bends)[0][chosen] * np.float32(texels)
        lists = cushion_lists(low + nowhere, high - nowhere, self.settings, self.factor)
        sizes = np.concatenate([widths, self.weights[chosen]], axis=1)
        return CushionArrays(self.factor, sizes, lists)


def broad_weight(weight: NDArray[np.float32], shape: ShapeSettings) -> NDArray[np.float32]:
    """Strength in the broad layer: the share `cushion`, fading out where lines are weak."""
    fade = np.clip(weight / np.float32(THRESHOLD) - np.float32(1), 0, 1).astype(np.float32)
    broad: NDArray[np.float32] = np.float32(shape.cushion) * weight * fade
    return broad


def narrow_weight(weight: NDArray[np.float32], shape: ShapeSettings) -> NDArray[np.float32]:
    """Strength in the narrow layer: the rest of the share, of weak lines too."""
    return weight if shape.cushion == 0.0 else np.float32(1.0 - shape.cushion) * weight


def coarse_factor(graph: WrinkleGraph, settings: AssetSettings) -> int:
    """The coarsest of FACTORS that carries the broad half widths, 2 where none does. The coarse
    grid is the same at every resolution at which one does."""
    width = _width_to_carry(graph)
    if width is None:
        return FACTORS[-1]
    texels = width * settings.resolution * settings.shape.cushion_width
    most = min(texels / CARRIED, settings.resolution / COARSE_BLOCK)
    return next((factor for factor in FACTORS if factor <= most), FACTORS[-1])


def _width_to_carry(graph: WrinkleGraph) -> float | None:
    """The median half width in UV of the lines that swell the skin, None where none does. It is
    less, by a half at most, where lines at UV seams are narrower in the UV of one side than of the
    other."""
    swells = graph.edge_weight > THRESHOLD
    if not swells.any():
        return None
    median = _median(graph.edge_half_width[swells])
    if graph.edge_copy_of is None:
        return median
    copies = np.flatnonzero(swells & (graph.edge_copy_of != ORIGINAL))
    if not copies.size:
        return median
    rows = np.stack([copies, graph.edge_copy_of[copies]])
    narrow, wide = np.sort(graph.edge_half_width[rows].astype(np.float64), axis=0)
    at_seams = _median(narrow / np.minimum(wide / narrow, UNEVEN))
    return min(max(at_seams, 0.5 * median), median)


def _median(values: NDArray[np.floating]) -> float:
    """As np.median, which imports numpy.ma: a twelfth of the first load of an asset."""
    middle = [(len(values) - 1) // 2, len(values) // 2]
    return float(np.partition(values, middle)[middle].mean())


def cushion_lists(
    low: NDArray[np.floating], high: NDArray[np.floating], settings: AssetSettings, factor: int
) -> CellLists:
    """The lists by coarse block of boxes (K, 2) in UV, for blocks with their aprons."""
    texel = factor / settings.resolution
    margin = (APRON + 1) * texel
    cells = settings.resolution // (factor * COARSE_BLOCK)
    lists = list_by_cell(low - margin, high + margin, cells, top_down=True)
    return replace(lists, work=work_by_cell(lists, low, high))
