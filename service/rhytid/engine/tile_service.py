"""Displacement: tiles, whole maps and precomputed maps."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rhytid.device.figures import spent_on
from rhytid.device.runtime import Device
from rhytid.domain.bin_manifest import BinManifest
from rhytid.domain.frame import check_positions
from rhytid.domain.tiles import TileAddress
from rhytid.engine.asset_registry import AssetRegistry
from rhytid.engine.assets import Asset
from rhytid.engine.bin_manifest import bin_manifest
from rhytid.engine.device_asset import DeviceAsset
from rhytid.engine.device_assets import DeviceAssets
from rhytid.engine.frames import Frame
from rhytid.engine.keys import map_key, settings_key
from rhytid.engine.map_drawing import MapDrawing
from rhytid.engine.messages import MapQuery
from rhytid.engine.tile_batcher import TileBatcher
from rhytid.engine.tile_plan import Tile, TilePlan
from rhytid.errors import NotFoundError, QueryError
from rhytid.formats.tile_header import TileHeader
from rhytid.pipeline.bins import HEADROOM
from rhytid.pipeline.reach import SCALE_LIMIT
from rhytid.support.build_identity import drawing_version


class TileService:
    """Plans and draws tiles and maps of assets."""

    def __init__(
        self,
        registry: AssetRegistry,
        on_device: DeviceAssets,
        device: Device,
        batcher: TileBatcher,
        most_waiting: int,
    ) -> None:
        self._assets, self._on_device, self._batcher = registry, on_device, batcher
        self._maps = MapDrawing(on_device, most_waiting)
        info = device.info
        # The device, where floats differ, and the version of the drawing.
        self._drawn_by = f"{info.platform}/{info.version}/{info.name}/{drawing_version()}"

    @property
    def drawn_by(self) -> str:
        """Names what draws: two with the same have the same bits."""
        return self._drawn_by

    @property
    def joined(self) -> int:
        """Callers that wait for what another draws."""
        return self._batcher.joined + self._maps.joined

    def plan(self, asset: str, frame: str, query: MapQuery, address: TileAddress) -> TilePlan:
        """One tile of a frame. Raises NotFoundError for what does not exist, NotReadyError while
        the asset builds, ConflictError where it failed."""
        found = self._assets.get(asset)
        found.check_address(address)
        stored = found.frame(frame)
        return TilePlan(
            self._key(found, stored, query, str(address)),
            _header(found, frame, query, address),
            found.settings.grid.texels(address.level),
            _measured(query, self._tile, found, stored, query, address),
        )

    def plan_map(self, asset: str, frame: str, query: MapQuery, udim: int, level: int) -> TilePlan:
        """A whole level of a UDIM; raises what `plan` does."""
        found, first = self._assets.get(asset), TileAddress(udim, level, 0, 0)
        found.check_address(first)
        stored, whole = found.frame(frame), (0, 0, found.settings.grid.side(level))
        return TilePlan(
            self._key(found, stored, query, f"{udim}/{level}"),
            _header(found, frame, query, first),
            whole[2],
            _measured(query, self._maps.square, found, stored, query, udim, level, whole),
        )

    def triangles(self, asset: str, udim: int) -> NDArray[np.int32]:
        """(R, R) the triangle that each texel of a UDIM shows, padding included, row 0 at the top;
        the number of triangles for none. Raises what `plan` does."""
        found = self._assets.get(asset)
        found.check_address(TileAddress(udim, 0, 0, 0))
        return self._on_device.use(found, lambda resident: resident.mesh.texel_triangles(udim))

    def cushion_triangles(self, asset: str, udim: int) -> NDArray[np.int32]:
        """(n, n) as `triangles`, of the samples of the cushions, with the apron around the UDIM.
        Raises NotFoundError where there are no cushions."""
        found = self._assets.get(asset)
        found.check_address(TileAddress(udim, 0, 0, 0))
        return self._on_device.use(found, lambda resident: resident.mesh.cushion_triangles(udim))

    def plans_once(
        self, asset: str, positions: ArrayLike, query: MapQuery, addresses: list[TileAddress]
    ) -> list[TilePlan]:
        """Tiles of positions (V, 3) that are not stored, in the order of `addresses`."""
        found = self._assets.get(asset)
        for address in addresses:
            found.check_address(address)
        frame = Frame.of(check_positions(positions, found.vertices))
        return [
            TilePlan(
                self._key(found, frame, query, str(address)),
                _header(found, "", query, address),
                found.settings.grid.texels(address.level),
                _measured(query, self._tile, found, frame, query, address),
            )
            for address in addresses
        ]

    def bins(self, asset: str) -> BinManifest:
        """The precomputed maps of an asset (section 2.4)."""
        found = self._assets.get(asset)
        resident = self._on_device.loaded(found)
        return bin_manifest(resident.mesh.settings, resident.mesh.cushion_factor)

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

        def codes(resident: DeviceAsset) -> NDArray[np.integer]:
            # In a task of the device, where settings do not change meanwhile.
            manifest = bin_manifest(resident.mesh.settings, resident.mesh.cushion_factor)
            return resident.bins.layer_codes(address, layer, *of_map(manifest, layer, bin, sample))

        return self._on_device.use(found, codes)

    def _key(self, asset: Asset, frame: Frame, query: MapQuery, place: str) -> str:
        revision = settings_key(asset.id, asset.settings, self._drawn_by, query.method)
        return map_key(revision, frame, query, place)

    def _tile(self, asset: Asset, frame: Frame, query: MapQuery, address: TileAddress) -> Tile:
        udim, level = address.udim, address.level
        texels = asset.settings.grid.texels(level)
        square = (address.row * texels, address.column * texels, texels)
        if level > 0 or self._on_device.loaded(asset).levels.is_long(query, udim, square):
            return self._maps.shared(asset, frame, query, udim, level, square)
        key = (asset, frame.digest, query, udim)

        def draw(addresses: list[TileAddress]) -> list[Tile]:
            return self._on_device.found(asset).finest.tiles(frame, query, addresses)

        tile = self._batcher.tile
        return self._on_device.using(asset, lambda: tile(key, address, texels, draw, asset.id))


def _measured(query: MapQuery, draw: Callable[..., Tile], *arguments: Any) -> Callable[[], Tile]:
    """Draws with these arguments; what it takes is counted for the method."""
    return partial(spent_on, query.method, partial(draw, *arguments))


def displacement_scale(asset: Asset) -> float:
    """What the largest code of a png tile stands for, mesh units: one scale per asset.

    The largest displacement that the maps of the fast method can hold, whatever its bins are.
    """
    return SCALE_LIMIT * (1.0 + HEADROOM) * (asset.settings.depth or 0.0)


def _header(asset: Asset, frame: str, query: MapQuery, at: TileAddress) -> TileHeader:
    return TileHeader(
        unit=asset.settings.length_unit,
        frame=frame,
        asset=asset.id,
        method=query.method,
        stretch=query.stretch,
        sampling=query.sampling,
        udim=at.udim,
        level=at.level,
        row=at.row,
        column=at.column,
        scale=displacement_scale(asset),
    )


def of_map(
    manifest: BinManifest, layer: str, bin: int | None, sample: int | None
) -> tuple[int, int]:
    """Bin and sample, 0 where there is one alone and none is given.

    Raises NotFoundError naming what does not exist, QueryError naming what is missing.
    """
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
