"""What the regions of a face have at places of its surface, mixed by their masks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.asset_settings import GraphSettings
from rhytid.domain.painted_maps import NEUTRALS, REGION_MAPS, REGION_PREFIX
from rhytid.domain.skin import Region, aged, regions
from rhytid.synthesis.fields import Factors
from rhytid.synthesis.fold_field import FoldField, Planes
from rhytid.synthesis.painting import PaintedMaps

# What regions have that is no factor, and is mixed as it is.
_PLAIN = (
    *("turn", "slant", "crossed", "rings", "rhombi", "creases", "uneven", "rays"),
    "event_patches",
)


class RegionMix:
    """Values of regions by painted masks, by those of folds, and elsewhere by the region of the
    settings.

    maps: painted ones by name, of which masks of regions are used.  painted: the names of these
    masks.  masks: regions that folds have masks of and that are not painted.
    """

    def __init__(
        self, settings: GraphSettings, maps: Mapping[str, PaintedMaps], folds: FoldField | None
    ) -> None:
        self._base, self._maps, self._folds = settings.region, maps, folds
        known = regions(settings.anatomy).items()
        self._skin = {name: aged(region, settings.age) for name, region in known}
        self.painted = [name for name in REGION_MAPS if name in maps]
        masks = () if folds is None else folds.regions
        self.masks = [name for name in masks if REGION_PREFIX + name not in maps]
        self._planes: dict[str, Planes | None] = {}

    @property
    def used(self) -> list[Region]:
        """The regions that some skin may be of, at its age."""
        return [self._skin[name] for name in self._names()]

    def factor(self, name: str, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """A factor, or one of _PLAIN, of the regions, mixed by their masks: factors by their
        logarithms."""
        values = self._values_of(name)
        planes = self.planes_of(name)
        if not self.painted and not self.masks:
            # As an array, so that it is rounded as where a mask of black is painted.
            base = np.full(1, values[self._base], np.float32)
            return np.repeat(np.asarray(_meant(base, name)), len(triangle))
        mixed = self._masked(values, planes, triangle, uv)
        return np.asarray(_meant(mixed, name), np.float32)

    def mixed(
        self, values: Mapping[str, float], triangle: NDArray[Any], uv: NDArray[Any]
    ) -> Factors:
        """Values by the name of a region, mixed as factors are."""
        return self._masked(values, self._mixed(values), triangle, uv)

    def planes_of(self, name: str) -> Planes | None:
        """`_mixed` of what `factor` has by this name."""
        if name not in self._planes:
            self._planes[name] = self._mixed(self._values_of(name))
        return self._planes[name]

    def _values_of(self, name: str) -> dict[str, float]:
        return {region: _value(self._skin[region], name) for region in self._names()}

    def _masked(
        self,
        values: Mapping[str, float],
        planes: Planes | None,
        triangle: NDArray[Any],
        uv: NDArray[Any],
    ) -> Factors:
        """Values of the regions, mixed: painted masks count first, then those of folds, by the
        planes that `_mixed` has of these values; the rest is the region of the settings."""
        if not self.painted and planes is not None and self._folds is not None:
            return self._folds.at(planes, triangle, uv)
        total, mixed = np.zeros(len(triangle), np.float32), np.zeros(len(triangle), np.float32)
        for region in self.painted:
            weight = self._maps[region].at(triangle, uv, neutral=NEUTRALS[region])
            mixed += weight * np.float32(values[region.removeprefix(REGION_PREFIX)])
            total += weight
        mixed /= np.maximum(total, 1.0)
        left = np.maximum(1.0 - total, 0.0)
        if self._folds is not None and planes is not None:
            left *= self._folds.at(planes, triangle, uv)
        else:
            left *= np.float32(values[self._base])
        mixed += left
        return mixed

    def _mixed(self, values: Mapping[str, float]) -> Planes | None:
        """Values of regions mixed by the masks of the folds, the region of the settings where these
        leave something; None where the folds have none."""
        if self._folds is None or not self.masks:
            return None
        masked = {region: values[region] for region in self.masks}
        return self._folds.mixed(masked, values[self._base])

    def _names(self) -> list[str]:
        """Of all regions that some skin may be."""
        painted = [name.removeprefix(REGION_PREFIX) for name in self.painted]
        return [self._base, *painted, *self.masks]


def _value(region: Region, name: str) -> float:
    value = float(getattr(region, name))
    return value if name in _PLAIN else float(np.log(value))


def _meant(value: Any, name: str) -> Any:
    """The inverse of `_value`."""
    return value if name in _PLAIN else np.exp(value)
