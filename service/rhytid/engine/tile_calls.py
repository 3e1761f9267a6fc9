"""Tiles, maps and precomputed maps."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rhytid.domain.frame import check_positions
from rhytid.domain.tiles import TileAddress
from rhytid.engine.assets import Asset
from rhytid.engine.bin_manifest import bin_manifest
from rhytid.engine.core import EngineCore
from rhytid.engine.frames import Frame
from rhytid.engine.keys import map_key, settings_key
from rhytid.engine.messages import BinManifest, MapQuery
from rhytid.errors import NotFoundError, QueryError
from rhytid.pipeline.bins import HEADROOM
from rhytid.pipeline.elements import SCALE_LIMIT

Tile = NDArray[np.float32]


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
        whole = (0, 0, found.settings.grid.side(level))
        return self._gathering.square(found, found.frame(frame), query, udim, level, whole)

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
        return self._assets.get(asset).settings.length_unit

    def displacement_scale(self, asset: str) -> float:
        """What the largest code of a png tile stands for, mesh units: one scale an asset.

        The largest displacement that the maps of the fast method can hold, whatever its bins are.
        """
        settings = self._assets.get(asset).settings
        return SCALE_LIMIT * (1.0 + HEADROOM) * (settings.depth or 0.0)

    def bins(self, asset: str) -> BinManifest:
        """The precomputed maps of an asset (section 2.4)."""
        found = self._assets.get(asset)
        return bin_manifest(found.settings, found.ready().cushion_factor)

    def bin_tile(
        self,
        asset: str,
        address: TileAddress,
        layer: str,
        bin: int | None = None,
        sample: int | None = None,
    ) -> NDArray[np.integer]:
        """(n, n) int8 or int16 codes of one precomputed map tile; displacement = code * step.

        bin, sample: needed where the layer has more than one.  Of the cushions n is that of the
        samples under the tile, with the apron around them.

        Raises NotFoundError above level 0: what is blended has coarser levels, the maps have none;
        QueryError where bin or sample is missing.
        """
        found = self._assets.get(asset)
        found.check_address(address)
        if address.level > 0:
            raise NotFoundError(
                f"level {address.level}: precomputed maps are of level 0 only; coarser levels of "
                "binned are means of its level 0"
            )
        resident = found.ready()

        def codes() -> NDArray[np.integer]:
            # On the device thread, where settings do not change meanwhile.
            manifest = bin_manifest(resident.settings, resident.cushion_factor)
            return resident.layer_codes(address, layer, *of_map(manifest, layer, bin, sample))

        return self._on_device(codes)

    def _key(self, asset: Asset, frame: Frame, query: MapQuery, place: str) -> str:
        revision = settings_key(asset.id, asset.settings, self._drawn_by, query.method)
        return map_key(revision, frame, query, place)

    def _tile(self, asset: Asset, frame: Frame, query: MapQuery, address: TileAddress) -> Tile:
        udim, level = address.udim, address.level
        texels = asset.settings.grid.texels(level)
        if level > 0:
            square = (address.row * texels, address.column * texels, texels)
            return self._gathering.shared(asset, frame, query, udim, level, square)
        resident, key = asset.ready(), (asset, frame.digest, query, udim)
        return self._together.tile(key, address, texels, partial(resident.tiles, frame, query))


def of_map(
    manifest: BinManifest, layer: str, bin: int | None, sample: int | None
) -> tuple[int, int]:
    """Bin and sample, 0 where there is one alone and none is given.

    Raises NotFoundError naming what does not exist, QueryError naming what is missing."""
    if layer not in manifest.layers:
        raise NotFoundError(f"layer {layer!r}: one of {', '.join(manifest.layers)}")
    bins, samples = manifest.layers[layer], len(manifest.steps[layer])
    return _index("bin", bin, bins, layer), _index("sample", sample, samples, layer)


def _index(name: str, index: int | None, size: int, layer: str) -> int:
    if index is None and size > 1:
        raise QueryError(f"{name} is missing: layer {layer} has {size}, 0 to {size - 1}")
    if index is not None and not 0 <= index < size:
        raise NotFoundError(f"{name} {index} of layer {layer}: 0 to {size - 1}")
    return index or 0
