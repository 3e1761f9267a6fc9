"""Tiles, maps and precomputed maps."""

from __future__ import annotations

from contextlib import suppress
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.frame import check_positions
from rhytid.domain.tiles import TileAddress
from rhytid.engine.assets import Asset
from rhytid.engine.bin_manifest import bin_manifest
from rhytid.engine.core import EngineCore
from rhytid.engine.frames import Frame
from rhytid.engine.keys import map_key, settings_key
from rhytid.engine.messages import BinManifest, MapQuery
from rhytid.errors import ConflictError, DeviceMemoryError, NotFoundError
from rhytid.pipeline.bins import HEADROOM, TILTS, layers
from rhytid.pipeline.blend import TILES_A_LAUNCH
from rhytid.pipeline.elements import SCALE_LIMIT

Tile = NDArray[np.float32]
# Level-0 texels per side of a map that are drawn in one go.
_PIECE = 4096
# How often a map is drawn anew because the settings changed meanwhile.
_ATTEMPTS = 3
# Methods that keep something of each tile from one frame to the next.
_BY_TILE = ("binned", "convolved")


class TileCalls(EngineCore):
    """The calls that answer with displacement."""

    def tile_key(self, asset: str, frame: str, query: MapQuery, address: TileAddress) -> str:
        """Names the content of a tile without computing it; checks everything that `tile` does."""
        found = self._assets.get(asset)
        found.check_address(address)
        return self._key(found, found.frame(frame), query, str(address))

    def tile(self, asset: str, frame: str, query: MapQuery, address: TileAddress) -> Tile:
        """(n, n) float32 displacement of one tile, in mesh units, row 0 at the top."""
        found = self._assets.get(asset)
        found.check_address(address)
        return self._tile(found, found.frame(frame), query, address)

    def map_key(self, asset: str, frame: str, query: MapQuery, udim: int, level: int) -> str:
        """Names the content of a whole map without computing it."""
        found = self._assets.get(asset)
        found.check_address(TileAddress(udim, level, 0, 0))
        return self._key(found, found.frame(frame), query, f"{udim}/{level}")

    def map(self, asset: str, frame: str, query: MapQuery, udim: int, level: int) -> Tile:
        """(R, R) float32 displacement of a whole level of a UDIM, in mesh units."""
        found = self._assets.get(asset)
        found.check_address(TileAddress(udim, level, 0, 0))
        stored = found.frame(frame)
        for _ in range(_ATTEMPTS):
            settings = found.settings
            drawn = self._pieces(found, stored, query, udim, level)
            if found.settings is settings:
                return drawn
        raise ConflictError(f"the settings of asset {asset} change while its map is drawn")

    def _pieces(self, asset: Asset, frame: Frame, query: MapQuery, udim: int, level: int) -> Tile:
        """A whole map, piece by piece: others get their turn on the device in between."""
        grid, resident = asset.settings.grid, asset.ready()
        if query.method in _BY_TILE:
            addresses = list(grid.addresses(udim, level))
            tiles = []
            for first in range(0, len(addresses), TILES_A_LAUNCH):
                some = addresses[first : first + TILES_A_LAUNCH]
                tiles += self._few(asset, frame, query, some)
            return _assembled(tiles, grid.count(level))
        side = grid.side(level)
        piece = min(side, max(_PIECE >> level, 1))
        starts = range(0, side, piece)
        drawn = [
            self._on_device(resident.drawn, frame, query, udim, level, y, x, piece)
            for y in starts
            for x in starts
        ]
        return _assembled(drawn, side // piece)

    def tiles_once(
        self, asset: str, positions: ArrayLike, query: MapQuery, addresses: list[TileAddress]
    ) -> list[Tile]:
        """Tiles of positions (V, 3) that are not stored, in the order of `addresses`."""
        found = self._assets.get(asset)
        for address in addresses:
            found.check_address(address)
        frame = Frame.of(check_positions(positions, found.vertices))
        return [self._tile(found, frame, query, address) for address in addresses]

    def unit(self, asset: str) -> str:
        """The unit of length of an asset's displacement."""
        return self._assets.get(asset).settings.unit

    def displacement_scale(self, asset: str) -> float:
        """What the largest code of a png tile stands for, mesh units: one scale an asset.

        The largest displacement that the maps of the fast method can hold, whatever its bins are.
        """
        settings = self._assets.get(asset).settings
        return SCALE_LIMIT * (1.0 + HEADROOM) * (settings.depth or 0.0)

    def bins(self, asset: str) -> BinManifest:
        """The precomputed maps of an asset (section 2.4)."""
        found = self._assets.get(asset)
        found.ready()
        return bin_manifest(found.settings)

    def bin_tile(
        self, asset: str, address: TileAddress, layer: str, bin: int, sample: int
    ) -> NDArray[np.integer]:
        """(n, n) int8 or int16 codes of one precomputed map tile; displacement = code * step."""
        found = self._assets.get(asset)
        found.check_address(address)
        index = _map_index(found.settings, layer, bin, sample)
        return self._on_device(found.ready().bin_codes, address, index)

    def _key(self, asset: Asset, frame: Frame, query: MapQuery, place: str) -> str:
        revision = settings_key(asset.id, asset.settings, self._device_key, query.method)
        return map_key(revision, frame, query, place)

    def _few(
        self, asset: Asset, frame: Frame, query: MapQuery, addresses: list[TileAddress]
    ) -> list[Tile]:
        """Tiles that are blended in one launch, where their maps fit on the device together."""
        if query.method == "binned":
            with suppress(DeviceMemoryError):
                return self._on_device(asset.ready().tiles, frame, query, addresses)
        return [self._tile(asset, frame, query, address) for address in addresses]

    def _tile(self, asset: Asset, frame: Frame, query: MapQuery, address: TileAddress) -> Tile:
        resident = asset.ready()
        key = (asset, frame.digest, query, address.udim, address.level)
        texels = asset.settings.grid.texels(address.level)
        return self._together.tile(key, address, texels, partial(resident.tiles, frame, query))


def _assembled(tiles: list[Tile], count: int) -> Tile:
    rows = [tiles[i : i + count] for i in range(0, len(tiles), count)]
    return np.block(rows)


def _map_index(settings: AssetSettings, layer: str, bin: int, sample: int) -> int:
    """Position among the maps of a tile; raises NotFoundError naming what does not exist."""
    first = layers(settings.bins).get(layer)
    if first is None:
        raise NotFoundError(f"layer {layer!r}: one of {', '.join(layers(settings.bins))}")
    samples = settings.bins.layer_samples[-1 if layer.startswith("pore") else 0]
    samples = 1 if layer == TILTS else samples
    for name, index, size in (("bin", bin, len(first)), ("sample", sample, samples)):
        if not 0 <= index < size:
            raise NotFoundError(f"{name} {index} of layer {layer}: 0 to {size - 1}")
    return first[bin] + sample
