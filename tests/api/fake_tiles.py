"""Tiles and maps of the fake engine."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from api.fake_state import Part, digest_of
from rhytid.domain.bin_manifest import BinManifest, CushionLayer, GrainLayer
from rhytid.domain.tiles import TileAddress
from rhytid.engine.device_assets.bins import map_index
from rhytid.engine.messages import MapQuery, TilePlan
from rhytid.errors import NotFoundError
from rhytid.formats.tile_header import TileHeader


class FakeTiles(Part):
    """Heights are a ripple over the whole map, scaled by how far the frame is from the neutral."""

    def _key(self, asset: str, frame: str, query: MapQuery, address: TileAddress) -> str:
        found = self.state.check(asset, address)
        positions = self.state.positions(asset, frame)
        return digest_of(repr((asset, found.settings, query, address)), positions)

    def tile(
        self, asset: str, frame: str, query: MapQuery, address: TileAddress
    ) -> NDArray[np.float32]:
        self._key(asset, frame, query, address)
        return self._draw(asset, self.state.positions(asset, frame), query, address)

    def _map_key(self, asset: str, frame: str, query: MapQuery, udim: int, level: int) -> str:
        return "map" + self._key(asset, frame, query, TileAddress(udim, level, 0, 0))

    def _map(
        self, asset: str, frame: str, query: MapQuery, udim: int, level: int
    ) -> NDArray[np.float32]:
        self._map_key(asset, frame, query, udim, level)
        self.state.drawn.append((udim, level, query.method))
        return self._ripple(asset, self.state.positions(asset, frame), level)

    def plan(self, asset: str, frame: str, query: MapQuery, address: TileAddress) -> TilePlan:
        key = self._key(asset, frame, query, address)
        draw = partial(self.tile, asset, frame, query, address)
        side = self.state.find(asset).settings.grid.texels(address.level)
        return TilePlan(key, self._header(asset, frame, query, address), side, draw)

    def plan_map(self, asset: str, frame: str, query: MapQuery, udim: int, level: int) -> TilePlan:
        key = self._map_key(asset, frame, query, udim, level)
        draw = partial(self._map, asset, frame, query, udim, level)
        header = self._header(asset, frame, query, TileAddress(udim, level, 0, 0))
        return TilePlan(key, header, self.state.find(asset).settings.grid.side(level), draw)

    def _header(self, asset: str, frame: str, query: MapQuery, at: TileAddress) -> TileHeader:
        settings = self.state.built(asset).settings
        drawn = (query.method, query.stretch, query.sampling)
        place = (at.udim, at.level, at.row, at.column)
        return TileHeader(settings.unit, frame, asset, *drawn, *place, 4.5 * (settings.depth or 0))

    def bins(self, asset: str) -> BinManifest:
        bins = self.state.built(asset).settings.bins
        angles = tuple(float(a) for a in np.pi * np.arange(bins.count) / bins.count)
        samples = (-bins.r_max, 0.0, bins.r_max)
        layers = {"wrinkles": bins.count, "pores": 1}
        if bins.merge == "mellow":
            layers |= {"wrinkle_bulges": bins.count, "pore_bulges": 1}
        layers["grain"] = 1
        steps = {**dict.fromkeys(layers, (1e-4,) * 3), "grain": (1e-4,)}
        factored = bins.depth_factored
        return BinManifest(
            angles, samples, steps, bins.bits, bins.merge, factored, layers, samples,
            depth=1.0, sharpness=20.0, log_stretch_limit=0.5, scale_limit=4.0,
            depth_exponents={"wrinkles": 4.0, "pores": 10.0}, measured_in="uv", tilt=None,
            soft_limits=True, pore_depth_limit=2.0,
            cushion=CushionLayer(4, 2, 5.0), grain=GrainLayer(2.0),
        )  # fmt: skip

    def bin_tile(
        self,
        asset: str,
        address: TileAddress,
        layer: str,
        bin: int | None = None,
        sample: int | None = None,
    ) -> NDArray[np.integer]:
        found, manifest = self.state.check(asset, address), self.bins(asset)
        bin, sample = map_index(manifest, layer, bin, sample)
        if address.level > 0:
            raise NotFoundError(f"level {address.level}: precomputed maps are of level 0 only")
        side = found.settings.grid.texels(0)
        dtype = np.int8 if manifest.bits == 8 else np.int16
        return np.full((side, side), 10 * bin + sample, dtype)

    def plans_once(
        self, asset: str, positions: ArrayLike, query: MapQuery, addresses: list[TileAddress]
    ) -> list[TilePlan]:
        for address in addresses:
            self.state.check(asset, address)
        return [
            TilePlan(
                str(address),
                self._header(asset, "", query, address),
                self.state.find(asset).settings.grid.texels(address.level),
                partial(self._draw, asset, positions, query, address),
            )
            for address in addresses
        ]

    def _draw(
        self, asset: str, positions: Any, query: MapQuery, at: TileAddress
    ) -> NDArray[np.float32]:
        self.state.drawn.append((at, query.method))
        n = self.state.find(asset).settings.grid.texels(at.level)
        ripple = self._ripple(asset, positions, at.level)
        return ripple[at.row * n : (at.row + 1) * n, at.column * n : (at.column + 1) * n]

    def _ripple(self, asset: str, positions: Any, level: int) -> NDArray[np.float32]:
        settings = self.state.find(asset).settings
        phase = np.arange(settings.grid.side(level)) / settings.grid.side(level)
        height = (settings.depth or 0.0) * (1 + self.state.moved(asset, positions))
        ripple = -height * np.abs(np.sin(9 * phase[:, None] + 5 * phase))
        return ripple.astype(np.float32)
