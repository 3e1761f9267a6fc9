"""Squares of moments of slopes, of any level: from displacement of level 0 as `maps.py` draws
it."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.tiles import MapAddress
from rhytid.engine import call_context
from rhytid.engine.assets.asset import Asset
from rhytid.engine.assets.on_device import DeviceAssets
from rhytid.engine.device_assets.asset import DeviceAsset
from rhytid.engine.device_assets.slopes import Terms
from rhytid.engine.frames import Frame
from rhytid.engine.messages import DISPLACEMENT, MapQuery, Tile
from rhytid.engine.tiles.maps import MapDrawing
from rhytid.errors import ChangingError
from rhytid.exports.textures.slope_terms import slope_terms
from rhytid.exports.textures.tangents import Posed
from rhytid.pipeline.slopes import MOMENTS, moments
from rhytid.pipeline.work import Square

# How often a square is made anew because settings change, or the asset is dropped, meanwhile.
_ATTEMPTS = 3
# Texels per side of what one task makes of level 0: a strip of a chart has as many rows or more.
_PIECE = 1024
# Sums (5, n, n) of moments over texels with a triangle, divided by all texels, and the share (n, n)
# of texels that have one.
_Sums = tuple[Tile, Tile]


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

        The levels above level 0 of a UDIM are made at once and kept for the frames used last.
        Raises what `MapDrawing.square` does.
        """
        query = replace(query, layer=DISPLACEMENT)
        for _ in range(_ATTEMPTS):
            settings = asset.settings
            found = self._made(asset, settings, frame, query, udim, level, square)
            if found is not None and asset.settings is settings:
                return moments(*found)
        raise ChangingError(f"the settings of asset {asset.id} change while its map is drawn")

    def of_heights(
        self,
        asset: Asset,
        frame: Frame,
        query: MapQuery,
        place: MapAddress,
        heights: Tile,
        terms: Terms,
    ) -> tuple[Tile, Tile]:
        """Moments (n, n, 5) of a whole level, and its coverage (n, n).  heights: (R, R) of level 0.
        terms: of the triangles of the frame."""
        settings = asset.settings
        whole = (0, 0, settings.grid.side(place.level))
        for _ in range(_ATTEMPTS):
            if place.level == 0:
                around = np.pad(heights, 1)
                found = self._finest(asset, place.udim, terms, around, whole)
            else:
                found = self._coarse(
                    asset, settings, frame, query, place.udim, heights, terms, place.level, whole
                )
            if found is not None:
                return moments(*found), found[1]
        raise ChangingError(f"the settings of asset {asset.id} change while its map is drawn")

    def _made(
        self,
        asset: Asset,
        settings: AssetSettings,
        frame: Frame,
        query: MapQuery,
        udim: int,
        level: int,
        square: Square,
    ) -> _Sums | None:
        if level == 0:
            around = self._around(asset, frame, query, udim, square)
            return self._finest(asset, udim, self._terms(asset, frame), around, square)

        def kept(resident: DeviceAsset) -> _Sums | None:
            return resident.slopes.kept(frame, query, udim, level, square)

        found: _Sums | None = self._on_device.use(asset, kept)
        if found is not None:
            return found
        with _alone(self._whole):
            if (found := self._on_device.use(asset, kept, patiently=True)) is not None:
                return found
            whole = (0, 0, settings.resolution)
            heights = self._maps.shared(asset, frame, query, udim, 0, whole)
            terms = self._terms(asset, frame)
            return self._coarse(asset, settings, frame, query, udim, heights, terms, level, square)

    def _coarse(
        self,
        asset: Asset,
        settings: AssetSettings,
        frame: Frame,
        query: MapQuery,
        udim: int,
        heights: Tile,
        terms: Terms,
        level: int,
        square: Square,
    ) -> _Sums | None:
        """Of a square of level 1 or coarser. None where other settings than those that the heights
        are drawn with are in use now."""
        self._ensure_chart(asset, udim)

        def make(resident: DeviceAsset) -> _Sums | None:
            if resident.slopes.make(frame, query, udim, terms, heights, settings) is None:
                return None
            return resident.slopes.kept(frame, query, udim, level, square)

        found: _Sums | None = self._on_device.use(asset, make, patiently=True)
        return found

    def _finest(
        self, asset: Asset, udim: int, terms: Terms, around: Tile, square: Square
    ) -> _Sums | None:
        """Of a square of level 0, in pieces; a texel without a triangle counts as covered, with
        moments of 0.  around: (n + 2, n + 2) heights of it and of what is around it."""
        row, column, side = square
        self._ensure_chart(asset, udim)
        out, piece = np.empty((len(MOMENTS), side, side), np.float32), min(side, _PIECE)
        for y in range(0, side, piece):
            for x in range(0, side, piece):
                near = around[y : y + piece + 2, x : x + piece + 2]
                place = (row + y, column + x, piece)
                task = partial(_finest_piece, udim, terms, near, place)
                found = self._on_device.use(asset, task, patiently=True)
                if found is None:
                    return None
                out[:, y : y + piece, x : x + piece] = found
        return out, np.ones((side, side), np.float32)

    def _around(
        self, asset: Asset, frame: Frame, query: MapQuery, udim: int, square: Square
    ) -> Tile:
        """(n + 2, n + 2) heights of a square of level 0 and around it, 0 outside of the map."""
        row, column, side = square
        whole, tile = asset.settings.resolution, asset.settings.grid.texels(0)
        out = np.zeros((side + 2, side + 2), np.float32)
        for y in range(max(row - tile, 0), min(row + side + tile, whole), tile):
            for x in range(max(column - tile, 0), min(column + side + tile, whole), tile):
                heights = self._maps.shared(asset, frame, query, udim, 0, (y, x, tile))
                _place(out, heights, y - row + 1, x - column + 1)
        return out

    def _terms(self, asset: Asset, frame: Frame) -> Terms:
        mesh = self._on_device.loaded(asset).mesh.mesh
        positions = mesh.positions if frame.positions is None else frame.positions
        return slope_terms(mesh, Posed.of(mesh, positions), asset.settings.resolution)

    def _ensure_chart(self, asset: Asset, udim: int) -> None:
        """Have what does not change with the frame on the device. Host work is done here."""

        def has(resident: DeviceAsset) -> bool:
            return resident.slopes.has_chart(udim)

        if not self._on_device.use(asset, has, patiently=True):
            with _alone(self._charting):
                if not self._on_device.use(asset, has, patiently=True):
                    self._make_chart(asset, udim)

    def _make_chart(self, asset: Asset, udim: int) -> None:
        def read(resident: DeviceAsset) -> NDArray[np.int32]:
            return resident.mesh.texel_triangles(udim)

        triangles = self._on_device.use(asset, read, patiently=True)
        codes = self._on_device.loaded(asset).slopes.codes(udim, triangles)

        def take(resident: DeviceAsset) -> None:
            resident.slopes.take_chart(udim, triangles, codes)

        self._on_device.use(asset, take, patiently=True)


@contextmanager
def _alone(lock: threading.Lock) -> Iterator[None]:
    """What takes the memory of a whole level 0, up to 1 GiB, is made by one caller at a time; who
    waits may find it made afterwards. Raises CancelledError where the caller is gone."""
    while not lock.acquire(timeout=call_context.LOOK):
        call_context.check_abandoned()
    try:
        yield
    finally:
        lock.release()


def _finest_piece(
    udim: int, terms: Terms, around: Tile, square: Square, resident: DeviceAsset
) -> Tile | None:
    return resident.slopes.finest(udim, terms, around, square)


def _place(out: Tile, heights: Tile, row: int, column: int) -> None:
    """Copy what of a tile that begins at (row, column) lies in `out`."""
    side, tile = len(out), len(heights)
    rows = slice(max(row, 0), min(row + tile, side))
    columns = slice(max(column, 0), min(column + tile, side))
    out[rows, columns] = heights[
        rows.start - row : rows.stop - row, columns.start - column : columns.stop - column
    ]
