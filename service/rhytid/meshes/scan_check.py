"""Everything that can be said of scanned displacement before anything is made of it: facts of each
map, and what is probably wrong. `warnings.py` has the limits and their reasons.

Nothing is told by the extension of a file: bits, blocks of JPEG and the way a map lies on its mesh
are measured from its values.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import PurePath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.lengths import MESH_UNITS, MILLIMETRES, millimetres
from rhytid.domain.mesh import Mesh, add_centre
from rhytid.domain.painted_maps import texels_of
from rhytid.domain.residual import Residual, ScanRelief
from rhytid.domain.scan import Scan, ScanMap, ScanSettings
from rhytid.domain.spectra import shortest_wave
from rhytid.domain.uv_layout import mean_uv_length
from rhytid.domain.warnings import (
    BLOCK_RATIO,
    DEEPEST,
    FEW_LEVELS,
    SCAN_BITS,
    SCAN_BLOCKS,
    SCAN_DEPTH,
    SCAN_FLAT,
    SCAN_MIDLEVEL,
    SCAN_MIRRORED,
    SCAN_SEAMS,
    SEAM_SHARE,
    SHALLOWEST,
    STEEPEST,
    InputWarning,
)
from rhytid.errors import InputError
from rhytid.meshes.scan_samples import Seams, SurfaceSamples
from rhytid.meshes.scan_values import (
    AS_IT_IS,
    MASK_SIDE,
    best_turn,
    blocks_of,
    flat_parts,
    levels_of,
    noise_of,
)
from rhytid.meshes.scans import Background, charts

FloatArray = NDArray[np.float64]
# Percentiles between which 95 % of a relief lie.
_ENDS = (2.5, 97.5)
_FLIPS = {"top to bottom": "v", "left to right": "u", "half a turn": "uv"}
# Texels per side of assets.
LEAST_RESOLUTION = 256
# Texels per side of which the spectrum of a map can be told.
LEAST_END = 64
# Greys below are masked out. The share of the depth of a map that what is flat may differ by.
_BLACK, _FLAT = 0.5, 1e-3
_IMPERIAL = ("in", "ft")


@dataclass(frozen=True)
class MapFacts:
    """What was measured of one map; lengths in mesh units.

    file, width, height, kind, channels: of the file.  levels: different values, of floats that are
    continuous None; of bands those of the one that has fewest.  bits: that these levels need over
    the full range.  step: between neighbouring levels.  noise: rms of what no neighbour foretells,
    as an upper limit: fine relief counts, too.  blocks: differences across the borders of 8 x 8
    texels over those within, of the band with most.  midlevel: of the first channel; outside: the
    value outside of the charts, where there is one.  low, high: between which 95 % of the surface
    lies; middle: its median.  steepness: gradient of the relief that a twentieth exceeds.
    turn: how the map fits the charts best, `as it is` where it cannot be told.  shortest: wave from
    which on there is next to nothing, texels; None where waves go on to two texels, or where there
    are too few texels to tell.  texel: its mean length on the surface.
    """

    udim: int
    file: str
    width: int
    height: int
    kind: str
    channels: int
    levels: int | None
    bits: int | None
    step: float
    noise: float
    blocks: float
    midlevel: float
    outside: float | None
    low: float
    middle: float
    high: float
    steepness: float
    turn: str
    shortest: float | None
    texel: float

    @property
    def depth(self) -> float:
        """Between what 95 % of the surface lies."""
        return self.high - self.low

    @property
    def flat(self) -> bool:
        """Whether there is no relief on the surface."""
        return self.depth <= 1.5 * self.step if self.levels is not None else self.depth == 0.0


@dataclass(frozen=True, eq=False)
class ScanCheck:
    """A scan on its mesh, and the findings about it.

    unit: of the mesh.  settings: what the caller said of the scan.  masks: painted, of UDIMs of
    which a part is left out, which is black.
    """

    scan: Scan
    mesh: Mesh
    unit: str
    settings: ScanSettings
    masks: Mapping[int, NDArray[Any]] = field(default_factory=dict)

    def resolution(self) -> int:
        """Texels per side to trace it at where nothing is said: the power of two from the longest
        side of the maps on, but no more than is usual."""
        side = max(max(map.shape) for map in self.scan.maps.values())
        return min(max(1 << (side - 1).bit_length(), LEAST_RESOLUTION), AssetSettings().resolution)

    def relief(self, resolution: int) -> ScanRelief:
        """What is traced, at `resolution` texels per side, with the noise of its coarsest codes.
        Raises InputError where there is no relief."""
        scan = self.scan
        reliefs = {udim: scan.relief(udim, resolution) for udim in scan.maps}
        if not any(np.ptp(relief) > 0.0 for relief in reliefs.values()):
            raise InputError("there is no relief in the scan: every texel has the same value")
        steps = (one.step for one in self.maps if one.levels is not None)
        noise = max(steps, default=0.0) / math.sqrt(12.0)
        border = self.settings.border(self.unit)
        ends = {} if self.settings.detail == 0.0 or border else self._ends(resolution)
        usual = 1.0 if self.settings.detail is None else self.settings.detail
        denied = self._denied(border)
        return ScanRelief(reliefs, noise, ends, usual if ends else 0.0, denied, border)

    def _denied(self, border: float) -> dict[int, NDArray[np.uint8]]:
        """Where UDIMs are masked out, and where skin fills in also where they are flat."""
        found = {}
        for one in self.maps:
            parts = []
            if one.udim in self.masks:
                parts.append(texels_of(self.masks[one.udim], MASK_SIDE, 0, 0, MASK_SIDE) < _BLACK)
            if border:
                radius = border / 2.0 / one.texel / max(one.width, one.height)
                flat = max(1.5 * one.step if one.levels is not None else 0.0, _FLAT * one.depth)
                parts.append(flat_parts(self.scan.relief(one.udim), radius, flat))
            if parts and (denied := np.any(parts, axis=0)).any():
                found[one.udim] = denied.astype(np.uint8)
        return found

    def _ends(self, resolution: int) -> dict[int, int]:
        """Texels per side that hold what each map has, where these are fewer than `resolution`: as
        many as its file has, and where the caller asks for detail as many as its spectrum needs."""
        found = {}
        for one in self.maps:
            side = max(one.width, one.height)
            if self.settings.detail is not None and one.shortest is not None:
                side = math.ceil(2.0 / one.shortest * side)
            if LEAST_END <= side < resolution:
                found[one.udim] = side
        return found

    @cached_property
    def maps(self) -> tuple[MapFacts, ...]:
        """The facts of each map, by UDIM."""
        samples = SurfaceSamples.of(self.mesh)
        return tuple(self._facts(udim, samples) for udim in self.scan.maps)

    @cached_property
    def seams(self) -> SeamFacts | None:
        """How far the two sides of seams differ; None without seams that maps lie on."""
        return SeamFacts.of(self.mesh, self.scan)

    def warnings(self) -> tuple[InputWarning, ...]:
        """What is probably wrong, map by map, then of the seams."""
        return (*(w for one in self.maps for w in self._of_map(one)), *self._of_seams())

    def figures(self) -> dict[str, Any]:
        """All findings, for JSON; lengths in mesh units."""
        return {
            "scale": list(self.scan.scales),
            "maps": [{**asdict(one), "depth": one.depth, "flat": one.flat} for one in self.maps],
            "seams": None if self.seams is None else asdict(self.seams),
        }

    def rows(self) -> list[tuple[str, str, str]]:
        """The rows of the table of `rhytid check`: a finding, how much, and where."""
        found = [row for one in self.maps for row in self._rows_of(one)]
        seams = self.seams
        if seams is not None:
            differ = f"{self._named(seams.rms)} rms, {100 * seams.share:.0f} % of the relief there"
            at = ", ".join(f"{x:.4g}" for x in seams.at)
            found.append(("scan, seams differ", differ, f"most at ({at})"))
        return found

    def _rows_of(self, one: MapFacts) -> Iterator[tuple[str, str, str]]:
        name = f"scan {one.udim}"
        channels = "" if one.channels == 1 else f", {one.channels} bands"
        size = f"{one.width} x {one.height} texels of {one.kind}{channels}"
        yield name, size, PurePath(one.file).name
        levels = "continuous" if one.levels is None else f"{one.levels} different"
        bits = "" if one.bits is None else f" ({one.bits} bits)"
        step, noise = self._named(one.step), self._named(one.noise)
        yield f"{name}, values", f"{levels}{bits}, step {step}, noise below {noise}", ""
        low, high = self._named(one.low), self._named(one.high)
        steep = f"a twentieth steeper than {one.steepness:.2g}"
        yield f"{name}, relief", f"95 % from {low} to {high}, {steep}", ""
        outside = "many values" if one.outside is None else f"{one.outside:.4g}"
        yield f"{name}, midlevel", f"{one.midlevel:.4g}, outside of the charts: {outside}", ""
        yield f"{name}, blocks of JPEG", f"{one.blocks:.2f} times as within", ""
        yield f"{name}, lies", one.turn, ""
        texels = 2.0 if one.shortest is None else one.shortest
        yield (
            f"{name}, ends",
            f"at waves of {self._named(texels * one.texel)}, {texels:.2g} texels",
            "",
        )

    def _facts(self, udim: int, samples: SurfaceSamples) -> MapFacts:
        map, scales = self.scan.maps[udim], self.scan.scales
        first, covered = map.channels[0], charts(self.mesh, udim)
        heights, steepness = samples.heights(self.scan, udim)
        low, middle, high = _percentiles(heights, (_ENDS[0], 50.0, _ENDS[1]))
        each = [levels_of(channel) for channel in map.channels]
        counts = [np.inf if levels is None else levels for levels, _, _ in each]
        fewest = int(np.argmin(counts))
        levels, between, bits = each[fewest]
        noises = [noise_of(one) * scale for one, scale in zip(map.channels, scales, strict=True)]
        outside = Background.of(first, covered)
        return MapFacts(
            udim=udim,
            file=map.name,
            width=map.shape[1],
            height=map.shape[0],
            kind=map.kind,
            channels=len(map.channels),
            levels=levels,
            bits=bits,
            step=between * abs(scales[fewest]),
            noise=float(np.linalg.norm(noises)),
            blocks=max(blocks_of(channel) for channel in map.channels),
            midlevel=self.scan.midlevels[udim][0],
            outside=None if outside.is_fill else outside.value,
            low=low,
            middle=middle,
            high=high,
            steepness=_percentiles(steepness, (95.0,))[0],
            turn=best_turn(first, covered),
            shortest=_shortest(map, scales, covered),
            texel=mean_uv_length(self.mesh, udim) / max(map.shape),
        )

    def _of_map(self, one: MapFacts) -> Iterator[InputWarning]:
        where = f"{one.file}, UDIM {one.udim}"
        if one.flat:
            yield InputWarning(SCAN_FLAT, "the map is flat where the mesh is: no relief", where)
        else:
            yield from self._of_depth(one, where)
            yield from self._of_values(one, where)
        yield from self._of_midlevel(one, where)
        if one.turn != AS_IT_IS:
            back = _turned_back(one.turn, self.settings.flip)
            detail = (
                f"what lies in the map fits the charts of the mesh better turned, {one.turn}: "
                f"relief lies in the wrong places; {back}, if it is not the UV of the mesh"
            )
            yield InputWarning(SCAN_MIRRORED, detail, where)

    def _of_depth(self, one: MapFacts, where: str) -> Iterator[InputWarning]:
        length = millimetres(self.unit)
        depth = None if length is None else one.depth * length
        steep = one.steepness > STEEPEST
        if not steep and (depth is None or SHALLOWEST <= depth <= DEEPEST):
            return
        deep = f"95 % of it is {_length(one.depth if depth is None else depth, depth is None)} deep"
        if steep:
            deep += f", and a twentieth of it is steeper than {one.steepness:.2g} to 1"
        rule = f"relief of skin is {SHALLOWEST:g} to {DEEPEST:g} mm deep"
        detail = f"{deep}; {rule}: {self._other_scale(depth, one.steepness)}"
        yield InputWarning(SCAN_DEPTH, detail, where)

    def _other_scale(self, depth: float | None, steepness: float) -> str:
        """A question that names the unit that the scale may be in."""
        unit = self.settings.unit or self.unit
        given = millimetres(unit)
        if depth is None or given is None:
            return "is the scale right?"
        usual = float(np.sqrt(SHALLOWEST * DEEPEST))
        times = {name: MILLIMETRES[name] / given for name in MESH_UNITS}
        would = {name: depth * factor for name, factor in times.items()}
        fits = [
            name
            for name, factor in times.items()
            if factor != 1.0
            and SHALLOWEST <= would[name] <= DEEPEST
            and (steepness <= STEEPEST or factor < 1.0)
        ]
        # Of feet and inches only where nothing metric fits.
        fits.sort(key=lambda name: (name in _IMPERIAL, abs(np.log(would[name] / usual))))
        if not fits:
            return f"is the scale, in {unit}, right?"
        return f"is the scale in {fits[0]}, not in {unit}? Then it is {_length(would[fits[0]])}"

    def _of_values(self, one: MapFacts, where: str) -> Iterator[InputWarning]:
        if one.levels is not None and one.levels <= FEW_LEVELS:
            step = self._named(one.step)
            whole = one.bits is not None and one.bits <= 8
            few = "8 bits" if whole else f"{one.levels} of its values alone"
            detail = (
                f"it has {few}, in steps of {step}: slopes come in terraces, and what is finer is "
                "noise; export 16 bits or floats"
            )
            yield InputWarning(SCAN_BITS, detail, where)
        if one.blocks > BLOCK_RATIO:
            detail = (
                "squares of 8 x 8 texels stand out, as JPEG leaves them: differences across their "
                f"borders are {one.blocks:.2g} times those within; export PNG, TIFF or EXR"
            )
            yield InputWarning(SCAN_BLOCKS, detail, where)

    def _of_midlevel(self, one: MapFacts, where: str) -> Iterator[InputWarning]:
        """Where the whole surface is moved, or the value outside of the charts is another."""
        if one.flat and one.middle == 0.0:
            return
        off = not one.low - 1.5 * one.step <= 0.0 <= one.high + 1.5 * one.step
        scale = self.scan.scales[0]
        if off:
            detail = (
                f"the whole surface moves by {self._named(one.middle)}: the midlevel is "
                f"{one.midlevel:.4g}"
            )
            if one.channels == 1:
                detail += f", the middle value {one.midlevel + one.middle / scale:.4g}"
            yield InputWarning(SCAN_MIDLEVEL, detail, where)
        elif one.outside is not None and abs(one.outside - one.midlevel) * abs(scale) > max(
            0.1 * one.depth, 1.5 * one.step
        ):
            detail = (
                f"outside of the charts the map is {one.outside:.4g}, the midlevel is "
                f"{one.midlevel:.4g}: the surface moves by "
                f"{self._named((one.outside - one.midlevel) * scale)} where nothing is meant"
            )
            yield InputWarning(SCAN_MIDLEVEL, detail, where)

    def _of_seams(self) -> Iterator[InputWarning]:
        found = self.seams
        if found is None or found.share <= SEAM_SHARE:
            return
        x, y, z = (f"{one:.4g}" for one in found.at)
        (u, v), (s, t) = found.uv
        detail = (
            f"the two sides of UV seams differ by {self._named(found.rms)} (rms), "
            f"{100 * found.share:.0f} % of how much the relief varies there: seams will show"
        )
        place = f"worst at ({x}, {y}, {z}), uv ({u:.3f}, {v:.3f}) and ({s:.3f}, {t:.3f})"
        yield InputWarning(SCAN_SEAMS, detail, place)

    def _named(self, length: float) -> str:
        """A length in millimetres, or in mesh units of no known length."""
        factor = millimetres(self.unit)
        return _length(length if factor is None else length * factor, factor is None)


def residual_warnings(residual: Residual, unit: str) -> Iterator[InputWarning]:
    """A warning of each UDIM whose residual is deeper than skin: it is of another scan than its
    graph, or not in mesh units.  unit: of the mesh."""
    length = millimetres(unit)
    if length is None:
        return
    for udim in sorted(residual.codes):
        some = residual.heights(udim)[::4, ::4]  # of millions of texels enough for percentiles
        depth = float(np.ptp(np.percentile(some, (2.5, 97.5)))) * length
        if depth > DEEPEST:
            detail = (
                f"95 % of it is {_length(depth)} deep, relief of skin is up to {DEEPEST:g} mm "
                f"deep: is it what `trace` wrote with this graph, in units of the mesh ({unit})?"
            )
            yield InputWarning(SCAN_DEPTH, detail, f"residual, UDIM {udim}")


def _turned_back(turn: str, given: str | None) -> str:
    """What makes a map fit that was read with `--flip` as given, and fits better turned."""
    flip = _FLIPS.get(turn)
    if flip is None:
        return "turn the map"
    wanted = "".join(axis for axis in "uv" if (axis in flip) != (axis in (given or "")))
    if not wanted:
        return f"leave --flip {given} out"
    return f"--flip {wanted} turns it over" if given is None else f"give --flip {wanted} instead"


@dataclass(frozen=True)
class SeamFacts:
    """How far the two sides of UV seams differ.

    rms: of the differences, mesh units.  share: of them to the standard deviation of the heights
    along seams.  at, uv: the place where they differ most, in the space of the file and on both
    sides in UV.
    """

    rms: float
    share: float
    at: tuple[float, float, float]
    uv: tuple[tuple[float, float], tuple[float, float]]

    @classmethod
    def of(cls, mesh: Mesh, scan: Scan) -> SeamFacts | None:
        """That of a scan; None where no seam has maps on both sides, or no relief."""
        seams = Seams.of(mesh)
        heights = seams.heights(scan)
        apart = heights[..., 0] - heights[..., 1]
        known = np.isfinite(apart)
        if not known.any():
            return None
        spread = float(np.nanstd(heights[known]))
        rms = float(np.sqrt(np.mean(apart[known] ** 2)))
        if spread == 0.0:
            return None
        worst = np.unravel_index(np.nanargmax(np.abs(apart)), apart.shape)
        uv, space = seams.places
        x, y, z = add_centre(space[worst], mesh.centre).tolist()
        (u, v), (s, t) = uv[worst].tolist()
        return cls(rms, rms / spread, (x, y, z), ((u, v), (s, t)))


def _shortest(map: ScanMap, scales: Sequence[float], covered: NDArray[np.bool_]) -> float | None:
    """The shortest waves of the band that has the shortest ones, of those that are not flat and
    have a scale."""
    rows, columns = (((np.arange(n) + 0.5) * len(covered) / n).astype(np.int64) for n in map.shape)
    inside = covered[rows[:, None], columns]
    found = [
        shortest_wave(channel, inside)
        for channel, scale in zip(map.channels, scales, strict=True)
        if scale != 0.0 and float(np.ptp(channel)) > 0.0
    ]
    return min((wave for wave in found if wave is not None), default=None) if all(found) else None


def _percentiles(values: FloatArray, at: tuple[float, ...]) -> list[float]:
    found: list[float] = np.percentile(values, at).tolist() if values.size else [0.0 for _ in at]
    return found


def _length(value: float, in_units: bool = False) -> str:
    return f"{value:.2g} units" if in_units else f"{value:.2g} mm"
