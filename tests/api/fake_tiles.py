"""Tiles and maps of the fake engine."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from api.fake_state import Part, digest_of
from rhytid.domain.bin_manifest import BinManifest, CushionLayer, GrainLayer
from rhytid.domain.tiles import MapAddress, TileAddress
from rhytid.engine.device_assets.bins import map_index
from rhytid.engine.frames import Frame
from rhytid.engine.messages import DrawnTile, HalfTile, MapQuery, TileDescription
from rhytid.errors import NotFoundError
from rhytid.formats.tile_header import TileHeader
from rhytid.formats.tiles import half_tile


class FakeTiles(Part):
    """Heights are a ripple over the whole map, scaled by how far the frame is from the neutral."""

    def describe(self, asset: str, frame: Any, query: MapQuery, place: Any) -> TileDescription:
        first = place.first if isinstance(place, MapAddress) else place
        found = self.state.check(asset, first)
        text = repr((asset, found.settings, query, place))
        key = digest_of(text, self._positions(asset, frame))
        name = frame if isinstance(frame, str) else ""
        header = self._header(asset, name, query, first)
        return TileDescription(key, header, found.settings.grid.side_of(place))

    def draw(self, asset: str, frame: Any, query: MapQuery, place: Any) -> DrawnTile:
        planned = self.describe(asset, frame, query, place)
        tile = self.tile(asset, frame, query, place)
        return DrawnTile(tile, planned, self.describe(asset, frame, query, place).key)

    def draw_half(self, asset: str, frame: Any, query: MapQuery, address: Any) -> HalfTile:
        drawn = self.draw(asset, frame, query, address)
        return HalfTile(half_tile(drawn.tile), drawn.description.header)

    def tile(self, asset: str, frame: Any, query: MapQuery, place: Any) -> NDArray[np.float32]:
        """What tests replace."""
        positions = self._positions(asset, frame)
        if isinstance(place, MapAddress):
            self.state.drawn.append((place.udim, place.level, query.method))
            return self._ripple(asset, positions, place.level)
        self.state.drawn.append((place, query.method))
        n = self.state.find(asset).settings.grid.texels(place.level)
        rows, columns = (slice(i * n, (i + 1) * n) for i in (place.row, place.column))
        return self._ripple(asset, positions, place.level)[rows, columns]

    def _positions(self, asset: str, frame: str | Frame) -> NDArray[np.float32]:
        if isinstance(frame, str):
            return self.state.positions(asset, frame)
        assert frame.positions is not None
        return frame.positions

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
            cushion=CushionLayer(4, 2, (-0.5, 0.0, 0.5), 4.0), grain=GrainLayer(2.0),
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

    def _ripple(self, asset: str, positions: Any, level: int) -> NDArray[np.float32]:
        settings = self.state.find(asset).settings
        phase = np.arange(settings.grid.side(level)) / settings.grid.side(level)
        height = (settings.depth or 0.0) * (1 + self.state.moved(asset, positions))
        ripple = -height * np.abs(np.sin(9 * phase[:, None] + 5 * phase))
        return ripple.astype(np.float32)
