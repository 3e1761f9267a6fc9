"""The settings of an asset: defaults, ranges and meanings. Unknown keys are refused.

What the docstrings say of a setting is shown in the OpenAPI document and in
docs/reference/settings.md: Markdown without links.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import PureWindowsPath
from typing import Any, TypeVar

from rhytid.domain.expressions import LINES
from rhytid.domain.graph import MOST_SEED, GraphOrigin
from rhytid.domain.lengths import GRAIN, UNDULATION, USUAL_UNIT, Lengths, usual_spacing
from rhytid.domain.setting_fields import choice, number, power_of_two, read, text, whole
from rhytid.domain.skin import (
    ANATOMIES,
    COARSE,
    FINE,
    OLDEST,
    REGIONS,
    USUAL_AGE,
    WHOLE_FACE,
    YOUNGEST,
)
from rhytid.domain.tiles import TileGrid
from rhytid.errors import SettingsError

MOST_WRINKLES = 40_000_000
USUAL_SEED = 1
# Characters of a name.
LONGEST_NAME = 80
T = TypeVar("T")
# Up to this strength a wrinkle swells nothing, from twice as much on in full; linear between.
CUSHION_THRESHOLD = 0.08


@dataclass(frozen=True)
class GraphSettings:
    """How the wrinkle graph is synthesised (section 2.1, after Weiss et al. 2023).

    Factors hold for the whole mesh, times what `region` and painted maps say of a place. How many
    wrinkles there are follows from `spacing` and the area, unless `wrinkles` says it: then the
    spacing follows.

    spacing: mean distance from a pore to the nearest where density is 1, mesh units; null is 0.5 mm
        through `unit`
    wrinkles: wrinkles to synthesise on skin of density 1 everywhere, where no region is known and
        nothing is painted; null is as many as area and spacing make; a number fixes the spacing
        instead
    seed: start of the random numbers: another seed gives another skin of the same kind; null is
        what a given graph says, else 1
    neighbours: candidate edges of a pore
    lines: what lines run by: `"expressions"`, across what they fold; `"level"`, around the vertical
        axis; null or `"auto"`, by expressions where there are any
    region: what skin it is where no mask says otherwise: `face`, `forehead`, `cheek`, `nose`,
        `lip`, `eye_corner`, `neck` or `mouth`
    age: age of the skin: deeper, wider and fewer lines, most where skin folds; pores stay
    density: factor of the number of wrinkles
    strength: factor of the strength of each wrinkle and pore, 1 at most: 2 is twice as deep where
        one lies alone; where many overlap the relief grows less, and grain and undulation stay;
        `depth` scales all of it
    turn: degrees by which lines turn left of the preferred ones
    anisotropy: how far lines keep to their direction: 0 any way, 2 one direction alone
    scale: factor of the width of wrinkles
    pore_radius: factor of the radius of pores
    rank: how far lines come in orders, few long deep leaders before secondary and fine ones; 0 is
        one order of lines over primary ones
    patches: how far strength, density, pore size and direction of lines vary from one patch of 2 to
        10 mm to the next, times what `region` makes of it; 0 is even skin
    events: factor of the number of single features: follicle bumps, papules, scars, milia, moles
        and clusters of enlarged pores; 0 is none
    anatomy: how finely regions are told apart: `"fine"`, by expressions of known names the mouth
        and the chin, too, and the lips up to their border; `"coarse"`, without these, with one
        relief of broad swells, and with directions of lines that few expressions show as well as
        many
    """

    spacing: float | None = number(None, 1e-30, 1e30)
    wrinkles: int | None = whole(None, 100, MOST_WRINKLES)
    seed: int | None = whole(None, 0, MOST_SEED)
    neighbours: int = whole(8, 4, 16)
    lines: str | None = choice(None, None, *LINES)
    region: str = choice(WHOLE_FACE, *REGIONS)
    age: float = number(USUAL_AGE, YOUNGEST, OLDEST)
    density: float = number(1.0, 1 / 16, 16.0)
    strength: float = number(1.0, 0.0, 4.0)
    turn: float = number(0.0, -180.0, 180.0)
    anisotropy: float = number(1.0, 0.0, 2.0)
    scale: float = number(1.0, 1 / 4, 4.0)
    pore_radius: float = number(1.0, 1 / 4, 4.0)
    rank: float = number(1.0, 0.0, 2.0)
    patches: float = number(1.0, 0.0, 2.0)
    events: float = number(1.0, 0.0, 4.0)
    anatomy: str = choice(FINE, *ANATOMIES)

    @property
    def start(self) -> int:
        """The seed; the usual one where none is set."""
        return USUAL_SEED if self.seed is None else self.seed


@dataclass(frozen=True)
class ResponseSettings:
    """Exponents of Alg. 1 (alpha, wrinkles) and Alg. 2 (beta, pores), and their limits.

    With soft limits, log stretch and the logs of the scales bend from half of their limit on and
    are level at one and a half times it. The limit of all scales is 4.

    alpha_w: how much stretch widens a wrinkle (Alg. 1)
    alpha_d: how much stretch flattens a wrinkle (Alg. 1)
    beta_w: how much stretch widens a pore (Alg. 2)
    beta_d: how much stretch flattens a pore (Alg. 2)
    log_stretch_limit: largest absolute log stretch, against sliver triangles
    ends: how far the log stretch at the ends of a wrinkle goes from its own, 0, to the mean of its
        own and that of the wrinkle that continues it there, 1; width and strength follow from it at
        each end and are linear between
    soft_limits: log stretch and scales bend into their limits, in place of a clamp
    pore_depth_limit: how many times as deep a pore becomes at most; wrinkles 4 times
    folds: share of the shortening that folds of the mesh itself take which lines then do not show
        again; 0 is none
    """

    alpha_w: float = number(1.0, 0.0, 64.0)
    alpha_d: float = number(4.0, 0.0, 64.0)
    beta_w: float = number(4.0, 0.0, 64.0)
    beta_d: float = number(10.0, 0.0, 64.0)
    log_stretch_limit: float = number(0.5, 0.01, 4.0)
    ends: float = number(1.0, 0.0, 1.0)
    soft_limits: bool = choice(True, False, True)
    pore_depth_limit: float = number(1.25, 1.1, 4.0)
    folds: float = number(1.0, 0.0, 1.0)


@dataclass(frozen=True)
class ShapeSettings:
    """The profile (1 - t²)²(1 - b t²), and how heights x meet: log(1 + Σ(e^{βx} - 1)/n)/β, valleys
    and bulges apart; β is the sharpness, n the slots.

    `curvature` and `taper` are shares of the slopes, and of the strengths and half widths at the
    ends of wrinkles, that the graph has.

    wrinkle_bulge: the bulge beside a furrow; 2.5 suits skin without cushions, 7 displaces no volume
    pore_bulge: the bulge around a pore; 4 displaces no volume
    sharpness: beta of the mellow-max by which heights meet
    slots: n of the mellow-max; 1 keeps the depth of a lone wrinkle, 16 is softer
    wave_amplitude: how far wrinkles swing across their straight line, mesh units, at most a fifth
        of their length; 0 is straight
    wave_frequency: waves per mesh unit; null is what a given graph says, else 0.4 per pore spacing
    curvature: how much of its bends a wrinkle is drawn with; 0 is straight
    taper: how much strength and width change along a wrinkle, from one end to the other; 0 is even
    least_half_width: least half width, texels: what is narrower is drawn that wide and shallower to
        match, so that it does not break into dots; 0 is off
    cushion: share of the depth of wrinkles that a second, broad layer of them carries, so that skin
        swells between furrows; lines of strength 0.08 or less are in the narrow one only; 0 is off
    cushion_width: how many times as wide as a furrow the broad layer is; of a wrinkle with
        `edge_metric`, in that metric
    cushion_sharpness: beta of the mellow-max by which heights meet in the broad layer
    grain: root mean square of the micro relief between lines, in depths, times what region and age
        make of it; 0 is off
    grain_size: largest wavelength of the grain, mesh units; null is what a given graph says, else
        0.2 mm where `unit` is a length, else 0.36 of the pore spacing
    undulation: root mean square of broad swells of the skin, in depths; 0 is off
    undulation_size: largest wavelength of the swells, mesh units; the smallest is an eighth of it;
        null is what a given graph says, else 6 mm where `unit` is a length, else 10.8 of the pore
        spacing
    """

    # Above 9 a bulge would rise over the depth of its furrow, past what the sums can hold.
    wrinkle_bulge: float = number(1.0, 0.0, 9.0)
    pore_bulge: float = number(0.0, 0.0, 9.0)
    sharpness: float = number(20.0, 0.1, 20.0)
    slots: int = whole(1, 1, 1024)
    wave_amplitude: float = number(0.0, 0.0, 1e30)
    wave_frequency: float | None = number(None, 1e-30, 1e30)
    curvature: float = number(1.0, 0.0, 1.0)
    taper: float = number(1.0, 0.0, 1.0)
    least_half_width: float = number(0.7, 0.0, 4.0)
    cushion: float = number(0.7, 0.0, 1.0)
    cushion_width: float = number(3.3, 1.0, 8.0)
    cushion_sharpness: float = number(5.0, 0.1, 12.0)
    grain: float = number(0.02, 0.0, 1.0)
    grain_size: float | None = number(None, 1e-30, 1e30)
    undulation: float = number(0.18, 0.0, 1.0)
    undulation_size: float | None = number(None, 1e-30, 1e30)


@dataclass(frozen=True)
class BinSettings:
    """The precomputed maps of the fast method (section 2.4); the defaults are the paper's.

    count: orientation bins, N
    samples: stretches that each bin is drawn at, M
    pore_samples: stretches that the pores are drawn at; null is `bins.samples`
    bits: bits per code of the precomputed maps
    merge: how bins meet: `min`, the deepest wins; `soft`, the two deepest valleys meet softly and
        the highest bulge is added; `signed`, by the mellow-max as wrinkles meet, from one signed
        map; `mellow`, the same from two maps, valleys and bulges
    depth_factored: draw maps without their depth scale and multiply it on later, so that depth
        follows stretch beyond `bins.r_max`
    tilt: one more map per bin says where in it each wrinkle runs, so that depth follows its own
        angle; needs `bins.depth_factored`
    reach: the outer samples lie at this times `bins.r_max`, up to `response.log_stretch_limit`
    r_max: log stretch that most of the skin stays within; calibrated from a frame
    """

    count: int = choice(4, 1, 2, 4, 8, 16)
    samples: int = choice(3, 3, 5, 7)
    pore_samples: int | None = choice(None, None, 3, 5, 7)
    bits: int = choice(8, 8, 16)
    merge: str = choice("min", "min", "soft", "signed", "mellow")
    depth_factored: bool = choice(False, False, True)
    tilt: bool = choice(False, False, True)
    reach: float = number(1.0, 1.0, 4.0)
    r_max: float = number(0.2, 0.01, 4.0)

    @property
    def layer_samples(self) -> tuple[int, ...]:
        """How many stretches each layer is drawn at: one number a bin, then that of the pores."""
        return (self.samples,) * self.count + (self.pore_samples or self.samples,)


@dataclass(frozen=True)
class ConvolveSettings:
    """How the neutral map is blurred and sharpened (after Nagano et al. 2015).

    The published fit is not public: these gains are ours. 4 is `alpha_d`, so that to first order
    features much finer than `sigma` lose and gain as much depth as Alg. 1 takes and gives.

    blur_gain: how much stretch blurs lines and pores, for `convolved`; grain and undulation are
        added after its kernel, as in every method
    sharpen_gain: how much compression sharpens them, for `convolved`
    sigma: standard deviation of the Gaussian of `convolved`, mesh units; null is what a given graph
        says, else 0.25 of the pore spacing
    """

    blur_gain: float = number(4.0, 0.0, 64.0)
    sharpen_gain: float = number(4.0, 0.0, 64.0)
    sigma: float | None = number(None, 1e-30, 1e30)


@dataclass(frozen=True)
class Preset:
    """The settings that a preset sets: all of the bins but for `r_max`, and some keys of
    `response`, `shape` and `graph`, the same keys in every preset. Those of `graph` count where
    skin is grown: a change of the preset leaves the graph of an asset as it is."""

    bins: BinSettings
    response: Mapping[str, Any]
    shape: Mapping[str, Any]
    graph: Mapping[str, Any]


# As the paper draws: hard limits, straight even lines, nothing done for lines below a texel, flat
# plates; and one order of lines on even skin.
_PAPER_RESPONSE = {"ends": 0.0, "soft_limits": False, "pore_depth_limit": 4.0, "folds": 0.0}
_PAPER_GRAPH = {"rank": 0.0, "patches": 0.0, "events": 0.0, "anatomy": COARSE}
_PAPER_SHAPE = {
    "wrinkle_bulge": 2.5,
    "curvature": 0.0,
    "taper": 0.0,
    "least_half_width": 0.0,
    "cushion": 0.0,
    "grain": 0.0,
    "undulation": 0.0,
}


def _usual(settings: Any, names: Mapping[str, Any]) -> dict[str, Any]:
    return {name: getattr(settings, name) for name in names}


# The bins of `best` came closest to `redraw` of all that were measured at no more than twice the
# time of `paper`, the paper's own choice. Its other settings are the defaults.
PRESETS: dict[str, Preset] = {
    "paper": Preset(BinSettings(), _PAPER_RESPONSE, _PAPER_SHAPE, _PAPER_GRAPH),
    "best": Preset(
        BinSettings(pore_samples=5, merge="soft", depth_factored=True, tilt=True, reach=1.25),
        _usual(ResponseSettings(), _PAPER_RESPONSE),
        _usual(ShapeSettings(), _PAPER_SHAPE),
        _usual(GraphSettings(), _PAPER_GRAPH),
    ),
}
DEFAULT_PRESET = "best"


@dataclass(frozen=True)
class AssetSettings:
    """Everything that can be set for an asset; `None` is resolved when the asset is built.

    Naming a `preset` sets the bins but for `r_max`, how lines and limits are drawn, and how skin is
    grown (`Preset`).

    unit: length unit of the mesh, written into files: mm, cm, dm, m, um, in or ft, or a number of
        one, as `"5.5cm"`; or any other where no length follows from it; null is that of a given
        graph, else cm
    resolution: texels per side
    tile_size: texels per side of a tile, `resolution` at most; where it is not given and the
        default is above the resolution, it is the resolution
    depth: depth of a wrinkle of strength 1, mesh units; null is what a given graph says, else 0.15
        of the pore spacing: 75 µm by default, more with `graph.age` above 35
    padding: texels around the UV charts that take the nearest triangle
    angles: where angles between wrinkles and axes of stretch are taken: in UV, as the paper does,
        or in the neutral tangent plane (`"surface"`)
    preset: choice of bins, the closest to `redraw` at no more than twice the paper's time, with
        lines that bend and soft limits, grown with rank, patches and events; or `"paper"`, which
        has none of these, in any method; keys of `bins`, `shape`, `response` and `graph` beside it
        override it. A PATCH of it sets all of its keys anew, those too that were given before, as
        `response.folds`, but for `graph` and `bins.r_max`
    name: what people call the asset; null is the name of the mesh's file without its ending where
        an asset is sent, none in a PATCH. The same content with another name is the same asset, and
        keeps the name that it has
    """

    unit: str | None = text(None, 16)
    resolution: int = power_of_two(4096, 256, 16384)
    tile_size: int = power_of_two(512, 64, 4096)
    depth: float | None = number(None, 1e-30, 1e30)
    padding: int = whole(16, 0, 64)
    angles: str = choice("uv", "uv", "surface")
    preset: str = choice(DEFAULT_PRESET, *PRESETS)
    graph: GraphSettings = field(default_factory=GraphSettings)
    response: ResponseSettings = field(default_factory=ResponseSettings)
    shape: ShapeSettings = field(default_factory=ShapeSettings)
    bins: BinSettings = field(default_factory=lambda: PRESETS[DEFAULT_PRESET].bins)
    convolve: ConvolveSettings = field(default_factory=ConvolveSettings)
    name: str | None = text(None, LONGEST_NAME)

    @classmethod
    def parse(cls, data: Any, beside: tuple[str, ...] = ()) -> AssetSettings:
        """Settings from decoded JSON; keys that are left out have their defaults.

        beside: keys that were read and taken out before. Raises SettingsError naming the path of
        the first key or value that is wrong.
        """
        usual = cls()
        name = data.get("preset") if isinstance(data, Mapping) else None
        if isinstance(name, str) and name in PRESETS:
            usual = replace(usual, graph=replace(usual.graph, **PRESETS[name].graph))
        return usual.changed(data, beside)

    def changed(self, data: Any, beside: tuple[str, ...] = ()) -> AssetSettings:
        """A copy with the values of `data`, decoded JSON of the same nesting; `beside` and raises
        as `parse`. A preset in it leaves `graph` as it is."""
        if not isinstance(data, Mapping):
            raise SettingsError(f"settings are {type(data).__name__}: must be a JSON object")
        settings = read(self._with_preset(data.get("preset")), data, beside=beside)
        if "tile_size" not in data:
            settings = replace(settings, tile_size=min(settings.tile_size, settings.resolution))
        if settings.tile_size > settings.resolution:
            raise SettingsError(f"tile_size {settings.tile_size} is above the resolution")
        if settings.bins.r_max > settings.response.log_stretch_limit:
            raise SettingsError("bins.r_max is above response.log_stretch_limit")
        if settings.bins.tilt and not settings.bins.depth_factored:
            raise SettingsError("bins.tilt is true: bins.depth_factored must be true too")
        if settings.graph.wrinkles is not None and settings.graph.spacing is not None:
            raise SettingsError("graph.wrinkles and graph.spacing: one fixes the other, set one")
        return settings

    def _with_preset(self, name: Any) -> AssetSettings:
        """A copy with the values of a preset; `read` refuses a name that is none."""
        if not isinstance(name, str) or name not in PRESETS:
            return self
        preset = PRESETS[name]
        return replace(
            self,
            bins=replace(preset.bins, r_max=self.bins.r_max),
            response=replace(self.response, **preset.response),
            shape=replace(self.shape, **preset.shape),
        )

    def resolved(self, spacing: float) -> AssetSettings:
        """A copy with everything set.  spacing: of the pores, mesh units."""
        return self.with_lengths(Lengths.of(spacing, self.graph.age))

    def with_lengths(self, lengths: Lengths) -> AssetSettings:
        """A copy in which every length is set: to these, where the settings leave it open."""
        unit, shape, convolve = self.length_unit, self.shape, self.convolve
        grain = _first(shape.grain_size, lengths.grain_size)
        undulation = _first(shape.undulation_size, lengths.undulation_size)
        shape = replace(
            shape,
            wave_frequency=_first(shape.wave_frequency, lengths.wave_frequency),
            grain_size=GRAIN.resolved(grain, unit, lengths),
            undulation_size=UNDULATION.resolved(undulation, unit, lengths),
        )
        convolve = replace(convolve, sigma=_first(convolve.sigma, lengths.sigma))
        depth = _first(self.depth, lengths.depth)
        return replace(self, unit=unit, depth=depth, shape=shape, convolve=convolve)

    def lengths(self, spacing: float) -> Lengths:
        """The lengths of resolved settings.  spacing: of the pores, mesh units."""
        depth, sigma, shape = self.depth, self.convolve.sigma, self.shape
        assert depth is not None
        assert sigma is not None
        assert shape.wave_frequency is not None
        sizes = shape.grain_size, shape.undulation_size
        return Lengths(spacing, depth, sigma, shape.wave_frequency, *sizes)

    def for_graph(self, origin: GraphOrigin | None) -> AssetSettings:
        """A copy with the unit and the seed of a graph, where the settings leave them open.

        Raises SettingsError where the lengths of the graph cannot be converted to the unit.
        """
        origin = origin or GraphOrigin()
        unit = self.unit or origin.unit or USUAL_UNIT
        origin.in_unit(unit)
        return replace(self, unit=unit, graph=self._seeded(origin.seed))

    def _seeded(self, seed: int | None = None) -> GraphSettings:
        """The settings of the graph with a seed: their own, else `seed`, else the usual one."""
        return replace(self.graph, seed=_first(self.graph.seed, seed, USUAL_SEED))

    def for_synthesis(self) -> AssetSettings:
        """A copy with a unit and a seed, and with the usual spacing in that unit where neither
        `spacing` nor `wrinkles` is set. Raises SettingsError where that unit has no known length.
        """
        unit, graph = self.length_unit, self._seeded()
        if graph.wrinkles is None and graph.spacing is None:
            graph = replace(graph, spacing=usual_spacing(unit))
        return replace(self, unit=unit, graph=graph)

    def named_after(self, file: str) -> AssetSettings:
        """A copy with the name of a file, where none is set.

        Folders and the ending are left out, unprintable characters become one space, and 80
        characters are kept.  file: with separators of any system.
        """
        if self.name is not None:
            return self
        stem = PureWindowsPath(file).stem  # splits at both kinds of slash
        plain = "".join(c if c.isprintable() else " " for c in stem)
        return replace(self, name=" ".join(plain.split())[:LONGEST_NAME].strip() or None)

    def drawn(self) -> dict[str, Any]:
        """As `as_json`, without the name, on which nothing that is drawn depends."""
        return {key: value for key, value in self.as_json().items() if key != "name"}

    @property
    def length_unit(self) -> str:
        """The unit of the mesh; the usual one where none is set."""
        return self.unit or USUAL_UNIT

    def with_r_max(self, r_max: float) -> AssetSettings:
        """A copy with a calibrated `bins.r_max`."""
        return replace(self, bins=replace(self.bins, r_max=r_max))

    @property
    def last_sample(self) -> float:
        """Log stretch of the outer samples of the bins: at most the limit of the response."""
        return min(self.bins.reach * self.bins.r_max, self.response.log_stretch_limit)

    @property
    def grid(self) -> TileGrid:
        """How maps are cut into levels and tiles."""
        return TileGrid(self.resolution, self.tile_size)

    def as_json(self) -> dict[str, Any]:
        """Plain nested values, the inverse of `parse`."""
        return asdict(self)


def _first(*values: T | None) -> T | None:
    """The first value that is not None."""
    return next((value for value in values if value is not None), None)
