"""The settings of an asset, their defaults and their ranges. Unknown keys are refused."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from rhytid.domain.checked import choice, number, power_of_two, read, text, whole
from rhytid.domain.expressions import LINES
from rhytid.domain.graph_origin import GraphOrigin
from rhytid.domain.lengths import Lengths, usual_spacing
from rhytid.domain.regions import REGIONS, WHOLE_FACE
from rhytid.domain.tiles import TileGrid
from rhytid.domain.units import USUAL_UNIT
from rhytid.errors import SettingsError

MOST_WRINKLES = 40_000_000


@dataclass(frozen=True)
class GraphSettings:
    """How the wrinkle graph is synthesised (section 2.1, after Weiss et al. 2023).

    spacing: mean distance of neighbouring pores where density is 1, mesh units; how many wrinkles
    there are follows from it and the area, unless `wrinkles` says it: then the spacing follows.
    lines: preferred ones run where `expressions` fold the face, or `level` around the vertical
    axis; "auto" or None: by expressions where there are any.
    turn: degrees to the left of the preferred lines.  density, strength, scale and pore_radius are
    factors; anisotropy is 0 for lines that run any way, 1 as usual, 2 for one direction alone.
    """

    spacing: float | None = number(None, 1e-30, 1e30)
    wrinkles: int | None = whole(None, 100, MOST_WRINKLES)
    seed: int = whole(1, 0, 2**31 - 1)
    neighbours: int = whole(8, 4, 16)
    # Along what preferred lines run; null is "auto".
    lines: str | None = choice(None, None, *LINES)
    # Of the whole mesh, times what `region` and painted maps say of a place.
    region: str = choice(WHOLE_FACE, *REGIONS)
    density: float = number(1.0, 1 / 16, 16.0)
    strength: float = number(1.0, 0.0, 4.0)
    turn: float = number(0.0, -180.0, 180.0)
    anisotropy: float = number(1.0, 0.0, 2.0)
    scale: float = number(1.0, 1 / 4, 4.0)
    pore_radius: float = number(1.0, 1 / 4, 4.0)


@dataclass(frozen=True)
class ResponseSettings:
    """Exponents of Alg. 1 (alpha, wrinkles) and Alg. 2 (beta, pores), and the clamp of log rho."""

    alpha_w: float = number(1.0, 0.0, 64.0)
    alpha_d: float = number(4.0, 0.0, 64.0)
    beta_w: float = number(4.0, 0.0, 64.0)
    beta_d: float = number(10.0, 0.0, 64.0)
    log_stretch_limit: float = number(0.5, 0.01, 4.0)


@dataclass(frozen=True)
class ShapeSettings:
    """The profile (1 - t²)²(1 - b t²), and how heights x meet: log(1 + Σ(e^{βx} - 1)/n)/β, valleys
    and bulges apart; β is the sharpness, n the slots.

    Wrinkles run to and fro by `wave_amplitude`, mesh units on the neutral surface, `wave_frequency`
    times a mesh unit; at 0 they are straight. No wrinkle runs aside by more than a fifth of its
    length.
    """

    # Above 9 a bulge would rise over the depth of its furrow, past what the sums can hold.
    wrinkle_bulge: float = number(2.5, 0.0, 9.0)
    pore_bulge: float = number(0.0, 0.0, 9.0)
    sharpness: float = number(20.0, 0.1, 20.0)
    slots: int = whole(1, 1, 1024)
    wave_amplitude: float = number(0.0, 0.0, 1e30)
    wave_frequency: float | None = number(None, 1e-30, 1e30)


@dataclass(frozen=True)
class BinSettings:
    """The precomputed maps of the fast method (section 2.4); the defaults are the paper's."""

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
        """Stretches that each layer is drawn at: of every bin, and last of the pores."""
        return (self.samples,) * self.count + (self.pore_samples or self.samples,)


# What `preset` sets of the bins. `best` is the closest to `redraw` that was measured at no more
# than twice the time of `paper`, the paper's own choice.
PRESETS: dict[str, BinSettings] = {
    "paper": BinSettings(),
    "best": BinSettings(pore_samples=5, merge="soft", depth_factored=True, tilt=True, reach=1.25),
}


DEFAULT_PRESET = "best"


@dataclass(frozen=True)
class ConvolveSettings:
    """How the neutral map is blurred and sharpened (after Nagano et al. 2015).

    The published fit is not public: these gains are ours. 4 is `alpha_d`, so that to first order
    features much finer than `sigma` lose and gain as much depth as Alg. 1 takes and gives.
    `sigma` is in mesh units.
    """

    blur_gain: float = number(4.0, 0.0, 64.0)
    sharpen_gain: float = number(4.0, 0.0, 64.0)
    sigma: float | None = number(None, 1e-30, 1e30)


@dataclass(frozen=True)
class AssetSettings:
    """Everything that can be set for an asset; `None` is resolved when the asset is built.

    `unit` is that of the mesh: of the graph's file where that says one, else cm.  `depth` is the
    depth of strength 1, in mesh units; `padding` is in level-0 texels. Naming a
    `preset` sets the bins but for `r_max`; keys of `bins` beside it go before it.
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
    bins: BinSettings = field(default_factory=lambda: PRESETS[DEFAULT_PRESET])
    convolve: ConvolveSettings = field(default_factory=ConvolveSettings)

    @classmethod
    def parse(cls, data: Any) -> AssetSettings:
        """From decoded JSON; raises SettingsError naming the path of what is wrong."""
        return cls().changed(data)

    def changed(self, data: Any) -> AssetSettings:
        """A copy with the values of `data` (decoded JSON, same shape) put in."""
        if not isinstance(data, Mapping):
            raise SettingsError(f"settings are {type(data).__name__}: must be a JSON object")
        settings = read(self._with_preset(data.get("preset")), data)
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
        """Its bins in place of these; what is no preset is left to `read` to refuse."""
        if not isinstance(name, str) or name not in PRESETS:
            return self
        return replace(self, bins=replace(PRESETS[name], r_max=self.bins.r_max))

    def resolved(self, spacing: float) -> AssetSettings:
        """A copy with everything set, for a pore spacing in mesh units."""
        return self.with_lengths(Lengths.of(spacing))

    def with_lengths(self, lengths: Lengths) -> AssetSettings:
        """A copy with the lengths that are not set yet."""
        depth, sigma = self.depth, self.convolve.sigma
        frequency = self.shape.wave_frequency
        if frequency is None:
            frequency = lengths.wave_frequency
        return replace(
            self,
            unit=self.length_unit,
            depth=lengths.depth if depth is None else depth,
            shape=replace(self.shape, wave_frequency=frequency),
            convolve=replace(self.convolve, sigma=lengths.sigma if sigma is None else sigma),
        )

    def lengths(self, spacing: float) -> Lengths:
        """Those of resolved settings.  spacing: of the pores, mesh units."""
        depth, sigma, frequency = self.depth, self.convolve.sigma, self.shape.wave_frequency
        assert depth is not None
        assert sigma is not None
        assert frequency is not None
        return Lengths(spacing, depth, sigma, frequency)

    def for_graph(self, origin: GraphOrigin | None) -> AssetSettings:
        """A copy with the unit of a graph where none is set.

        Raises SettingsError where the lengths of the graph cannot be converted to that which is.
        """
        if origin is None:
            return replace(self, unit=self.length_unit)
        unit = self.unit or origin.unit or USUAL_UNIT
        origin.in_unit(unit)
        return replace(self, unit=unit)

    def for_synthesis(self) -> AssetSettings:
        """A copy with unit, and with the usual spacing of that where nothing says how dense pores
        are; raises SettingsError where the unit is not known."""
        unit, graph = self.length_unit, self.graph
        if graph.wrinkles is None and graph.spacing is None:
            graph = replace(graph, spacing=usual_spacing(unit))
        return replace(self, unit=unit, graph=graph)

    @property
    def length_unit(self) -> str:
        """The unit of the mesh, the usual one where none is set."""
        return self.unit or USUAL_UNIT

    def with_r_max(self, r_max: float) -> AssetSettings:
        """A copy with a calibrated `bins.r_max`."""
        return replace(self, bins=replace(self.bins, r_max=r_max))

    @property
    def last_sample(self) -> float:
        """Log stretch of the outer samples of the bins: no more than the response can ask for."""
        return min(self.bins.reach * self.bins.r_max, self.response.log_stretch_limit)

    @property
    def grid(self) -> TileGrid:
        """How maps are cut into levels and tiles."""
        return TileGrid(self.resolution, self.tile_size)

    def as_json(self) -> dict[str, Any]:
        """Plain nested values, the inverse of `parse`."""
        return asdict(self)
