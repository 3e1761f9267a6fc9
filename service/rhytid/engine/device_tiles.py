"""An asset on the device, level 0 of its maps. Every method runs on the device thread."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rhytid.device.runtime import Buffer
from rhytid.domain.tiles import TileAddress
from rhytid.engine.device_frames import DeviceFrames
from rhytid.engine.frames import NEUTRAL_FRAME, Frame
from rhytid.engine.messages import MapQuery
from rhytid.pipeline.bin_maker import BinMaker, BinTile
from rhytid.pipeline.bins import layers, map_count
from rhytid.pipeline.blend import Coefficients
from rhytid.pipeline.cushion_bins import cushion_layers, cushion_map_count
from rhytid.pipeline.elements import BLOCK
from rhytid.pipeline.grain import GRAIN
from rhytid.pipeline.levels import Draw, render_to_host
from rhytid.pipeline.neutral_tiles import NeutralTile, NeutralTiles
from rhytid.pipeline.redraw import ScaleBuffers, redrawing, respond
from rhytid.pipeline.smooth import respond_smooth
from rhytid.pipeline.vectors import BYTES_A_TEXEL


class DeviceTiles(DeviceFrames):
    """What can be drawn of an asset: stretch, tiles by every method, precomputed maps."""

    def warm_up(self) -> None:
        """Draw one block a level up, so that no request waits for a compiler."""
        for udim in self.udims[:1]:
            self.drawn(NEUTRAL_FRAME, MapQuery(), udim, 1, 0, 0, BLOCK // 2)
        self._forget_made()

    def warm_up_blend(self, address: TileAddress) -> None:
        """Blend one tile, for the same reason."""
        for buffer in self.finest(NEUTRAL_FRAME, MapQuery("binned"), [address]):
            buffer.release()

    def stretch(self, frame: Frame) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """(ratios (F, 2) unclamped, axes (F, 2, 2)) of a frame."""
        return self._stretch.read(self._stretch_buffers(frame, "tensor"))

    def drawn(
        self, frame: Frame, query: MapQuery, udim: int, level: int, row: int, column: int, side: int
    ) -> NDArray[np.float32]:
        """(side, side) displacement drawn anew: `redraw` of the frame, or `neutral`."""
        draw = self._redrawn(frame, query, udim)
        return render_to_host(self._device, draw, level, row, column, side)

    def finest(
        self, frame: Frame, query: MapQuery, addresses: Sequence[TileAddress]
    ) -> list[Buffer]:
        """float32 of level-0 tiles of one UDIM by any method: all are enqueued before the first
        is read. What no frame changes is kept: precomputed maps, what `convolved` reads."""
        if query.method == "binned":
            return self._blended(frame, query, addresses)
        side = self.settings.tile_size
        return [self._draw(frame, query, a)(*self._place(a), side) for a in addresses]

    def square(
        self, frame: Frame, query: MapQuery, udim: int, row: int, column: int, side: int
    ) -> Buffer:
        """float32 of `side`² texels of level 0 by any method but `binned`; nothing is kept."""
        if query.method != "convolved":
            return self._redrawn(frame, query, udim)(row, column, side)
        maker, convolve = self._convolving(frame, query, udim)

        def draw(row: int, column: int, side: int) -> Buffer:
            neutral = self._neutral_tile(maker, udim, row, column, side)
            out = convolve(neutral)
            neutral.release()
            return out

        return self._grained(draw, frame, query, udim)(row, column, side)

    def bin_tile(self, address: TileAddress) -> BinTile:
        """The precomputed maps of one tile; made where they are not there."""
        return self._keep("bins", address, make=lambda: self._make_bins(address))

    def has_bins(self, address: TileAddress) -> bool:
        """Whether the precomputed maps of a tile are there; they stay until the task ends."""
        return self._lookup("bins", address) is not None

    def made_bins(self, address: TileAddress) -> BinTile:
        """The precomputed maps of one tile, made anew and not kept; from any thread, see
        `Device.from_elsewhere`."""
        return self._make_bins(address)

    def keep_bins(self, address: TileAddress, tile: BinTile) -> None:
        """Keep maps that were made from elsewhere, unless there are others by now."""
        if self._keep("bins", address, make=lambda: tile) is not tile:
            tile.release()

    def bin_codes(self, address: TileAddress, index: int) -> NDArray[np.integer]:
        """Codes (n, n) of one precomputed map; `index` counts samples within layers."""
        bins = self.settings.bins
        return self.bin_tile(address).read(self._device, map_count(bins), index, bins.bits)

    def layer_codes(
        self, address: TileAddress, layer: str, bin: int, sample: int
    ) -> NDArray[np.integer]:
        """Codes (n, n) of one map of the manifest; of cushions coarse, with their apron."""
        settings = self.settings
        if layer == GRAIN:
            codes = self._grain_codes(address.udim, *self._place(address))
            texels = settings.tile_size
            found: NDArray[np.integer] = self._device.read(codes, (texels, texels), np.int8)
            return found
        broad = cushion_layers(settings)
        if layer not in broad:
            return self.bin_codes(address, layers(settings.bins)[layer][bin] + sample)
        cushion, index = self.bin_tile(address).cushion, broad[layer][bin] + sample
        assert cushion is not None
        maps, bits = cushion_map_count(settings), settings.bins.bits
        return cushion.read(self._device, maps, index, bits, broad=True)

    def bins_size(self) -> int:
        """Bytes that the level-0 maps of every UDIM need, as far as `BYTES_A_TEXEL` is right."""
        bins, painted = self.settings.bins, () if self._stiffness is None else self._stiffness.maps
        a_texel = map_count(bins) * bins.bits / 8 + BYTES_A_TEXEL + self._shows_grain
        if self.cushion_factor is not None:
            broad = cushion_map_count(self.settings) * bins.bits / 8 + BYTES_A_TEXEL
            a_texel += broad / self.cushion_factor**2
        sizes = (a_texel + 4 * (udim in painted) for udim in self._located)
        return round(sum(sizes) * self.settings.resolution**2)

    def _draw(self, frame: Frame, query: MapQuery, address: TileAddress) -> Draw:
        """What draws a tile of any method but `binned`."""
        if query.method == "convolved":
            return self._convolved(frame, query, address)
        return self._redrawn(frame, query, address.udim)

    def _redrawn(self, frame: Frame, query: MapQuery, udim: int) -> Draw:
        """What draws `redraw` of the frame, or `neutral`."""
        deformed = NEUTRAL_FRAME if query.method == "neutral" else frame
        return self._redrawing(deformed, query, udim)

    def _convolved(self, frame: Frame, query: MapQuery, address: TileAddress) -> Draw:
        maker, convolve = self._convolving(frame, query, address.udim)

        def draw(row: int, column: int, side: int) -> Buffer:
            def make() -> NeutralTile:
                return self._neutral_tile(maker, address.udim, row, column, side)

            return convolve(self._keep("neutral", query.sampling, address, make=make))

        return self._grained(draw, frame, query, address.udim)

    def _blended(
        self, frame: Frame, query: MapQuery, addresses: Sequence[TileAddress]
    ) -> list[Buffer]:
        assert self._blend is not None
        blend, model, udim = self._blend, query.stretch, addresses[0].udim
        tiles = [self.bin_tile(address) for address in addresses]
        if query.sampling == "smooth":
            fields, located = self._fields(frame, model), self._located[udim]
            made = [blend.smooth_tile(maps, fields, located) for maps in tiles]
            return self._all_grained(made, frame, query, addresses)
        plain = [a for a, maps in zip(addresses, tiles, strict=True) if maps.stiffness is None]
        stiff = [a for a in addresses if a not in plain]
        found = dict(zip(plain, self._blended_plain(frame, model, plain), strict=True))
        others = [blend.stiff_tile(self.bin_tile(a), self._stretches(frame, model)) for a in stiff]
        found |= dict(zip(stiff, self._all_grained(others, frame, query, stiff), strict=True))
        return [found[address] for address in addresses]

    def _blended_plain(
        self, frame: Frame, model: str, addresses: list[TileAddress]
    ) -> list[Buffer]:
        """Tiles whose texels have no stiffness of their own."""
        assert self._blend is not None
        if not addresses:
            return []
        tiles, grains = [self.bin_tile(address) for address in addresses], None
        if self._shows_grain:
            grains = [self._grain_codes(a.udim, *self._place(a)) for a in addresses]
        return self._blend.tiles(tiles, self._coefficients(frame, model), grains)

    def _all_grained(
        self, made: list[Buffer], frame: Frame, query: MapQuery, addresses: Sequence[TileAddress]
    ) -> list[Buffer]:
        """Tiles with the grain of a frame added."""
        for out, address in zip(made, addresses, strict=True):
            if self._shows_grain:
                square = (*self._place(address), self.settings.tile_size)
                self._add_grain(out, frame, query, address.udim, square)
        return made

    def _place(self, address: TileAddress) -> tuple[int, int]:
        """Row and column of a tile's first texel."""
        texels = self.settings.grid.texels(address.level)
        return address.row * texels, address.column * texels

    def _coefficients(self, frame: Frame, model: str) -> Coefficients:
        assert self._blend is not None
        blend = self._blend
        return self._keep_of(
            frame, "coefficients", model,
            make=lambda: blend.coefficients(self._stretch_buffers(frame, model)),
        )  # fmt: skip

    def _stretches(self, frame: Frame, model: str) -> Buffer:
        assert self._blend is not None
        blend = self._blend
        return self._keep_of(
            frame, "stretches", model,
            make=lambda: blend.stretches(self._stretch_buffers(frame, model)),
        )  # fmt: skip

    def _kernels(self, frame: Frame, model: str) -> Buffer:
        return self._keep_of(
            frame, "kernels", model,
            make=lambda: self._convolve.kernels(
                self._stretch_buffers(frame, model), self.settings
            ),
        )  # fmt: skip

    def _convolving(
        self, frame: Frame, query: MapQuery, udim: int
    ) -> tuple[NeutralTiles, Callable[[NeutralTile], Buffer]]:
        """What makes the neutral tiles of a sampling, and what convolves them in a frame."""
        model, settings = query.stretch, self.settings
        if query.sampling == "nearest":
            kernels = self._kernels(frame, model)
            return self._convolve, lambda tile: self._convolve.tile(tile, kernels, settings)
        smooth = self._smooth_convolve
        fields, located = self._fields(frame, model), self._located[udim]
        return smooth, lambda tile: smooth.tile(tile, fields, located, settings)

    def _neutral_tile(
        self, maker: NeutralTiles, udim: int, row: int, column: int, side: int
    ) -> NeutralTile:
        """What is convolved for `side`² texels of level 0."""
        draw = self._lines(NEUTRAL_FRAME, MapQuery("neutral"), udim)
        return maker.neutral_tile(draw, self._located[udim], self.settings, udim, row, column, side)

    def _redrawing(self, frame: Frame, query: MapQuery, udim: int) -> Draw:
        return self._grained(self._lines(frame, query, udim), frame, query, udim)

    def _lines(self, frame: Frame, query: MapQuery, udim: int) -> Draw:
        """What draws wrinkles and pores of a frame, without grain."""
        scales = self._scales(frame, query, udim)
        return redrawing(self._device, self._elements[udim], self.settings, scales)

    def _scales(self, frame: Frame, query: MapQuery, udim: int) -> ScaleBuffers:
        device, elements, located = self._device, self._elements[udim], self._located[udim]
        model, sampling = query.stretch, query.sampling
        if sampling == "smooth":
            fields = self._fields(frame, model)
            make = partial(respond_smooth, device, elements, located, self.settings, fields)
        else:
            stretch = self._stretch_buffers(frame, model)
            make = partial(respond, device, elements, self.settings, stretch)
        return self._keep_of(frame, "scales", udim, model, sampling, make=make)

    def _make_bins(self, address: TileAddress) -> BinTile:
        elements, located = self._elements[address.udim], self._located[address.udim]
        maker = BinMaker(self._device, elements, located, self.settings, self._stiffness)
        return maker.tile(*self._place(address), self.settings.tile_size)
