"""The fast method of an asset: its precomputed maps by tile, their manifest, and tiles blended from
them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.device.launches import DrawingPace
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.bin_manifest import BinManifest, CushionLayer, GrainLayer, TiltLine
from rhytid.domain.tiles import TileAddress
from rhytid.engine.device_assets.additions import DeviceEvents, DeviceGrain
from rhytid.engine.device_assets.frames import DeviceFrames
from rhytid.engine.device_assets.mesh import DeferredWork, DeviceMesh
from rhytid.engine.frames import Frame
from rhytid.engine.messages import MapQuery
from rhytid.errors import NotFoundError, QueryError
from rhytid.pipeline.bin_maker import BinMaker, BinTile
from rhytid.pipeline.bins import (
    TILT_NODE,
    TILT_SHARE,
    TILTS,
    ShareRange,
    code_limit,
    layers,
    map_count,
    quantisation_steps,
    sample_stretches,
    tilt_width,
)
from rhytid.pipeline.cushion import (
    CUSHIONS,
    OWNERS,
    PLACES,
    bytes_a_sample,
    cushion_layers,
    cushion_samples,
    cushion_steps,
)
from rhytid.pipeline.cushion_layer import APRON
from rhytid.pipeline.events import EVENT_ANSWER, EVENT_LAYER, event_codes, event_steps
from rhytid.pipeline.grain import GRAIN, grain_amplitude, grain_exponent, relief
from rhytid.pipeline.reach import SCALE_LIMIT
from rhytid.pipeline.vectors import BYTES_A_TEXEL


class DeviceBins:
    """The precomputed maps of an asset, kept while there is memory (section 2.4)."""

    def __init__(
        self, base: DeviceMesh, frames: DeviceFrames, grain: DeviceGrain, events: DeviceEvents
    ) -> None:
        self._base, self._frames, self._grain, self._events = base, frames, grain, events

    def tile(self, address: TileAddress) -> BinTile:
        """The precomputed maps of a tile, made where they are not there. Raises DeferredWork where
        that takes long and the asset is `bounded`."""
        return self._tiles([address])[0]

    def _tiles(self, addresses: Sequence[TileAddress]) -> list[BinTile]:
        lacking = [address for address in addresses if not self.has(address)]
        if self._base.bounded and sum(map(self._work, lacking)) > self._pace(addresses[0]).most:
            raise DeferredWork(bins=lacking)
        keep = self._base.cache.keep
        return [keep("bins", a, make=partial(self._make, a)) for a in addresses]

    def has(self, address: TileAddress) -> bool:
        """Whether the maps of a tile are there; they stay until the task ends."""
        return self._base.cache.find("bins", address) is not None

    def make(self, *addresses: TileAddress) -> None:
        """Make and keep the maps of tiles where they are not there; on a thread that uses the
        device in steps, see `Device.in_steps`."""
        device = self._base.device
        for address in addresses:
            if not device.step(partial(self.has, address)):
                device.step(partial(self._keep, address, self._make(address)))
                device.hand_over()

    def _keep(self, address: TileAddress, tile: BinTile) -> None:
        """Keep maps that were made in steps, unless there are others by now."""
        if self._base.cache.keep("bins", address, make=lambda: tile) is not tile:
            tile.release()

    def _work(self, address: TileAddress) -> float:
        """The work of making the maps of a tile, at most: as if each map had all wrinkles and
        pores."""
        work = self._base.elements[address.udim].work.of(*self._base.square(address))
        return map_count(self._base.settings.bins) * work

    def _pace(self, address: TileAddress) -> DrawingPace:
        return self._base.elements[address.udim].bins_pace

    def codes(self, address: TileAddress, index: int) -> NDArray[np.integer]:
        """Codes (n, n) of one precomputed map; `index` counts samples within layers."""
        bins = self._base.settings.bins
        return self.tile(address).read(self._base.device, map_count(bins), index, bins.bits)

    def layer_codes(
        self, address: TileAddress, layer: str, bin: int | None, sample: int | None
    ) -> NDArray[np.integer]:
        """(n, n) codes of one map of the manifest; of the cushions n counts coarse samples, with
        the apron around them. Raises what `map_index` does."""
        settings, device = self._base.settings, self._base.device
        bin, sample = map_index(self.manifest(), layer, bin, sample)
        if layer == GRAIN:
            row, column, side = self._base.square(address)
            codes = self._grain.codes(address.udim, row, column)
            found: NDArray[np.integer] = device.read(codes, (side, side), np.int8)
            return found
        if layer == EVENT_LAYER:
            heights = self._events.heights(address.udim, self._base.square(address))
            return event_codes(heights, event_steps(self._events.tallest, settings))[sample]
        broad = cushion_layers(settings)
        if layer not in (*broad, OWNERS):
            return self.codes(address, layers(settings.bins)[layer][bin] + sample)
        cushion = self.tile(address).cushion
        assert cushion is not None
        if layer == OWNERS:
            rows = self._base.elements[address.udim].wrinkle_rows
            return rows[cushion.read_owners(device)]
        return cushion.read(device, broad[layer][0] + sample, settings.bins.bits)

    def manifest(self) -> BinManifest:
        """The manifest that clients need to blend the maps (docs/binned.md)."""
        base = self._base
        settings = base.settings
        found = _manifest(settings, base.cushion_factor, base.shares)
        if (tallest := self._events.tallest) == 0.0:
            return found
        exponent = EVENT_ANSWER * settings.response.beta_d
        return replace(
            found,
            layers={**found.layers, EVENT_LAYER: 1},
            steps={**found.steps, EVENT_LAYER: event_steps(tallest, settings)},
            depth_exponents={**found.depth_exponents, EVENT_LAYER: exponent},
        )

    def size(self) -> int:
        """Bytes that the level-0 maps of every UDIM need, as far as `BYTES_A_TEXEL` is right."""
        base, bins = self._base, self._base.settings.bins
        painted = () if base.stiffness is None else base.stiffness.maps
        a_texel = map_count(bins) * bins.bits / 8 + BYTES_A_TEXEL + self._grain.shows
        if base.cushion_factor is not None:
            a_texel += bytes_a_sample(base.settings) / base.cushion_factor**2
        sizes = (a_texel + 4 * (udim in painted) for udim in base.located)
        return round(sum(sizes) * base.settings.resolution**2)

    def blended(
        self, frame: Frame, query: MapQuery, addresses: Sequence[TileAddress]
    ) -> list[Buffer]:
        """float32 of different level-0 tiles of one UDIM, blended for a frame."""
        blend, model, udim = self._base.blend, query.stretch, addresses[0].udim
        tiles, lines = self._lined(frame, query, addresses)
        if query.sampling == "smooth":
            fields, located = self._frames.fields(frame, model), self._base.located[udim]
            made = [blend.smooth_tile(maps, fields, located, lines) for maps in tiles.values()]
            return self._grained(made, frame, query, addresses)
        plain = {at: maps for at, maps in tiles.items() if maps.stiffness is None}
        stiff = [at for at in addresses if at not in plain]
        found = dict(zip(plain, self._plain(frame, model, plain, lines), strict=True))
        stretches = self._frames.bin_stretches
        others = [blend.stiff_tile(tiles[at], stretches(frame, model), lines) for at in stiff]
        found |= dict(zip(stiff, self._grained(others, frame, query, stiff), strict=True))
        return [found[address] for address in addresses]

    def _lined(
        self, frame: Frame, query: MapQuery, addresses: Sequence[TileAddress]
    ) -> tuple[dict[TileAddress, BinTile], Buffer | None]:
        """The maps of tiles, and the log stretch of the lines by which their broad layers are
        blended: of a tile by itself of its own lines alone, where that is quicker."""
        tiles = dict(zip(addresses, self._tiles(addresses), strict=True))
        at, maps = next(iter(tiles.items()))
        if len(tiles) == 1 and maps.cushion is not None:
            own = self._frames.owner_lines(frame, query, at, maps.cushion)
            if own is not None:
                alone = replace(maps.cushion, owners=own.owners)
                return {at: replace(maps, cushion=alone)}, own.ends
        return tiles, self._frames.line_stretches(frame, query, at.udim)

    def _plain(
        self, frame: Frame, model: str, tiles: Mapping[TileAddress, BinTile], lines: Buffer | None
    ) -> list[Buffer]:
        """Tiles whose texels have no stiffness of their own."""
        if not tiles:
            return []
        grains = None
        if self._grain.shows:
            grains = [self._grain.codes(a.udim, *self._base.square(a)[:2]) for a in tiles]
        alone = next(iter(tiles.items())) if len(tiles) == 1 else None
        coefficients = self._frames.coefficients(frame, model, alone)
        return self._base.blend.tiles(list(tiles.values()), coefficients, grains, lines)

    def _grained(
        self, made: list[Buffer], frame: Frame, query: MapQuery, addresses: Sequence[TileAddress]
    ) -> list[Buffer]:
        """Tiles with the grain of a frame added."""
        if self._grain.shows:
            for out, address in zip(made, addresses, strict=True):
                self._grain.add(out, frame, query, address.udim, self._base.square(address))
        return made

    def _make(self, address: TileAddress) -> BinTile:
        base = self._base
        elements, located = base.elements[address.udim], base.located[address.udim]
        maker = BinMaker(base.device, elements, located, base.settings, base.stiffness)
        return maker.tile(*base.square(address))


def _manifest(
    settings: AssetSettings, cushion_factor: int | None, shares: ShareRange
) -> BinManifest:
    """The manifest of an asset with resolved settings.  cushion_factor: texels to a sample of the
    cushions.  shares: of its graph."""
    assert settings.depth is not None
    bins, response = settings.bins, settings.response
    factored = {"wrinkles": response.alpha_d, "pores": response.beta_d}
    tilt = TiltLine(TILT_NODE, TILT_SHARE, tilt_width(settings)) if bins.tilt else None
    return BinManifest(
        angles=tuple(float(np.pi * n / bins.count) for n in range(bins.count)),
        samples=tuple(sample_stretches(settings).tolist()),
        pore_samples=tuple(sample_stretches(settings, -1).tolist()),
        steps=_steps(settings, shares),
        bits=bins.bits,
        merge=bins.merge,
        depth_factored=bins.depth_factored,
        layers=_layers(settings),
        depth=settings.depth,
        sharpness=settings.shape.sharpness,
        log_stretch_limit=response.log_stretch_limit,
        scale_limit=SCALE_LIMIT,
        depth_exponents=factored if bins.depth_factored else dict.fromkeys(factored, 0.0),
        measured_in=settings.angles,
        tilt=tilt,
        soft_limits=response.soft_limits,
        pore_depth_limit=response.pore_depth_limit,
        cushion=_cushion(settings, cushion_factor),
        grain=GrainLayer(grain_exponent(settings)) if relief(settings) > 0.0 else None,
    )


def _cushion(settings: AssetSettings, factor: int | None) -> CushionLayer | None:
    if factor is None or settings.shape.cushion == 0.0:
        return None
    samples = tuple(cushion_samples(settings).tolist())
    return CushionLayer(factor, APRON, samples, settings.response.alpha_d)


def _layers(settings: AssetSettings) -> dict[str, int]:
    found = {name: len(firsts) for name, firsts in layers(settings.bins).items()}
    if settings.shape.cushion > 0.0:
        found |= dict.fromkeys((CUSHIONS, PLACES, OWNERS), 1)
    return {**found, GRAIN: 1} if relief(settings) > 0.0 else found


def _steps(settings: AssetSettings, shares: ShareRange) -> dict[str, tuple[float, ...]]:
    bins, steps = settings.bins, quantisation_steps(settings, shares)
    wrinkles, pores = (
        tuple(steps[layer, : bins.layer_samples[layer]].tolist()) for layer in (0, -1)
    )
    found = {name: pores if name.startswith("pore") else wrinkles for name in layers(bins)}
    if bins.tilt:
        found[TILTS] = (1.0 / code_limit(bins.bits),)
    if settings.shape.cushion > 0.0:
        found[CUSHIONS] = tuple(cushion_steps(settings, shares).tolist())
        found |= {PLACES: (1.0 / code_limit(bins.bits),), OWNERS: (1.0,)}
    if relief(settings) > 0.0:
        found[GRAIN] = (grain_amplitude(settings),)
    return found


def map_index(
    manifest: BinManifest, layer: str, bin: int | None, sample: int | None
) -> tuple[int, int]:
    """The bin and the sample of a map; 0 where the layer has only one, and none is given.

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
