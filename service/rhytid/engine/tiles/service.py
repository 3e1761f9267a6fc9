"""Tiles, whole maps and precomputed maps of displacement."""

from __future__ import annotations

from contextlib import AbstractContextManager
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from rhytid.device.figures import spent_on
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.bin_manifest import BinManifest
from rhytid.domain.methods import SLOPES
from rhytid.domain.tiles import MapAddress, TileAddress
from rhytid.engine.assets.asset import Asset, AssetRegistry
from rhytid.engine.assets.on_device import DeviceAssets
from rhytid.engine.device_assets.asset import DeviceAsset
from rhytid.engine.frames import Frame
from rhytid.engine.keys import map_key
from rhytid.engine.messages import (
    DrawnTile,
    HalfTile,
    Halves,
    MapPlan,
    MapQuery,
    Tile,
    TileDescription,
    TilePlan,
)
from rhytid.engine.operations import Tiles
from rhytid.engine.tiles.batcher import TileBatcher
from rhytid.engine.tiles.maps import MapDrawing
from rhytid.engine.tiles.slopes import SlopeDrawing
from rhytid.errors import NotFoundError
from rhytid.formats.tile_header import TileHeader
from rhytid.formats.tiles import half_tile
from rhytid.pipeline.bins import HEADROOM
from rhytid.pipeline.elements import LineSources
from rhytid.pipeline.normals import normal_codes
from rhytid.pipeline.reach import SCALE_LIMIT
from rhytid.pipeline.work import Square
from rhytid.support.build_identity import drawing_version

if TYPE_CHECKING:
    from rhytid.exports.textures.normals import NormalChart
    from rhytid.exports.textures.tangents import Posed

# Texels of normal maps that one task of the device draws.
_NORMALS = 1 << 21


class TileService(Tiles):
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
        self._slopes = SlopeDrawing(on_device, self._maps)
        self._device, info = device, device.info
        # The device, where floats differ, and the version of the drawing.
        self._drawn_by = f"{info.platform}/{info.version}/{info.name}/{drawing_version()}"

    @property
    def drawn_by(self) -> str:
        """Names the device and the version of the drawing: the same name draws the same bits."""
        return self._drawn_by

    @property
    def joined(self) -> int:
        """How many callers wait for a drawing of another caller."""
        return self._batcher.joined + self._maps.joined

    @override
    def describe(
        self, asset: str, frame: str | Frame, query: MapQuery, place: TileAddress | MapAddress
    ) -> TileDescription:
        return self.plan(asset, frame, query, place).description

    @override
    def draw(
        self, asset: str, frame: str | Frame, query: MapQuery, place: TileAddress | MapAddress
    ) -> DrawnTile:
        before = self._made_of(asset, frame)
        plan = self.plan(asset, frame, query, place)
        tile, after = plan.draw(), self._made_of(asset, frame)
        if all(one is other for one, other in zip(before, after, strict=True)):
            return DrawnTile(tile, plan.description, plan.key)
        key = self.key(asset, frame, query, place, self._drawn_by)
        return DrawnTile(tile, plan.description, key)

    @override
    def draw_half(
        self, asset: str, frame: str | Frame, query: MapQuery, address: TileAddress
    ) -> HalfTile:
        found, drawn = self._checked(asset, frame, address)
        name, side = frame if isinstance(frame, str) else "", found.settings.grid.side_of(address)
        draw = partial(self._half_tile, found, drawn, query, address, side)
        return HalfTile(spent_on(query.method, draw), _header(found, name, query, address))

    def plan_map(self, asset: str, frame: str, query: MapQuery, udim: int, level: int) -> MapPlan:
        """A whole level of a UDIM; raises what `plan` does."""
        place = MapAddress(udim, level)
        found, drawn = self._checked(asset, frame, place.first)
        plan = self._planned(found, drawn, frame, query, place)

        def halves() -> Halves:
            if query.layer == SLOPES:
                return plan.draw().astype(np.float16)
            whole = (0, 0, plan.description.side)
            draw = partial(self._maps.halves, found, drawn, query, udim, level, whole)
            return spent_on(query.method, draw)

        return MapPlan(plan.description, plan.draw, halves)

    def _checked(self, asset: str, frame: str | Frame, at: TileAddress) -> tuple[Asset, Frame]:
        """An asset that has an address, and one of its frames."""
        found = self._assets.get(asset)
        found.check_address(at)
        return found, found.frame(frame)

    def _planned(
        self,
        found: Asset,
        drawn: Frame,
        frame: str | Frame,
        query: MapQuery,
        place: TileAddress | MapAddress,
    ) -> TilePlan:
        """The plan of a place of an asset in one of its frames, which is called `frame`."""
        at, name = _first(place), frame if isinstance(frame, str) else ""
        side = found.settings.grid.side_of(place)
        if query.layer == SLOPES:
            draw = partial(self._slope_square, found, drawn, query, place)
        elif isinstance(place, TileAddress):
            draw = partial(self._tile, found, drawn, query, at, side)
        else:
            whole = (0, 0, side)
            draw = partial(self._maps.square, found, drawn, query, at.udim, at.level, whole)
        key = map_key(found.id, found.settings, self._drawn_by, drawn, query, str(place))
        described = TileDescription(key, _header(found, name, query, at), side)
        return TilePlan(described, partial(spent_on, query.method, draw))

    def key(
        self,
        asset: str,
        frame: str | Frame,
        query: MapQuery,
        place: TileAddress | MapAddress,
        drawn_by: str,
    ) -> str:
        """The key that a place has now where `drawn_by` draws it, here or elsewhere; raises what
        `plan` does."""
        found = self._assets.get(asset)
        return map_key(asset, found.settings, drawn_by, found.frame(frame), query, str(place))

    def plan(
        self, asset: str, frame: str | Frame, query: MapQuery, place: TileAddress | MapAddress
    ) -> TilePlan:
        """Plan a tile or a whole level of a UDIM; raises what `draw` does."""
        found, drawn = self._checked(asset, frame, _first(place))
        return self._planned(found, drawn, frame, query, place)

    def memory_kept(self) -> AbstractContextManager[None]:
        """While the block runs, a map is drawn into the memory of one that nobody holds any more,
        where there is one of its size."""
        return self._maps.memory.kept()

    def triangles(self, asset: str, udim: int) -> NDArray[np.int32]:
        """(R, R) the triangle that each texel of a UDIM shows, padding included, row 0 at the top;
        the number of triangles for a texel that shows none. Raises what `plan` does."""
        found = self._assets.get(asset)
        found.check_address(TileAddress(udim, 0, 0, 0))
        return self._on_device.use(found, lambda resident: resident.mesh.texel_triangles(udim))

    def slope_moments(
        self,
        asset: str,
        frame: Frame,
        query: MapQuery,
        place: MapAddress,
        heights: Tile,
    ) -> tuple[Tile, Tile]:
        """(n, n, 5) moments of slopes of a whole level of a UDIM, 0 where no triangle is, and (n,
        n) the share of each texel that has one. Raises what `plan` does.

        heights: (R, R) displacement of level 0, drawn already.
        """
        found = self._assets.get(asset)
        return self._slopes.of_heights(found, frame, query, place, heights)

    def normal_codes(
        self, chart: NormalChart, posed: Posed, heights: Tile, green: int
    ) -> NDArray[np.uint16]:
        """(R, R, 3) codes of the normals of a UDIM, as `pipeline.normals.normal_codes` has them,
        some rows in a task.

        posed: the surface of the frame.  heights: (R, R) displacement of level 0, drawn already.
        """
        side, records = len(heights), chart.records(posed)
        out, step = np.empty((side, side, 3), np.uint16), max(_NORMALS // side, 1)
        for start in range(0, side, step):
            rows = slice(start, min(start + step, side))
            given = (heights, chart.triangles, chart.codes, records, rows, green)
            out[rows] = self._on_device.run_patiently(normal_codes, self._device, *given)
        return out

    def cushion_lines(self, asset: str, udim: int) -> LineSources:
        """What the wrinkles of a UDIM answer to stretch by; raises NotFoundError where an asset has
        no cushions, or not this UDIM."""
        found = self._assets.get(asset)
        found.check_address(TileAddress(udim, 0, 0, 0))
        return self._on_device.use(found, lambda resident: resident.mesh.cushion_lines(udim))

    def draw_unread(self, asset: str, frame: str, query: MapQuery, udim: int) -> None:
        """Draw a whole level 0 as `draw` does and leave it on the device, to measure that. Raises
        what `plan` does."""
        found = self._assets.get(asset)
        drawn, whole = found.frame(frame), (0, 0, found.settings.resolution)

        def piece(place: Square, resident: DeviceAsset) -> None:
            with resident.finest.parts(drawn, query, udim, place):
                resident.mesh.device.finish()

        for place in self._on_device.loaded(found).levels.pieces(query, udim, 0, whole):
            self._on_device.use(found, partial(piece, place))

    @override
    def bins(self, asset: str) -> BinManifest:
        self._assets.get(asset).check_grown()
        return self.precomputed(asset)

    def precomputed(self, asset: str) -> BinManifest:
        """As `bins`; of a scanned skin what its graph draws, without its residual."""
        found = self._assets.get(asset)
        found.check_ready()
        return self._on_device.loaded(found).bins.manifest()

    @override
    def bin_tile(
        self,
        asset: str,
        address: TileAddress,
        layer: str,
        bin: int | None = None,
        sample: int | None = None,
    ) -> NDArray[np.integer]:
        self._assets.get(asset).check_grown()
        return self.precomputed_tile(asset, address, layer, bin, sample)

    def precomputed_tile(
        self,
        asset: str,
        address: TileAddress,
        layer: str,
        bin: int | None = None,
        sample: int | None = None,
    ) -> NDArray[np.integer]:
        """As `bin_tile`; of a scanned skin what its graph draws, without its residual."""
        found = self._assets.get(asset)
        found.check_address(address)
        if address.level > 0:
            raise NotFoundError(
                f"level {address.level}: precomputed maps are of level 0 only; coarser levels of "
                "binned are means of its level 0"
            )

        return self._on_device.use(
            found, lambda resident: resident.bins.layer_codes(address, layer, bin, sample)
        )

    def _made_of(self, asset: str, frame: str | Frame) -> tuple[Asset, AssetSettings, Frame]:
        """The present asset, settings and frame; raises what `plan` does."""
        found = self._assets.get(asset)
        return found, found.settings, found.frame(frame)

    def _slope_square(
        self, asset: Asset, frame: Frame, query: MapQuery, place: TileAddress | MapAddress
    ) -> Tile:
        grid = asset.settings.grid
        corner = grid.first_texel(place) if isinstance(place, TileAddress) else (0, 0)
        square = (*corner, grid.side_of(place))
        return self._slopes.square(asset, frame, query, place.udim, place.level, square)

    def _tile(
        self, asset: Asset, frame: Frame, query: MapQuery, address: TileAddress, side: int
    ) -> Tile:
        udim, level = address.udim, address.level
        square = (address.row * side, address.column * side, side)
        if level > 0:
            return self._maps.shared(asset, frame, query, udim, level, square)

        def tile(resident: DeviceAsset) -> Tile:
            if resident.levels.is_long(query, udim, square):
                return self._maps.shared(asset, frame, query, udim, level, square)
            key = (asset, frame.digest, query, udim)
            return self._batcher.tile(key, address, side, draw, asset.id)

        def draw(addresses: list[TileAddress]) -> list[Tile]:
            return self._on_device.found(asset).finest.tiles(frame, query, addresses)

        return self._on_device.using(asset, tile)

    def _half_tile(
        self, asset: Asset, frame: Frame, query: MapQuery, address: TileAddress, side: int
    ) -> Halves:
        udim, square = address.udim, (address.row * side, address.column * side, side)

        def tile(resident: DeviceAsset) -> Halves | None:
            if resident.levels.is_long(query, udim, square):
                return None
            key = (asset, frame.digest, query, udim, "half")
            return self._batcher.tile(key, address, side, draw, asset.id)

        def draw(addresses: list[TileAddress]) -> list[Halves]:
            return self._on_device.found(asset).finest.half_tiles(frame, query, addresses)

        found = self._on_device.using(asset, tile) if address.level == 0 else None
        return half_tile(self._tile(asset, frame, query, address, side)) if found is None else found


def _first(place: TileAddress | MapAddress) -> TileAddress:
    return place if isinstance(place, TileAddress) else place.first


def displacement_scale(asset: Asset) -> float:
    """The displacement that the largest code of a png tile stands for, mesh units: one scale per
    asset.

    The largest displacement that the maps of the fast method can hold, whatever its bins are; twice
    that where lines have ranks, skin has patches or single features, which add up to more. The
    largest residual of a scanned skin is added.
    """
    grown = asset.settings.graph
    uneven = grown.rank > 0 or grown.patches > 0 or grown.events > 0
    depths = (2.0 if uneven else 1.0) * SCALE_LIMIT * (1.0 + HEADROOM)
    return depths * (asset.settings.depth or 0.0) + (asset.residual or 0.0)


def _header(asset: Asset, frame: str, query: MapQuery, at: TileAddress) -> TileHeader:
    return TileHeader(
        scale=displacement_scale(asset),
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
    )
