"""The fields of synthesis as settings, painted maps and folds have them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.asset_settings import GraphSettings
from rhytid.domain.painted_maps import REGION_MAPS, Controls, Shares, signed
from rhytid.domain.skin import USUAL_AGE, regions
from rhytid.synthesis.fields import Factors, Fields
from rhytid.synthesis.fold_field import FoldField
from rhytid.synthesis.painting import PaintedDirections, PaintedMaps
from rhytid.synthesis.patches import Patches
from rhytid.synthesis.progress import row_blocks
from rhytid.synthesis.region_mix import RegionMix
from rhytid.synthesis.surface import Surface

# Painted and regional density together stay within; what is painted below BARE is bare.
_DENSITY = (1 / 6, 8.0)
BARE = 0.25
# How far lines wind about a painted direction, of what they do about preferred ones.
_PAINTED_BEND = 0.3
# The same about those of folds.
_FOLDED_BEND = 0.3
# How far directions of folds sway from patch to patch, of what others do.
_FOLDED_SWAY = 0.5
# How much more anisotropy counts where a direction is painted.
_PAINTED_HOLD = 1.0
# The `looks` of fields with patches, the smallest of which are 2 mm wide.
_PATCHED_LOOKS = 0.5
# More than what density is rounded by on its way to the spacing.
_SLACK = 1.0 + 1e-5
_FACTORS = ("density", "strength", "anisotropy", "scale", "pore_radius")
# Shares of a region with creases at which these begin, and are as deep as anywhere.
_NO_CREASES, _CREASED = np.float32(0.35), np.float32(0.85)
# What is left of swells and of patchiness where skin has creases.
_BLOTCHES = np.float32(0.5)
# What the level direction counts beside that of folds, for rhombi: a little more, so that there
# is a mean everywhere.
_LEVEL = 1.2
# The most that patches make of the height of events: higher bumps would be pebbles.
_HIGHEST = np.float32(1.4)


def fields_of(
    surface: Surface,
    settings: GraphSettings,
    controls: Controls | None,
    folds: FoldField | None = None,
    patches: Patches | None = None,
) -> Fields:
    """The fields of a surface; even skin without settings, maps, folds and patches."""
    plain = GraphSettings()
    even = all(
        getattr(settings, n) == getattr(plain, n) for n in ("region", "age", "turn", *_FACTORS[1:])
    )
    if controls is None and folds is None and patches is None and even:
        return Fields()
    return PaintedFields(surface, settings, controls or Controls({}), folds, patches)


class PaintedFields(Fields):
    """Fields from the settings, the regions, the maps and the folds of a surface.

    Factors of a setting, of the region, of a map and of folds are multiplied; painted values
    override folds, the more the farther they are from mid grey. Where pores are closer, lines and
    pores are as much smaller and shallower. `density` of the settings is not a field: it makes more
    wrinkles everywhere. Factors of patches come last, but for directions: painted ones override
    their sway.
    """

    def __init__(
        self,
        surface: Surface,
        settings: GraphSettings,
        controls: Controls,
        folds: FoldField | None = None,
        patches: Patches | None = None,
    ) -> None:
        self._surface, self._settings, self._folds = surface, settings, folds
        self._controls, self._patches = controls, patches
        self.some_contrast = settings.age != USUAL_AGE
        maps = controls.maps
        self._maps = {
            name: PaintedMaps(surface, maps[name]) for name in maps if name != "direction"
        }
        self._directions = (
            PaintedDirections(surface, maps["direction"]) if "direction" in maps else None
        )
        self._regions = RegionMix(settings, self._maps, folds)
        used = self._regions.used
        self._some_folded = folds is not None and any(skin.folded != 1.0 for skin in used)
        self.some_leading = folds is not None or any(skin.creases > 0.0 for skin in used)
        low, high = self._densities()
        self.least_spacing, self.most_spacing = high**-0.5, low**-0.5
        self.most_events = 2.0 if "events" in maps else 1.0
        self.some_bare = "density" in maps and self._darkest() < BARE
        shaping = [self._maps[name] for name in ("density", *REGION_MAPS) if name in maps]
        details = [lookup.detail for lookup in shaping]
        if folds is not None and self._regions.masks:
            details.append(folds.detail)
        if patches is not None:
            details.append(patches.detail)
            # With what is painted as without, or paint in one place would move pores in another.
            self.looks = _PATCHED_LOOKS
        self.detail = min(details, default=float("inf"))
        base = regions(settings.anatomy)[settings.region]
        self.usual_pore_radius = settings.pore_radius * base.pore_radius * base.density**-0.5

    @property
    def unpatched(self) -> Fields:
        """These without patches."""
        if self._patches is None:
            return self
        return fields_of(self._surface, self._settings, self._controls, self._folds)

    def spacing(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Factor of the distance between pores."""
        density = self._density(triangle, uv)
        if self._patches is not None:
            # Asked for at many places: alike in all regions, which are not looked up.
            amount = np.full(1, self._settings.patches, np.float32)
            density *= self._patches.factor("density", amount, triangle, uv)
        return self._spacing_of(density)

    def closest(self, triangle: NDArray[Any]) -> Factors:
        """(N,) factors that `spacing` is nowhere below in triangles (N,): by the regions of folds;
        where density or regions are painted, the least of all."""
        least = super().closest(triangle)
        planes = self._regions.planes_of("density")
        if planes is None or self._regions.painted or "density" in self._maps:
            return least
        density = np.exp(planes[4, triangle])
        if self._patches is not None:
            density *= self._patches.bounds("density", self._settings.patches)[1]
        found = self._spacing_of((density * _SLACK).astype(np.float32)) / np.float32(_SLACK)
        closest: Factors = np.maximum(found, least)
        return closest

    def _density(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Factor of pores by area, without patches."""
        density = self._regions.factor("density", triangle, uv)
        if "density" in self._maps:
            density *= density_of(self._maps["density"].at(triangle, uv))
        return density

    def _shallowness(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Factor of depth by how close pores are, without patches, so that these keep the mean."""
        spacing = self._spacing_of(self._density(triangle, uv))
        found: Factors = np.minimum(spacing, np.float32(1.0))
        return found

    def _spacing_of(self, density: Factors) -> Factors:
        found: Factors = np.clip(density, *_DENSITY) ** np.float32(-0.5)
        return found

    def _patched(
        self, factor: Factors, name: str, triangle: NDArray[Any], uv: NDArray[Any]
    ) -> Factors:
        """A factor (N,), multiplied in place by that of patches."""
        if self._patches is not None:
            factor *= self._patches.factor(name, self.patchiness(triangle, uv), triangle, uv)
        return factor

    def bare(self, triangle: NDArray[Any], uv: NDArray[Any]) -> NDArray[np.bool_]:
        """Whether the density map asks for less than BARE of the usual density."""
        if not self.some_bare:
            return super().bare(triangle, uv)
        found: NDArray[np.bool_] = density_of(self._maps["density"].at(triangle, uv)) < BARE
        return found

    def strength(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Factor of the weight of wrinkles; painted black is nothing, white is double."""
        factor = self._linear("strength", triangle, uv)
        factor *= self._shallowness(triangle, uv)
        return self._patched(factor, "strength", triangle, uv)

    def pore_strength(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Factor of the weight of pores: that of wrinkles without folds, times that of the
        region."""
        factor = self._linear("strength", triangle, uv, folded=False)
        factor *= self._shallowness(triangle, uv)
        factor *= self._regions.factor("pore_strength", triangle, uv)
        factor = self._patched(factor, "beside_lines", triangle, uv)
        return self._patched(factor, "pores", triangle, uv)

    def contrast(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Power of the weight of wrinkles: of the regions, by age."""
        return self._regions.factor("contrast", triangle, uv)

    def primary(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Factor of the strength of primary lines: that of the folds."""
        if self._folds is None:
            return super().primary(triangle, uv)
        factor = self._folds.factor("primary", triangle, uv)
        if self._some_folded:
            factor **= self._regions.factor("folded", triangle, uv)
        return factor

    def leading(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """How far skin has leaders: as the folds say, less in some regions."""
        if self._folds is None:
            return super().leading(triangle, uv)
        of_folds = self._folds.factor("leading", triangle, uv)
        return of_folds * self._regions.factor("leading", triangle, uv)

    def crossing(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """How far skin has long level leaders whatever else folds it: as the folds say, in the
        regions that have such."""
        if self._folds is None:
            return super().crossing(triangle, uv)
        found = self._folds.factor("crossing", triangle, uv)
        found *= self._regions.factor("crossed", triangle, uv)
        return found

    def frown(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """How far skin has a leader of a frown: as the folds say."""
        if self._folds is None:
            return super().frown(triangle, uv)
        return self._folds.factor("frown", triangle, uv)

    def fans(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """How far skin has the fan of a corner of the mouth: as the folds say."""
        if self._folds is None:
            return super().fans(triangle, uv)
        return self._folds.factor("fans", triangle, uv)

    def fanned(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Radians to the left from the level direction to a fan; painted directions take their
        place, and settings and maps turn them."""
        if self._folds is None:
            return super().fanned(triangle, uv)
        return self._turned(self._folds.fanned(triangle, uv), triangle, uv)

    def rings(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """How far skin has rings: of the regions, where folds are known; else the neck has none,
        whatever is painted elsewhere."""
        if self._folds is None:
            return super().rings(triangle, uv)
        return self._regions.factor("rings", triangle, uv)

    def rhombi(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """How far skin has rhombi: of the regions, where folds are known, as rings."""
        if self._folds is None:
            return super().rhombi(triangle, uv)
        return self._regions.factor("rhombi", triangle, uv)

    def along_rhombi(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Radians to the left from the level direction to the long way of rhombi: between that and
        the lines of folds, for those that slant would be upright beside the neck. Painted
        directions take its place, and settings and maps turn it."""
        found = np.zeros(len(triangle), np.float32)
        if self._folds is not None:
            folds = self._folds.blended_with(found, triangle, uv)
            found = np.float32(0.5) * np.angle(np.exp(2j * folds) + _LEVEL).astype(np.float32)
        return self._turned(found, triangle, uv)

    def creases(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """How far skin has creases: of the regions, not beyond the middle of their border. They
        are there from birth, and need no folds."""
        share = self.creased(triangle, uv)
        share -= _NO_CREASES
        share /= _CREASED - _NO_CREASES
        np.clip(share, 0.0, 1.0, out=share)
        return share

    def creased(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """How far skin is of a region with creases: of the regions."""
        return self._regions.factor("creases", triangle, uv)

    def crumpled(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """How far skin folds without one direction: as the folds say, in the regions whose lines
        are uneven."""
        if self._folds is None:
            return super().crumpled(triangle, uv)
        return self._folds.factor("crumpled", triangle, uv) * self.uneven(triangle, uv)

    def uneven(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """How far lines differ from those beside them: of the regions."""
        return self._regions.factor("uneven", triangle, uv)

    def rays(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """How far skin is of a region from whose border age draws rays: of the regions."""
        return self._regions.factor("rays", triangle, uv)

    def turn(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Radians to the left from the level direction. Painted directions, then folds, take the
        place of the preferred direction and of the turn of a region; patches sway about it, about
        folds less."""
        found = np.radians(self._regions.factor("turn", triangle, uv))
        if self._folds is not None:
            found = self._folds.blended_with(found, triangle, uv)
        if self._patches is not None:
            found += self._patches.turn(self._sway(triangle, uv), triangle, uv)
        return self._turned(found, triangle, uv)

    def slant(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Radians by which the main lines run to the right of the preferred direction, folded or
        not: of the regions, none where directions are painted."""
        found: Factors = np.radians(self._regions.factor("slant", triangle, uv))
        if self._directions is not None:
            found *= 1.0 - self._directions.certainty(triangle, uv)
        return found

    def upright(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Radians to the left from the level direction to creases: painted directions take the
        place of the upright one, and settings and maps turn it."""
        return self._turned(super().upright(triangle, uv), triangle, uv)

    def _turned(self, found: Factors, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Directions (N,), changed in place by painted ones, and turned by settings and maps."""
        if self._directions is not None:
            for rows in row_blocks(len(triangle)):
                found[rows] = self._directions.blended_with(found[rows], triangle[rows], uv[rows])
        found += np.float32(np.radians(self._settings.turn))
        if "turn" in self._maps:
            found += np.float32(0.5 * np.pi) * signed(self._maps["turn"].at(triangle, uv))
        return found

    def _sway(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """The patchiness of directions."""
        amount = self.patchiness(triangle, uv)
        if self._folds is not None:
            certainty = self._folds.factor("certainty", triangle, uv)
            amount *= 1.0 - np.float32(1.0 - _FOLDED_SWAY) * certainty
        return amount

    def bend(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Factor of how far lines wind: less about folds and painted directions."""
        factor = self._regions.factor("bend", triangle, uv)
        if self._folds is not None:
            certainty = self._folds.factor("certainty", triangle, uv)
            factor += np.minimum(np.float32(_FOLDED_BEND) - factor, np.float32(0.0)) * certainty
        if self._directions is not None:
            certainty = self._directions.certainty(triangle, uv)
            factor += (np.float32(_PAINTED_BEND) - factor) * certainty
        return factor

    def anisotropy(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """How far walkers follow directions: painted black is none, white is double, 2 is the most.
        Where a direction is painted it is doubled, so that the second family of lines joins it: the
        mean would lie between the two."""
        found = self._linear("anisotropy", triangle, uv)
        if self._directions is not None:
            found *= 1.0 + np.float32(_PAINTED_HOLD) * self._directions.certainty(triangle, uv)
        return found.clip(0.0, 2.0)

    def width(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Factor of the width of wrinkles: painted a quarter to four times, and as the spacing.
        With age it is larger where skin folds."""
        factor = self._sized("scale", triangle, uv)
        if self._folds is not None and self._settings.age != USUAL_AGE:
            factor *= self._folds.factor("width", triangle, uv)
        return factor

    def pore_radius(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Factor of the radius of pores: painted a quarter to four times, and as the spacing."""
        factor = self._sized("pore_radius", triangle, uv)
        return self._patched(factor, "pore_radius", triangle, uv)

    def grain(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Factor of the micro relief: of the regions, by age. No map changes it."""
        return self._regions.factor("grain", triangle, uv)

    def undulation(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Factor of the broad swells: of the regions, less where skin has creases. No map changes
        it."""
        factor = self._regions.factor("undulation", triangle, uv)
        return self._between_creases(factor, triangle, uv)

    def of_regions(
        self, values: Mapping[str, float], triangle: NDArray[Any], uv: NDArray[Any]
    ) -> Factors:
        """Values of the regions, mixed by their masks as factors are."""
        return self._regions.mixed(values, triangle, uv)

    def events(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Factor of the number of events; painted black is none, white is double."""
        if "events" not in self._maps:
            return super().events(triangle, uv)
        found: Factors = np.float32(1.0) + signed(self._maps["events"].at(triangle, uv))
        return found

    def event_strength(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Factor of the height of events: less where strength is painted dark."""
        if "strength" not in self._maps:
            return super().event_strength(triangle, uv)
        dark = np.minimum(signed(self._maps["strength"].at(triangle, uv)), np.float32(0.0))
        return np.asarray(np.float32(1.0) + dark)

    def event_patches(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Factor of the height of events that follow patches: with the strength of lines, as far as
        the regions say, so that few stand out on quiet skin."""
        if self._patches is None:
            return super().event_patches(triangle, uv)
        amount = self._regions.factor("event_patches", triangle, uv)
        amount *= np.float32(self._settings.patches)
        found: Factors = np.minimum(self._patches.factor("events", amount, triangle, uv), _HIGHEST)
        return found

    def patchiness(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """How far skin varies from patch to patch: of the regions, less where skin has creases,
        times that of the settings."""
        if self._patches is None:
            return super().patchiness(triangle, uv)
        found = self._regions.factor("patchiness", triangle, uv)
        found *= np.float32(self._settings.patches)
        return self._between_creases(found, triangle, uv)

    def _between_creases(
        self, factor: Factors, triangle: NDArray[Any], uv: NDArray[Any]
    ) -> Factors:
        """A factor (N,), in place less where skin has creases: more would make blotches of them."""
        if self._settings.rank > 0.0:
            power = np.float32(min(self._settings.rank, 1.0)) * self.creased(triangle, uv)
            factor *= _BLOTCHES**power
        return factor

    def _linear(
        self, name: str, triangle: NDArray[Any], uv: NDArray[Any], *, folded: bool = True
    ) -> Factors:
        factor: Factors = self._regions.factor(name, triangle, uv) * np.float32(
            getattr(self._settings, name)
        )
        painted = signed(self._maps[name].at(triangle, uv)) if name in self._maps else None
        if painted is not None:
            factor *= 1.0 + painted
        if self._folds is not None and folded:
            folds = self._folds.factor(name, triangle, uv)
            left = np.float32(1.0) if painted is None else 1.0 - np.abs(painted)
            if name == "anisotropy" and self._directions is not None:
                left = left * (1.0 - self._directions.certainty(triangle, uv))
            if name == "strength" and self._some_folded:
                left = left * self._regions.factor("folded", triangle, uv)
            factor *= folds**left
        return factor

    def _sized(self, name: str, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        factor: Factors = self._regions.factor(name, triangle, uv) * np.float32(
            getattr(self._settings, name)
        )
        if name in self._maps:
            factor *= np.float32(4.0) ** signed(self._maps[name].at(triangle, uv))
        factor *= self.spacing(triangle, uv)
        return factor

    def _darkest(self) -> float:
        """The least of the density map."""
        return float(density_of(np.float32(self._maps["density"].least)))

    def _densities(self) -> tuple[float, float]:
        """The least and the largest density of skin that is not bare."""
        regional = [skin.density for skin in self._regions.used]
        low, high = min(regional), max(regional)
        if "density" in self._maps:
            most = float(density_of(np.float32(self._maps["density"].most)))
            low, high = low * max(self._darkest(), BARE), high * most
        if self._patches is not None:
            bounds = self._patches.bounds("density", self._settings.patches)
            low, high = low * bounds[0], high * bounds[1]
        # Nothing is to be cut off, whatever else is painted.
        slack = 1e-6 if (low, high) != (1.0, 1.0) else 0.0
        low, high = np.clip([low * (1.0 - slack), high * (1.0 + slack)], *_DENSITY)
        return float(low), float(high)


def density_of(grey: Shares) -> Shares:
    """Black is 0, mid grey 1, white 4: as many times more lines to a length as it is brighter."""
    found: Shares = (np.float32(1.0) + signed(grey)) ** 2
    return found
