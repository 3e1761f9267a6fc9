"""The precomputed maps of an asset, read out of an engine map by map as whole UDIMs.

`Source` and the protocols below it are what a package needs of an engine.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.bin_manifest import BinManifest
from rhytid.domain.lengths import millimetres
from rhytid.domain.painted_maps import Stiffness
from rhytid.domain.residual import Residual
from rhytid.domain.tiles import TileAddress
from rhytid.errors import SettingsError
from rhytid.exports.skin_package.cushion_lines import OwnerCount
from rhytid.exports.skin_package.texture_arrays import Paging
from rhytid.pipeline.bins import HEADROOM, map_count
from rhytid.pipeline.cushion import CUSHIONS, OWNERS, PLACES
from rhytid.pipeline.elements import LineSources
from rhytid.pipeline.events import EVENT_LAYER
from rhytid.pipeline.grain import relief

# The layers of the array of maps, in this order.
LAYERS = ("pores", "wrinkle_tilts", "grain", EVENT_LAYER)
# The layer that is stored as sets of its samples.
WRINKLES = "wrinkles"
LAST_CODE = 127
# What the textures of a residual have for code 0: they are not signed.
FIRST_CODE = 1 << 15
Codes = NDArray[np.integer]


@dataclass(frozen=True, eq=False)
class UdimMaps:
    """The maps of a UDIM by layer: (K, n, n) int8, for every bin those of its samples; owners
    int32.  owners: the lines that are among these so far."""

    udim: int
    maps: dict[str, Codes]
    owners: OwnerCount = field(default_factory=OwnerCount)


@dataclass(frozen=True)
class SkinMaps:
    """The precomputed maps of an asset whose settings the shader knows.

    residual: of a scanned skin.
    """

    engine: Source
    asset: str
    settings: AssetSettings
    bins: BinManifest
    residual: Residual | None = None

    @classmethod
    def of(cls, engine: Source, asset: str) -> SkinMaps:
        """The maps of a ready asset; raises SettingsError naming a setting that the shader does not
        know."""
        settings = AssetSettings.parse(engine.assets.info(asset).settings)
        check_settings(settings)
        stored = engine.assets.stored(asset)
        if stored.stiffness is not None:
            raise SettingsError("the asset has a stiffness map: packages have none yet")
        return cls(engine, asset, settings, engine.tiles.precomputed(asset), stored.residual)

    @property
    def names(self) -> tuple[str, ...]:
        """The layers of the array of maps that this asset has."""
        return tuple(name for name in LAYERS if name in self.bins.layers)

    def count(self, name: str) -> int:
        """How many maps a layer has."""
        return self.bins.layers[name] * len(self.bins.steps[name])

    @property
    def metres(self) -> float | None:
        """Metres in a mesh unit; None where the unit has no known length."""
        length = millimetres(self.settings.length_unit)
        return None if length is None else length / 1000.0

    @property
    def scale(self) -> float:
        """The largest displacement that is possible, mesh units."""
        events = LAST_CODE * self.bins.steps.get(EVENT_LAYER, (0.0,))[0]
        added = events + (0.0 if self.residual is None else self.residual.largest)
        return self.bins.scale_limit * (1.0 + HEADROOM) * self.bins.depth + added

    @cached_property
    def residual_steps(self) -> tuple[float, float] | None:
        """The length of a code of the residual and that of code 0, in all UDIMs alike; None where
        there is none."""
        if self.residual is None:
            return None
        return self.residual.common(self.engine.assets.info(self.asset).udims)

    def residual_codes(self, udim: int) -> NDArray[np.uint16]:
        """(1, R, R) the residual of a UDIM by `residual_steps`, 32768 for code 0."""
        assert self.residual is not None
        assert self.residual_steps is not None
        codes = self.residual.coded(udim, self.residual_steps, self.settings.resolution)
        numbers: NDArray[np.uint16] = codes[None].view(np.uint16) ^ np.uint16(FIRST_CODE)
        return numbers

    @property
    def cushion_side(self) -> int:
        """Samples per side of the cushions, with their apron."""
        assert self.bins.cushion is not None
        return self.settings.resolution // self.bins.cushion.factor + 2 * self.bins.cushion.apron

    def empty(self, udim: int) -> UdimMaps:
        """Zeros for the maps of a UDIM, for `fill`."""
        sides = dict.fromkeys((WRINKLES, *self.names), self.settings.resolution)
        if self.bins.cushion is not None:
            sides |= dict.fromkeys((CUSHIONS, PLACES, OWNERS), self.cushion_side)
        maps: dict[str, Codes] = {
            n: np.zeros((self.count(n), side, side), np.int32 if n == OWNERS else np.int8)
            for n, side in sides.items()
        }
        return UdimMaps(udim, maps)

    def fill(self, into: UdimMaps, address: TileAddress) -> None:
        """Read the codes of a tile from the engine into their places; those of cushions with their
        apron. Raises LimitError where more lines own samples than a texture holds."""
        row, column = self.settings.grid.first_texel(address)
        for name, maps in into.maps.items():
            cushion = self.bins.cushion if name in (CUSHIONS, PLACES, OWNERS) else None
            factor = 1 if cushion is None else cushion.factor
            y, x, samples = row // factor, column // factor, len(self.bins.steps[name])
            for i, out in enumerate(maps):
                n, sample = divmod(i, samples)
                codes = self.engine.tiles.precomputed_tile(self.asset, address, name, n, sample)
                out[y : y + len(codes), x : x + len(codes)] = codes
                if name == OWNERS:
                    into.owners.add(codes)


def check_settings(settings: AssetSettings) -> None:
    """Raise SettingsError naming a setting that packages do not know, LimitError where WebGL2 has
    too few layers for the maps."""
    known: dict[str, tuple[object, Callable[[object], bool], str]] = {
        "angles": (settings.angles, lambda v: v == "uv", '"uv"'),
        "bins.bits": (settings.bins.bits, lambda v: v == 8, "8"),
        "bins.merge": (settings.bins.merge, lambda v: v != "mellow", "min, soft or signed"),
    }
    for name, (value, good, rule) in known.items():
        if not good(value):
            raise SettingsError(f"{name} is {value}: packages are made where it is {rule}")
    bins = settings.bins
    others = map_count(bins) - bins.count * bins.samples + (relief(settings) > 0.0)
    Paging.of(settings.resolution, max(others, bins.count))


class Source(Protocol):
    """The engine that a package is made from."""

    @property
    def assets(self) -> Assets:
        """The assets of the engine."""

    @property
    def tiles(self) -> Tiles:
        """The precomputed maps of the assets."""


class Assets(Protocol):
    """Ready assets."""

    def info(self, asset: str) -> AssetFacts:
        """The facts of an asset."""

    def stored(self, asset: str) -> StoredSkin:
        """What came with an asset."""


class StoredSkin(Protocol):
    """What came with an asset that a package needs."""

    @property
    def stiffness(self) -> Stiffness | None:
        """A map of stiffness."""

    @property
    def residual(self) -> Residual | None:
        """What its graph does not draw."""


class AssetFacts(Protocol):
    """The facts of an asset that a package needs."""

    @property
    def settings(self) -> dict[str, Any]:
        """All settings, resolved."""

    @property
    def udims(self) -> tuple[int, ...]:
        """The UDIMs that the mesh has triangles in."""

    @property
    def wrinkles(self) -> int:
        """How many wrinkles it has."""


class Tiles(Protocol):
    """The precomputed maps of ready assets."""

    def precomputed(self, asset: str) -> BinManifest:
        """The maps that an asset has."""

    def precomputed_tile(
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

    def cushion_lines(self, asset: str, udim: int) -> LineSources:
        """What the wrinkles of a UDIM answer to stretch by."""
