"""The noise that patches of skin follow: one periodic table of band-limited noise, laid through
space at an angle and an offset of its own for each property and seed.

Between the nodes of the table it is their quadratic spline, which has no kinks: linear between them
patches ended along the sides of its cells.
"""

from __future__ import annotations

from functools import cache, lru_cache

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.lengths import UNDULATION, LargestWave, millimetres

Floats = NDArray[np.float64]
Placement = tuple[tuple[float, float, float, float], ...]
# The longest wave, and the shortest as a share of it. A patch is half a wave. Power per octave
# grows as the wavelength.
LONGEST = LargestWave(millimetres=20.0, of_spacing=40.0)
_SHORTEST = 0.2
# Relief is LEAST everywhere, and the rest of it log-normal: so the quietest skin is not bare.
# Deviations of logarithms for undulation and grain where patchiness is 1, and the most.
LEAST, DEVIATION, MOST_DEVIATION = 0.25, 0.4, 1.1
# Salts of their fields: undulation follows the strength of lines, for skin is quiet or lively as a
# whole.
STRENGTH_SALT, GRAIN_SALT = 11, 14
# Cells along a side of the table, a power of two, and in the longest wave. Values are cut off
# softly at so many deviations.
CELLS, CELLS_OF_WAVE, _BOUND = 64, 16.0, 1.4


def cell_size(settings: AssetSettings, wave: float | None = None) -> float:
    """The side of a cell in mesh units, of resolved settings: by the unit, else by the longest wave
    of the lines, as their graph says it; of one that does not, as the waves of the undulation."""
    length, undulation = millimetres(settings.length_unit), settings.shape.undulation_size
    if length is not None:
        return LONGEST.millimetres / length / CELLS_OF_WAVE
    if wave is not None:
        return wave / CELLS_OF_WAVE
    assert undulation is not None
    return LONGEST.of_spacing / UNDULATION.of_spacing * undulation / CELLS_OF_WAVE


@cache
def table() -> NDArray[np.float32]:
    """(CELLS + 2,)³ coefficients of the spline at the nodes of the cells, x, y, z; before the first
    node is the last again, and after the last the first. The spline has mean 0 and deviation 1."""
    wave, half = np.fft.fftfreq(CELLS, 1.0 / CELLS), np.arange(CELLS // 2 + 1.0)
    length = np.sqrt(wave[:, None, None] ** 2 + wave[:, None] ** 2 + half**2)
    longest = CELLS / CELLS_OF_WAVE
    inside = (length >= longest) & (length <= longest / _SHORTEST)
    share = np.where(inside, np.maximum(length, 1.0) ** -2.0, 0.0)
    share /= _left(wave)[:, None, None] * _left(wave)[:, None] * _left(half)
    white = np.random.Generator(np.random.PCG64(0)).standard_normal((CELLS,) * 3)
    noise = np.fft.irfftn(np.fft.rfftn(white) * share, s=white.shape, axes=(0, 1, 2))
    noise = np.tanh(noise / (_BOUND * noise.std()))
    noise -= noise.mean()
    noise /= np.sqrt(_mean_square(noise))
    found = np.pad(noise, ((1, 1),) * 3, mode="wrap").astype(np.float32)
    found.setflags(write=False)
    return found


def _left(wave: NDArray[np.floating]) -> Floats:
    """(N,) what the spline leaves, at the nodes, of waves of its coefficients, so many along a side
    of the table."""
    left = (3.0 + np.cos(2.0 * np.pi * wave / CELLS)) / 4.0
    return left.astype(np.float64)


def _mean_square(noise: Floats) -> float:
    """Of the spline of periodic coefficients: the mean of these times themselves blurred by the
    products of its pieces, (1, 26, 66, 26, 1)/120."""
    blurred = noise
    for axis in range(3):
        beside, beyond = (np.roll(blurred, n, axis) + np.roll(blurred, -n, axis) for n in (1, 2))
        blurred = (66.0 * blurred + 26.0 * beside + beyond) / 120.0
    return float((noise * blurred).mean())


@lru_cache(64)
def placement(seed: int, salt: int) -> Placement:
    """How a field lies in space: three rows (a, b, c, d), axes at right angles, evenly random, and
    offsets. The place (x, y, z), in cells, is at a x + b y + c z + d along each side of the
    table."""
    rng = np.random.default_rng([seed, salt])
    quaternion = rng.normal(size=4)
    w, x, y, z = quaternion / np.sqrt((quaternion**2).sum())
    axes = (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)),
        (2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)),
        (2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)),
    )
    offsets = rng.uniform(0.0, CELLS, 3)
    rows = np.column_stack([axes, offsets]).tolist()
    return tuple((a, b, c, d) for a, b, c, d in rows)
