"""Figures of a relief on a square of the surface: heights, profiles, slopes and directions.

Heights are micrometres over the mean, on a square grid: along runs with the columns, across against
the rows, whose first is at the top. Names are those of ISO 25178-2 (areal) and ISO 21920-2
(profiles); what is filtered before is up to `levelled` and `without_waves`.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

FloatArray = NDArray[np.float64]
# Sampling lengths of a profile, each of which has a highest peak and a deepest valley.
SECTIONS = 5
# Edges of the histograms of slopes, degrees; what is steeper is in the outermost bins.
EDGES = np.arange(-45.0, 46.0, 1.5)
# Directions of correlation lengths, degrees from along, counter-clockwise.
ANGLES = np.arange(0.0, 180.0, 5.0)
# Autocorrelation at the end of a correlation length: that of Sal and Str.
_FALLEN = 0.2
_MICROMETRES = 1000.0


@dataclass(frozen=True)
class Areal:
    """Figures of all heights: micrometres, but ssk, sku, sdq (a slope) and sdr (per cent).

    sa, sq: mean and root mean square distance from the mean.  ssk, sku: skewness and kurtosis.  sp,
    sv, sz: highest peak, deepest valley, and both together.  sdq: root mean square gradient.  sdr:
    developed area over the flat one, less 1.
    """

    sa: float
    sq: float
    ssk: float
    sku: float
    sp: float
    sv: float
    sz: float
    sdq: float
    sdr: float

    @classmethod
    def of(cls, heights: FloatArray, step: float) -> Areal:
        """Those of heights (P, P), `step` mm apart."""
        h = heights - heights.mean()
        sq = float(np.sqrt((h**2).mean()))
        scaled = h / max(sq, 1e-12)
        steep = (slopes(heights, step) ** 2).sum(axis=-1)
        return cls(
            sa=float(np.abs(h).mean()),
            sq=sq,
            ssk=float((scaled**3).mean()),
            sku=float((scaled**4).mean()),
            sp=float(h.max()),
            sv=float(-h.min()),
            sz=float(np.ptp(h)),
            sdq=float(np.sqrt(steep.mean())),
            sdr=float(100.0 * (np.sqrt(1.0 + steep) - 1.0).mean()),
        )


@dataclass(frozen=True)
class Profiles:
    """Means over all profiles in one direction, of SECTIONS lengths each: ra, the mean distance
    from the mean, and rz, from the deepest valley to the highest peak; micrometres."""

    ra: float
    rz: float

    @classmethod
    def of(cls, heights: FloatArray) -> Profiles:
        """Those of the rows of heights (P, N)."""
        count = heights.shape[1] // SECTIONS
        parts = heights[:, : count * SECTIONS].reshape(len(heights), SECTIONS, count)
        level = parts - parts.mean(axis=2, keepdims=True)
        return cls(float(np.abs(level).mean()), float(np.ptp(parts, axis=2).mean()))


@dataclass(frozen=True)
class SlopeFigures:
    """Slopes in one direction.  variance: of the slope as a ratio.  rms: degrees.  histogram:
    shares of the area between EDGES."""

    variance: float
    rms: float
    histogram: tuple[float, ...]

    @classmethod
    def of(cls, slope: FloatArray) -> SlopeFigures:
        """Those of slopes (…)."""
        degrees = np.degrees(np.arctan(slope))
        inside = degrees.clip(EDGES[0], EDGES[-1])
        count, _ = np.histogram(inside, EDGES)
        rms = float(np.sqrt((degrees**2).mean()))
        return cls(float(slope.var()), rms, tuple((count / slope.size).tolist()))


@dataclass(frozen=True)
class Directions:
    """How far heights are alike, by direction.

    lengths: of ANGLES, millimetres to where the autocorrelation has fallen to 0.2; half a side of
    the square where it does not fall, as in all directions of a flat one.  sal: the shortest.
    longest: the longest.  str: sal over it, 1 for a relief without direction.  angle: of the
    longest, along which lines run; degrees.
    """

    lengths: tuple[float, ...]
    sal: float
    longest: float
    str: float
    angle: float

    @classmethod
    def of(cls, heights: FloatArray, step: float) -> Directions:
        """Those of heights (P, P), `step` mm apart."""
        rays = _rays(autocorrelation(heights))
        lengths = np.array([_length(ray) for ray in rays]) * step
        longest = float(lengths.max())
        sal = float(lengths.min())
        # Of several that do not fall, the one whose autocorrelation stays highest.
        kept = np.where(lengths >= longest, rays.mean(axis=1), -2.0)
        angle = float(ANGLES[int(kept.argmax())])
        return cls(tuple(lengths.tolist()), sal, longest, sal / longest, angle)


@dataclass(frozen=True)
class Figures:
    """All figures of a square.  side: millimetres.  along, across: the two directions."""

    side: float
    areal: Areal
    along: Profiles
    across: Profiles
    slopes_along: SlopeFigures
    slopes_across: SlopeFigures
    directions: Directions

    @classmethod
    def of(cls, heights: FloatArray, side: float) -> Figures:
        """Those of heights (P, P) without their form."""
        step = side / len(heights)
        steep = slopes(heights, step)
        return cls(
            side,
            Areal.of(heights, step),
            Profiles.of(heights),
            Profiles.of(heights.T),
            SlopeFigures.of(steep[..., 0]),
            SlopeFigures.of(steep[..., 1]),
            Directions.of(heights, step),
        )

    def as_json(self) -> dict[str, Any]:
        """The figures, with the edges of histograms and the angles of correlation lengths."""
        found = asdict(self)
        return {**found, "edges": EDGES.tolist(), "angles": ANGLES.tolist()}


def levelled(heights: FloatArray, degree: int = 2) -> FloatArray:
    """Heights (P, P) less their form: the polynomial of least squares of this degree, 1 or 2."""
    line = np.linspace(-1.0, 1.0, len(heights))
    x, y = (axis.ravel() for axis in np.meshgrid(line, line))
    terms = [x**i * y**j for i in range(degree + 1) for j in range(degree + 1 - i)]
    form = np.stack(terms, axis=1)
    found, *_ = np.linalg.lstsq(form, heights.ravel(), rcond=None)
    level: FloatArray = heights - (form @ found).reshape(heights.shape)
    return level


def without_waves(heights: FloatArray, cutoff: float, step: float) -> FloatArray:
    """Heights (P, P), `step` mm apart, less waves longer than `cutoff` mm: by the areal Gaussian
    filter of ISO 16610-61, which lets half of a wave of that length through. At the rim the square
    goes on as its mirror image."""
    sigma = cutoff * np.sqrt(np.log(2.0) / 2.0) / np.pi / step
    rough: FloatArray = heights - gaussian_filter(heights, sigma, mode="reflect", truncate=5.0)
    return rough


def slopes(heights: FloatArray, step: float) -> FloatArray:
    """(P - 4, P - 4, 2) slopes along and across, as ratios: by differences over four steps, of
    fourth order. A wave of ten steps comes out 1 % too flat."""

    def along_rows(values: FloatArray) -> FloatArray:
        near = values[:, 3:-1] - values[:, 1:-3]
        far = values[:, 4:] - values[:, :-4]
        found: FloatArray = (8.0 * near - far) / (12.0 * step * _MICROMETRES)
        return found

    along, down = along_rows(heights)[2:-2], along_rows(heights.T).T[:, 2:-2]
    return np.stack([along, -down], axis=-1)


def autocorrelation(heights: FloatArray) -> FloatArray:
    """(P, P) how alike heights are a shift apart, 1 at the middle (P // 2, P // 2): the mean
    product where a square and its shifted copy overlap. 1 throughout a flat one."""
    side = len(heights)
    padded = (2 * side, 2 * side)
    h = heights - heights.mean()

    def product(values: FloatArray) -> FloatArray:
        found: FloatArray = np.fft.irfft2(np.abs(np.fft.rfft2(values, padded)) ** 2, padded)
        return found

    mean = product(h) / np.maximum(product(np.ones_like(h)), 0.5)
    half = side // 2
    middle = np.roll(mean, (half, half), (0, 1))[:side, :side]
    most = float(middle[half, half])
    return middle / most if most > 0.0 else np.ones_like(middle)


def _rays(correlation: FloatArray) -> FloatArray:
    """(A, N) autocorrelation along ANGLES, in steps from the middle to the rim."""
    half = len(correlation) // 2
    far = np.arange(half)
    angle = np.radians(ANGLES)[:, None]
    places = [half - np.sin(angle) * far, half + np.cos(angle) * far]
    found: FloatArray = map_coordinates(correlation, places, order=1, mode="nearest")
    return found


def _length(ray: FloatArray) -> float:
    """Steps to where a ray falls to _FALLEN, linear between steps; all of it where it does not."""
    fallen = np.flatnonzero(ray <= _FALLEN)
    if not len(fallen):
        return float(len(ray))
    after = int(fallen[0])
    high, low = ray[after - 1], ray[after]
    return after - 1 + float((high - _FALLEN) / (high - low))
