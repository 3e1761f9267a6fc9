"""The grain of a map at hand, as an asset keeps it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.mesh import Mesh
from rhytid.pipeline.grain import (
    Grain,
    GrainPlace,
    GrainPlanes,
    grain_codes,
    grain_gains,
    grain_place,
    relief,
    tiles_of_square,
)
from rhytid.pipeline.locate import UdimTriangles
from rhytid.pipeline.stretch import StretchBuffers

Square = tuple[int, int, int]


class Grains:
    """Codes and triangles of the tiles of one UDIM, made when they are first asked for; nothing
    where the settings want no grain."""

    def __init__(
        self,
        device: Device,
        mesh: Mesh,
        located: UdimTriangles,
        settings: AssetSettings,
        shares: NDArray[np.float32] | None = None,
    ) -> None:
        self._device, self._located, self._settings = device, located, settings
        self._codes: dict[Square, Buffer] = {}
        self._places: dict[Square, GrainPlace] = {}
        self._planes: GrainPlanes | None = None
        if relief(settings) > 0.0:
            assert settings.shape.grain_size is not None
            self._planes = GrainPlanes(device, mesh, settings.shape.grain_size, shares)

    def codes(self, squares: Sequence[Square]) -> list[Buffer] | None:
        """Codes of tiles (row, column, texels per side) of level 0."""
        if self._planes is None:
            return None
        for square in squares:
            if square not in self._codes:
                self._codes[square] = grain_codes(
                    self._device, self._planes, self._located, self._settings, square
                )
        return [self._codes[square] for square in squares]

    def add(self, out: Buffer, stretch: StretchBuffers, square: Square) -> None:
        """Add grain to the heights of a square of level 0 in a frame."""
        if self._planes is None:
            return
        side = self._settings.tile_size
        tiles = [(*at, side) for at in tiles_of_square(*square, side)]
        gains = grain_gains(self._device, self._settings, stretch)
        grain = Grain(self._device, self._settings, self._located, stretch, gains)
        for tile, codes in zip(tiles, self.codes(tiles) or (), strict=True):
            grain.add(out, square, self._place(tile), codes)
        gains.release()

    def release(self) -> None:
        """Give the device memory back."""
        for held in (*self._codes.values(), *self._places.values(), self._planes):
            if held is not None:
                held.release()
        self._codes.clear()
        self._places.clear()

    def _place(self, square: Square) -> GrainPlace:
        if square not in self._places:
            self._places[square] = grain_place(
                self._device, self._located, self._settings, None, square
            )
        return self._places[square]
