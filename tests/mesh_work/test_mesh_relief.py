"""Figures of surfaces that can be worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss

from rhytid.meshes.relief import (
    EDGES,
    Areal,
    Directions,
    Figures,
    Profiles,
    SlopeFigures,
    levelled,
    slopes,
    without_waves,
)

SIDE, PIXELS, HEIGHT = 8.0, 400, 30.0
STEP = SIDE / PIXELS
LINE = (np.arange(PIXELS) + 0.5) * STEP
# Slopes are not known at the two outermost places of a side.
RIM = 4


def waves(degrees: float, length: float, pixels: int = PIXELS) -> np.ndarray:
    """Waves of HEIGHT whose crests run at this angle, row 0 at the top."""
    line = (np.arange(pixels) + 0.5) * STEP
    x, y = np.meshgrid(line, -line)
    angle = np.radians(degrees)
    return HEIGHT * np.sin(2 * np.pi * (-x * np.sin(angle) + y * np.cos(angle)) / length)


def test_heights_of_a_sine() -> None:
    """Sa 2 A / pi, Sq A / sqrt 2, no skewness, kurtosis 1.5; profiles along crests are level."""
    found = Areal.of(waves(90.0, 0.8), STEP)

    assert found.sa == pytest.approx(2 * HEIGHT / np.pi, rel=2e-3)
    assert found.sq == pytest.approx(HEIGHT / np.sqrt(2), rel=1e-3)
    assert found.ssk == pytest.approx(0.0, abs=1e-9)
    assert found.sku == pytest.approx(1.5, rel=1e-3)
    assert (found.sp, found.sv, found.sz) == pytest.approx((HEIGHT, HEIGHT, 2 * HEIGHT), rel=4e-3)
    across = Profiles.of(waves(90.0, 0.8))
    assert (across.ra, across.rz) == pytest.approx((2 * HEIGHT / np.pi, 2 * HEIGHT), rel=4e-3)
    assert Profiles.of(waves(0.0, 0.8)).rz == pytest.approx(0.0, abs=1e-9)


def test_slopes_and_developed_area_of_a_sine() -> None:
    """The area by quadrature of sqrt(1 + h'^2) over a quarter of a wave."""
    steepest = 2 * np.pi * HEIGHT / 1000 / 0.8
    at, weight = leggauss(40)
    phase = np.pi / 4 * (at + 1)
    area = (weight / 2 * np.sqrt(1 + (steepest * np.cos(phase)) ** 2)).sum() - 1

    found = Areal.of(waves(90.0, 0.8, PIXELS + RIM), STEP)
    assert found.sdr == pytest.approx(100 * area, rel=2e-3)
    assert found.sdq == pytest.approx(steepest / np.sqrt(2), rel=1e-3)
    steep = slopes(waves(90.0, 0.8, PIXELS + RIM), STEP)
    along, across = SlopeFigures.of(steep[..., 0]), SlopeFigures.of(steep[..., 1])
    assert along.variance == pytest.approx(steepest**2 / 2, rel=2e-3)
    assert across.variance == pytest.approx(0.0, abs=1e-12)
    assert sum(along.histogram) == pytest.approx(1.0)
    # The steepest slopes are the most frequent, and nothing is steeper.
    edge = np.degrees(np.arctan(steepest))
    outermost = int(np.searchsorted(EDGES, edge)) - 1
    assert np.flatnonzero(along.histogram).max() == outermost


def test_signs_of_slopes() -> None:
    """A plane that rises by 0.1 to the right and by 0.2 upwards."""
    x, y = np.meshgrid(LINE, -LINE)
    found = slopes(1000 * (0.1 * x + 0.2 * y), STEP)
    np.testing.assert_allclose(found, np.broadcast_to([0.1, 0.2], found.shape), atol=1e-9)


@pytest.mark.parametrize("degrees", [0.0, 30.0, 90.0, 145.0])
def test_lines_run_where_heights_stay_alike(degrees: float) -> None:
    """The autocorrelation of a sine across its crests is a cosine: it falls to 0.2 at 78.5 degrees
    of a wave. Along them it does not fall."""
    found = Directions.of(waves(degrees, 0.8), STEP)

    assert found.angle == degrees
    assert found.sal == pytest.approx(0.8 * np.arccos(0.2) / (2 * np.pi), rel=0.02)
    assert found.longest == pytest.approx(SIDE / 2)
    assert found.str == pytest.approx(found.sal / found.longest)


def test_noise_has_no_direction() -> None:
    heights = np.random.default_rng(1).standard_normal((200, 200))
    assert Directions.of(heights, STEP).str > 0.7


def test_the_form_is_taken_out() -> None:
    x, y = np.meshgrid(LINE, LINE)
    relief = waves(30.0, 0.4)
    form = 50 + 20 * x - 7 * y + 3 * x * y + 2 * x * x - y * y
    np.testing.assert_allclose(levelled(relief + form), relief, atol=0.5)
    assert np.abs(levelled(relief + form, 1) - relief).max() > 5


@pytest.mark.parametrize(("length", "passed"), [(0.8, 0.5), (0.2, 1.0), (8.0, 0.007)])
def test_a_cutoff_lets_half_of_its_own_wave_through(length: float, passed: float) -> None:
    """A Gaussian passes 1 - 2^-(cutoff/length)^2 of a wave."""
    rough = without_waves(waves(90.0, length), 0.8, STEP)[100:300, 100:300]
    before = waves(90.0, length)[100:300, 100:300]
    assert 1 - 2.0 ** -((0.8 / length) ** 2) == pytest.approx(passed, abs=1e-3)
    np.testing.assert_allclose(rough, passed * before, atol=0.03)


def test_stretch_of_a_sheet_of_waves() -> None:
    """1.25 times as long, as high: the same Ra and Rz, slopes along are 0.8 of what they were."""
    rest = Figures.of(waves(90.0, 0.8), SIDE)
    stretched = Figures.of(waves(90.0, 1.0), SIDE)
    assert stretched.along.ra == pytest.approx(rest.along.ra, rel=0.04)
    ratio = stretched.slopes_along.variance / rest.slopes_along.variance
    assert ratio == pytest.approx(0.64, rel=0.01)
    assert set(rest.as_json()) >= {"areal", "along", "edges", "angles", "directions"}


def test_a_flat_square_has_figures() -> None:
    """It is alike in every direction."""
    found = Figures.of(np.zeros((PIXELS, PIXELS)), SIDE)
    assert (found.areal.sa, found.along.rz, found.slopes_along.rms) == (0.0, 0.0, 0.0)
    assert (found.directions.sal, found.directions.longest) == (SIDE / 2, SIDE / 2)
    assert found.directions.str == 1.0
