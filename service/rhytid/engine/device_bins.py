"""The fast method of an asset: its precomputed maps by tile, and tiles blended from them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.device.paces import WorkPace
from rhytid.domain.tiles import TileAddress
from rhytid.engine.device_frames import DeviceFrames
from rhytid.engine.device_grain import DeviceGrain
from rhytid.engine.device_mesh import DeviceMesh
from rhytid.engine.frames import Frame
from rhytid.engine.messages import MapQuery
from rhytid.engine.unmade import Unmade
from rhytid.pipeline.bin_maker import BinMaker, BinTile
from rhytid.pipeline.bins import layers, map_count
from rhytid.pipeline.cushion import cushion_layers, cushion_map_count
from rhytid.pipeline.grain import GRAIN
from rhytid.pipeline.vectors import BYTES_A_TEXEL


class DeviceBins:
    """Precomputed maps, kept while there is memory (section 2.4). Every method runs on the device
    thread."""

    def __init__(self, base: DeviceMesh, frames: DeviceFrames, grain: DeviceGrain) -> None:
        self._base, self._frames, self._grain = base, frames, grain

    def tile(self, address: TileAddress) -> BinTile:
        """The precomputed maps of one tile; made where they are not there. Raises Unmade where that
        takes long and the asset is `bounded`."""
        return self._tiles([address])[0]

    def _tiles(self, addresses: Sequence[TileAddress]) -> list[BinTile]:
        lacking = [address for address in addresses if not self.has(address)]
        if self._base.bounded and sum(map(self._work, lacking)) > self._pace(addresses[0]).most:
            raise Unmade(lambda resident: resident.bins.make(*lacking))
        keep = self._base.kept.keep
        return [keep("bins", a, make=partial(self._make, a)) for a in addresses]

    def has(self, address: TileAddress) -> bool:
        """Whether the maps of a tile are there; they stay until the task ends."""
        return self._base.kept.find("bins", address) is not None

    def make(self, *addresses: TileAddress) -> None:
        """Make and keep the maps of tiles that are not there; from any thread, see
        `Device.from_elsewhere`."""
        step = self._base.device.step
        for address in addresses:
            if not step(partial(self.has, address)):
                step(partial(self._keep, address, self._make(address)))

    def _keep(self, address: TileAddress, tile: BinTile) -> None:
        """Keep maps that were made from elsewhere, unless there are others by now."""
        if self._base.kept.keep("bins", address, make=lambda: tile) is not tile:
            tile.release()

    def _work(self, address: TileAddress) -> float:
        """Of making the maps of a tile, at most: as if each had all wrinkles and pores."""
        settings = self._base.settings
        square = (*settings.grid.first_texel(address), settings.tile_size)
        return map_count(settings.bins) * self._base.elements[address.udim].work.of(*square)

    def _pace(self, address: TileAddress) -> WorkPace:
        return self._base.elements[address.udim].bins_pace

    def codes(self, address: TileAddress, index: int) -> NDArray[np.integer]:
        """Codes (n, n) of one precomputed map; `index` counts samples within layers."""
        bins = self._base.settings.bins
        return self.tile(address).read(self._base.device, map_count(bins), index, bins.bits)

    def layer_codes(
        self, address: TileAddress, layer: str, bin: int, sample: int
    ) -> NDArray[np.integer]:
        """Codes (n, n) of one map of the manifest; of cushions coarse, with their apron."""
        settings, device = self._base.settings, self._base.device
        if layer == GRAIN:
            codes = self._grain.codes(address.udim, *settings.grid.first_texel(address))
            texels = settings.tile_size
            found: NDArray[np.integer] = device.read(codes, (texels, texels), np.int8)
            return found
        broad = cushion_layers(settings)
        if layer not in broad:
            return self.codes(address, layers(settings.bins)[layer][bin] + sample)
        cushion, index = self.tile(address).cushion, broad[layer][bin] + sample
        assert cushion is not None
        maps, bits = cushion_map_count(settings), settings.bins.bits
        return cushion.read(device, maps, index, bits, broad=True)

    def size(self) -> int:
        """Bytes that the level-0 maps of every UDIM need, as far as `BYTES_A_TEXEL` is right."""
        base, bins = self._base, self._base.settings.bins
        painted = () if base.stiffness is None else base.stiffness.maps
        a_texel = map_count(bins) * bins.bits / 8 + BYTES_A_TEXEL + self._grain.shows
        if base.cushion_factor is not None:
            broad = cushion_map_count(base.settings) * bins.bits / 8 + BYTES_A_TEXEL
            a_texel += broad / base.cushion_factor**2
        sizes = (a_texel + 4 * (udim in painted) for udim in base.located)
        return round(sum(sizes) * base.settings.resolution**2)

    def blended(
        self, frame: Frame, query: MapQuery, addresses: Sequence[TileAddress]
    ) -> list[Buffer]:
        """float32 of level-0 tiles of one UDIM."""
        blend, model, udim = self._base.blend, query.stretch, addresses[0].udim
        tiles = self._tiles(addresses)
        if query.sampling == "smooth":
            fields, located = self._frames.fields(frame, model), self._base.located[udim]
            made = [blend.smooth_tile(maps, fields, located) for maps in tiles]
            return self._grained(made, frame, query, addresses)
        plain = [a for a, maps in zip(addresses, tiles, strict=True) if maps.stiffness is None]
        stiff = [a for a in addresses if a not in plain]
        found = dict(zip(plain, self._plain(frame, model, plain), strict=True))
        stretches = self._frames.bin_stretches
        others = [blend.stiff_tile(self.tile(a), stretches(frame, model)) for a in stiff]
        found |= dict(zip(stiff, self._grained(others, frame, query, stiff), strict=True))
        return [found[address] for address in addresses]

    def _plain(self, frame: Frame, model: str, addresses: list[TileAddress]) -> list[Buffer]:
        """Tiles whose texels have no stiffness of their own."""
        if not addresses:
            return []
        tiles, grains = [self.tile(address) for address in addresses], None
        if self._grain.shows:
            place = self._base.settings.grid.first_texel
            grains = [self._grain.codes(a.udim, *place(a)) for a in addresses]
        return self._base.blend.tiles(tiles, self._frames.coefficients(frame, model), grains)

    def _grained(
        self, made: list[Buffer], frame: Frame, query: MapQuery, addresses: Sequence[TileAddress]
    ) -> list[Buffer]:
        """Tiles with the grain of a frame added."""
        settings = self._base.settings
        for out, address in zip(made, addresses, strict=True):
            square = (*settings.grid.first_texel(address), settings.tile_size)
            self._grain.add(out, frame, query, address.udim, square)
        return made

    def _make(self, address: TileAddress) -> BinTile:
        base = self._base
        elements, located = base.elements[address.udim], base.located[address.udim]
        maker = BinMaker(base.device, elements, located, base.settings, base.stiffness)
        return maker.tile(*base.settings.grid.first_texel(address), base.settings.tile_size)
