"""The precomputed maps of an asset, read out of an engine map by map as whole UDIMs.

`Source` and the protocols below it are what a package needs of an engine.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.bin_manifest import BinManifest
from rhytid.domain.tiles import TileAddress
from rhytid.domain.units import millimetres
from rhytid.errors import SettingsError
from rhytid.exports.skin_package.texture_arrays import Paging
from rhytid.pipeline.bins import HEADROOM, map_count
from rhytid.pipeline.grain import relief

# The layers of the array of maps, in this order.
LAYERS = ("pores", "wrinkle_tilts", "grain")
# In arrays of their own, as sets of their samples.
WRINKLES, CUSHIONS = "wrinkles", "cushions"
LEAST_CODE = -127
Codes = NDArray[np.int8]


@dataclass(frozen=True, eq=False)
class Room:
    """maps: of a UDIM, (K, n, n) int8 by layer, of every bin those of its samples."""

    udim: int
    maps: dict[str, Codes]


@dataclass(frozen=True)
class SkinMaps:
    """The maps of an asset whose settings the shader knows.

    Raises SettingsError naming the setting that it does not.
    """

    engine: Source
    asset: str
    settings: AssetSettings
    bins: BinManifest

    @classmethod
    def of(cls, engine: Source, asset: str) -> SkinMaps:
        """Of a ready asset."""
        settings = AssetSettings.parse(engine.assets.info(asset).settings)
        check_settings(settings)
        if engine.assets.stiff(asset):
            raise SettingsError("the asset has a stiffness map: packages have none yet")
        return cls(engine, asset, settings, engine.tiles.bins(asset))

    @property
    def names(self) -> tuple[str, ...]:
        """Layers of the array of maps that are there."""
        return tuple(name for name in LAYERS if name in self.bins.layers)

    def count(self, name: str) -> int:
        """Maps of a layer."""
        return self.bins.layers[name] * len(self.bins.steps[name])

    @property
    def metres(self) -> float | None:
        """In a mesh unit; None where that is not known."""
        length = millimetres(self.settings.length_unit)
        return None if length is None else length / 1000.0

    @property
    def scale(self) -> float:
        """The largest displacement that is possible, mesh units."""
        return self.bins.scale_limit * (1.0 + HEADROOM) * self.bins.depth

    @property
    def cushion_side(self) -> int:
        """Samples a side of the cushions, with their apron."""
        assert self.bins.cushion is not None
        return self.settings.resolution // self.bins.cushion.factor + 2 * self.bins.cushion.apron

    def room(self, udim: int) -> Room:
        """Zeros for the maps of a UDIM."""
        sides = dict.fromkeys((WRINKLES, *self.names), self.settings.resolution)
        if self.bins.cushion is not None:
            sides[CUSHIONS] = self.cushion_side
        maps = {n: np.zeros((self.count(n), side, side), np.int8) for n, side in sides.items()}
        return Room(udim, maps)

    def fill(self, room: Room, address: TileAddress) -> None:
        """Put the codes of a tile in their places; of the cushions with their apron."""
        row, column = self.settings.grid.first_texel(address)
        for name, maps in room.maps.items():
            cushion = self.bins.cushion if name == CUSHIONS else None
            factor = 1 if cushion is None else cushion.factor
            y, x, samples = row // factor, column // factor, len(self.bins.steps[name])
            for i, out in enumerate(maps):
                n, sample = divmod(i, samples)
                codes = self.engine.tiles.bin_tile(self.asset, address, name, n, sample)
                # Grain goes down to -128, which R8_SNORM takes for -127.
                out[y : y + len(codes), x : x + len(codes)] = np.maximum(codes, LEAST_CODE)


def check_settings(settings: AssetSettings) -> None:
    """Raise SettingsError naming a setting that packages do not know, LimitError where WebGL2 has
    too few layers for the maps."""
    known: dict[str, tuple[object, Callable[[object], bool], str]] = {
        "angles": (settings.angles, lambda v: v == "uv", '"uv"'),
        "bins.bits": (settings.bins.bits, lambda v: v == 8, "8"),
        "bins.merge": (settings.bins.merge, lambda v: v != "mellow", "min, soft or signed"),
    }
    for name, (value, good, wanted) in known.items():
        if not good(value):
            raise SettingsError(f"{name} is {value}: packages are made where it is {wanted}")
    bins = settings.bins
    others = map_count(bins) - bins.count * bins.samples + (relief(settings) > 0.0)
    Paging.of(settings.resolution, max(others, bins.count))


class Source(Protocol):
    """An engine."""

    @property
    def assets(self) -> Assets:
        """Its assets."""

    @property
    def tiles(self) -> Tiles:
        """Their maps."""


class Assets(Protocol):
    """Facts of ready assets."""

    def info(self, asset: str) -> Facts:
        """Of one asset."""

    def stiff(self, asset: str) -> bool:
        """Whether a stiffness map came with it."""


class Facts(Protocol):
    """Of an asset."""

    @property
    def settings(self) -> dict[str, Any]:
        """All of them, resolved."""

    @property
    def udims(self) -> tuple[int, ...]:
        """With mesh."""


class Tiles(Protocol):
    """The precomputed maps of ready assets."""

    def bins(self, asset: str) -> BinManifest:
        """What maps there are."""

    def bin_tile(
        self,
        asset: str,
        address: TileAddress,
        layer: str,
        bin: int | None = None,
        sample: int | None = None,
    ) -> NDArray[np.integer]:
        """(n, n) codes of a tile of one map."""

    def triangles(self, asset: str, udim: int) -> NDArray[np.int32]:
        """(R, R) the triangle of each texel."""

    def cushion_triangles(self, asset: str, udim: int) -> NDArray[np.int32]:
        """(n, n) the triangle of each sample of the cushions."""
