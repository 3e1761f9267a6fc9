"""Moments of slopes of an asset on the device: what does not change with the frame, and levels of
the frames used last, under the memory budget. Level 0 is a square at a time and is not kept.

Of a frame that is 7 bytes for each texel of level 0, of a UDIM 3 bytes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.tiles import udim_origin
from rhytid.engine.device_assets.mesh import DeviceMesh
from rhytid.engine.frames import Frame
from rhytid.engine.messages import MapQuery, Tile
from rhytid.exports.textures.slope_terms import neighbour_codes
from rhytid.pipeline.slopes import SlopeChart, SlopeLevels, SlopeStage
from rhytid.pipeline.work import Square

# Terms of the triangles of a frame, for `slopes.cl`.
Terms = NDArray[np.float32]
T = TypeVar("T")


class DeviceSlopes:
    """Moments of slopes of squares of any level. Every method runs in a task of the device unless
    it says otherwise."""

    def __init__(self, base: DeviceMesh) -> None:
        self._base, self._stage = base, SlopeStage(base.device)

    def has_chart(self, udim: int) -> bool:
        """Whether the chart of a UDIM is there."""
        return self._base.cache.find("slope chart", udim) is not None

    def codes(self, udim: int, triangles: NDArray[np.int32]) -> NDArray[np.uint8]:
        """The codes of a UDIM. Work of the host, for any thread."""
        return neighbour_codes(self._base.mesh, udim, triangles)

    def take_chart(
        self, udim: int, triangles: NDArray[np.int32], codes: NDArray[np.uint8]
    ) -> SlopeChart:
        """Keep the chart of a UDIM.  triangles, codes: (R, R) of its texels."""
        return self._base.cache.keep(
            "slope chart", udim,
            make=lambda: SlopeChart.of(self._base.device, triangles, codes, udim_origin(udim)),
        )  # fmt: skip

    def kept(
        self, frame: Frame, query: MapQuery, udim: int, level: int, square: Square
    ) -> tuple[Tile, Tile] | None:
        """Sums (5, n, n) of a square of level 1 or coarser, and its coverage (n, n); None where
        they are not kept."""
        levels: SlopeLevels | None = self._base.cache.find_of(frame, *_key(query, udim))
        chart: SlopeChart | None = self._base.cache.find("slope chart", udim)
        if levels is None or chart is None:
            return None
        side = chart.side >> level
        read = self._base.device.read_square
        sums = [read(plane.buffers[level - 1], side, *square) for plane in levels.planes]
        return np.stack(sums), read(chart.coverage.buffers[level - 1], side, *square)

    def make(
        self, frame: Frame, query: MapQuery, udim: int, terms: Terms, heights: Tile,
        settings: AssetSettings,
    ) -> SlopeLevels | None:  # fmt: skip
        """Keep the levels of a frame.  heights: (R, R) of its level 0, drawn with `settings`. None
        where these are not the present ones, or the chart is not there any more."""
        chart: SlopeChart | None = self._base.cache.find("slope chart", udim)
        if chart is None or self._base.settings is not settings:
            return None
        found: SlopeLevels = self._base.cache.keep_of(
            frame, *_key(query, udim),
            make=lambda: self._with(terms, lambda held: self._stage.levels(chart, held, heights)),
        )  # fmt: skip
        return found

    def finest(self, udim: int, terms: Terms, around: Tile, square: Square) -> Tile | None:
        """(5, n, n) moments of a square of level 0, a tile.  around: (n + 2, n + 2) heights of it
        and of what is around it. None where the chart is not there any more."""
        chart: SlopeChart | None = self._base.cache.find("slope chart", udim)
        if chart is None:
            return None
        row, column, _ = square
        return self._with(terms, lambda held: self._stage.finest(chart, held, around, row, column))

    def _with(self, terms: Terms, make: Callable[[Buffer], T]) -> T:
        held = self._base.device.upload(terms)
        try:
            return make(held)
        finally:
            held.release()


def _key(query: MapQuery, udim: int) -> tuple[str | int, ...]:
    return ("slopes", query.method, query.stretch, query.sampling, udim)
