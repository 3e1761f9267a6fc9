"""Squares of moments of slopes, of any level: from displacement of level 0, drawn on the device in
pieces as `maps.py` draws it, or given."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import numpy as np

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.methods import DISPLACEMENT
from rhytid.domain.tiles import MapAddress
from rhytid.engine import call_context
from rhytid.engine.assets.asset import Asset
from rhytid.engine.assets.on_device import DeviceAssets, Evicted
from rhytid.engine.device_assets.slopes import DeviceSlopes
from rhytid.engine.frames import Frame
from rhytid.engine.messages import MapQuery, Tile
from rhytid.engine.tiles.maps import MapDrawing
from rhytid.errors import ChangingError, DeviceMemoryError
from rhytid.pipeline.slopes import MOMENTS, SlopeWork, moments
from rhytid.pipeline.work import Square

# How often a square is made anew because settings change, or the asset is dropped, meanwhile.
_ATTEMPTS = 3
# Texels per side of what one task makes of level 0: a strip of a chart has as many rows or more.
_PIECE = 1024
# Sums (5, n, n) of moments over texels with a triangle, divided by all texels, and the share (n, n)
# of texels that have one.
_Sums = tuple[Tile, Tile]
T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class _Wanted:
    """A square of a level of a UDIM of a frame, with the settings that the asset has when it is
    asked for.  heights: (R, R) of level 0, where they are drawn already."""

    asset: Asset
    settings: AssetSettings
    frame: Frame
    query: MapQuery
    udim: int
    level: int
    square: Square
    heights: Tile | None = None

    @property
    def about(self) -> tuple[Frame, MapQuery, int]:
        """What its level 0 is drawn of."""
        return self.frame, self.query, self.udim


class SlopeDrawing:
    """Makes squares of moments."""

    def __init__(self, on_device: DeviceAssets, maps: MapDrawing) -> None:
        self._on_device, self._maps = on_device, maps
        self._whole, self._charting = threading.Lock(), threading.Lock()

    def square(
        self, asset: Asset, frame: Frame, query: MapQuery, udim: int, level: int, square: Square
    ) -> Tile:
        """(n, n, 5) moments of a square of a level, in the order of MOMENTS; 0 where no triangle
        is.

        The levels above level 0 of a UDIM are made at once and kept for the frames used last, level
        1 only where it is asked for. Raises what `MapDrawing.square` does.
        """
        query = replace(query, layer=DISPLACEMENT)
        return moments(
            *self._made(lambda: _Wanted(asset, asset.settings, frame, query, udim, level, square))
        )

    def of_heights(
        self, asset: Asset, frame: Frame, query: MapQuery, place: MapAddress, heights: Tile
    ) -> tuple[Tile, Tile]:
        """Moments (n, n, 5) of a whole level, and its coverage (n, n).  heights: (R, R) of level
        0."""

        def wanted() -> _Wanted:
            settings, level = asset.settings, place.level
            whole = (0, 0, settings.grid.side(level))
            return _Wanted(asset, settings, frame, query, place.udim, level, whole, heights)

        found = self._made(wanted)
        return moments(*found), found[1]

    def _made(self, wanted: Callable[[], _Wanted]) -> _Sums:
        """What is wanted, all of it with the same settings."""
        for _ in range(_ATTEMPTS):
            one = wanted()
            found = self._finest(one) if one.level == 0 else self._coarse(one)
            if found is not None and one.asset.settings is one.settings:
                return found
        raise ChangingError(f"the settings of asset {one.asset.id} change while its map is drawn")

    def _coarse(self, one: _Wanted) -> _Sums | None:
        """Of a square of level 1 or coarser. None where other settings than those that the heights
        are drawn with are in use now, or the chart was dropped."""

        def kept(slopes: DeviceSlopes) -> _Sums | None:
            return slopes.kept(*one.about, one.level, one.square)

        if (found := self._use(one, kept, patiently=False)) is not None:
            return found
        with _alone(self._whole):
            if (found := self._use(one, kept)) is not None:
                return found
            with self._work(one) as work:
                for row in range(0, work.side, work.rows):
                    self._fill(one, work, row)
                    self._ensure_chart(one)  # last, for what was drawn may have taken its memory
                    if not self._use(one, lambda slopes: slopes.add(work, one.frame, one.udim)):
                        return None

                def finished(slopes: DeviceSlopes) -> _Sums | None:
                    done = slopes.keep(work, *one.about, one.settings)
                    return kept(slopes) if done else None

                return self._use(one, finished)

    @contextmanager
    def _work(self, one: _Wanted) -> Iterator[SlopeWork]:
        """The levels of a UDIM while they are made; other tasks run meanwhile."""
        work = self._use(one, lambda slopes: slopes.begin(one.level))
        try:
            yield work
        finally:
            self._on_device.run_patiently(work.release)

    def _fill(self, one: _Wanted, work: SlopeWork, row: int) -> None:
        """Give the work its heights of a strip, a piece in a task."""
        rows = work.rows
        if one.heights is not None:
            part = one.heights[row : row + rows]
            self._use(one, lambda slopes: slopes.take(work, row, part))
            return
        levels = self._on_device.loaded(one.asset).levels
        for column in range(0, work.side, rows):
            for piece in levels.pieces(one.query, one.udim, 0, (row, column, rows)):
                self._put(one, work, piece)

    def _put(self, one: _Wanted, work: SlopeWork, piece: Square) -> None:
        call_context.check_abandoned()
        try:
            self._use(one, lambda slopes: slopes.put(work, *one.about, piece))
        except DeviceMemoryError:  # `maps` draws it in smaller ones
            heights = self._maps.shared(one.asset, *one.about, 0, piece)
            self._use(one, lambda slopes: slopes.put_drawn(work, piece, heights))

    def _finest(self, one: _Wanted) -> _Sums | None:
        """Of a square of level 0, in pieces; a texel without a triangle counts as covered, with
        moments of 0."""
        row, column, side = one.square
        around = self._around(one) if one.heights is None else np.pad(one.heights, 1)
        self._ensure_chart(one)
        out, piece = np.empty((len(MOMENTS), side, side), np.float32), min(side, _PIECE)
        for y in range(0, side, piece):
            for x in range(0, side, piece):
                near = around[y : y + piece + 2, x : x + piece + 2]
                place = (row + y, column + x, piece)
                found = self._use(one, partial(_finest_piece, one, near, place))
                if found is None:
                    return None
                out[:, y : y + piece, x : x + piece] = found
        return out, np.ones((side, side), np.float32)

    def _around(self, one: _Wanted) -> Tile:
        """(n + 2, n + 2) heights of a square of level 0 and around it, 0 outside of the map."""
        row, column, side = one.square
        whole, tile = one.settings.resolution, one.settings.grid.texels(0)
        out = np.zeros((side + 2, side + 2), np.float32)
        for y in range(max(row - tile, 0), min(row + side + tile, whole), tile):
            for x in range(max(column - tile, 0), min(column + side + tile, whole), tile):
                heights = self._maps.shared(one.asset, *one.about, 0, (y, x, tile))
                _place(out, heights, y - row + 1, x - column + 1)
        return out

    def _ensure_chart(self, one: _Wanted) -> None:
        """Have what does not change with the frame on the device, made in steps, unless the asset
        is dropped or its settings change meanwhile."""

        def has(slopes: DeviceSlopes) -> bool:
            return slopes.has_chart(one.udim)

        if not self._use(one, has):
            with _alone(self._charting):
                if not self._use(one, has):
                    with suppress(Evicted), self._on_device.stepwise(one.asset) as resident:
                        resident.slopes.make_chart(one.udim)

    def _use(self, one: _Wanted, task: Callable[[DeviceSlopes], T], *, patiently: bool = True) -> T:
        """Run a task of the device with the slopes of the asset."""
        return self._on_device.use(
            one.asset, lambda resident: task(resident.slopes), patiently=patiently
        )


@contextmanager
def _alone(lock: threading.Lock) -> Iterator[None]:
    """What takes the memory of large levels, up to 2 GiB, is made by one caller at a time; who
    waits may find it made afterwards. Raises CancelledError where the caller is gone."""
    while not lock.acquire(timeout=call_context.LOOK):
        call_context.check_abandoned()
    try:
        yield
    finally:
        lock.release()


def _finest_piece(one: _Wanted, around: Tile, place: Square, slopes: DeviceSlopes) -> Tile | None:
    return slopes.finest(one.frame, one.udim, around, place)


def _place(out: Tile, heights: Tile, row: int, column: int) -> None:
    """Copy what of a tile that begins at (row, column) lies in `out`."""
    side, tile = len(out), len(heights)
    rows = slice(max(row, 0), min(row + tile, side))
    columns = slice(max(column, 0), min(column + tile, side))
    out[rows, columns] = heights[
        rows.start - row : rows.stop - row, columns.start - column : columns.stop - column
    ]
