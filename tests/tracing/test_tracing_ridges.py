"""Valley points and pits of reliefs that are known, and the kernel against float64."""

from __future__ import annotations

import numpy as np
import pytest

from reference import tracing as reference
from rhytid.synthesis.workspace import Workspace
from rhytid.tracing import ridges
from rhytid.tracing.ridges import Limits, find_ridges, noise_of

SIDE = 160
LIMITS = Limits(0.02)


def found(device, relief, limits=LIMITS, inside=None, tile=ridges.TILE):
    inside = np.ones(relief.shape, np.bool_) if inside is None else inside
    with Workspace(device) as work:
        return find_ridges(work, relief.astype(np.float32), inside, limits, tile)


def uneven(seed, side=SIDE):
    """A smooth relief with valleys all over."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:side, :side]
    waves = rng.uniform(-0.5, 0.5, (24, 2))
    return sum(np.sin(a * x + b * y + i) for i, (a, b) in enumerate(waves)) / 24


@pytest.mark.parametrize("angle", [0.0, 0.3, 0.8, 1.4])
@pytest.mark.parametrize("half_width", [2.5, 4.5])
def test_points_lie_on_a_line_within_a_fraction_of_a_texel(device, angle, half_width):
    middle, along = SIDE / 2 + 0.37, np.array([np.cos(angle), np.sin(angle)])
    ends = np.concatenate([middle - 55 * along, middle + 55 * along])
    relief = reference.relief_of_lines(SIDE, ends[None], half_width, 1.0, 1.0)
    points, pits = found(device, relief)
    step = np.stack([points.x, points.y], axis=1) - middle
    far = np.abs(step @ along) < 45
    across = step[far] @ np.array([-along[1], along[0]])
    assert far.sum() > 80
    assert np.abs(across).max() < 0.12
    assert np.abs(points.along[far] @ along).min() > 0.999
    assert len(pits) <= 4  # at its ends at most


@pytest.mark.parametrize("radius", [3.0, 6.0])
def test_a_pore_is_one_pit(device, radius):
    centres = np.array([[40.0, 50.0], [100.0, 90.0], [60.0, 120.0]])
    _, pits = found(device, reference.relief_of_pores(SIDE, centres, radius, 1.0))
    order = np.lexsort((centres[:, 0], centres[:, 1]))
    assert np.stack([pits.x, pits.y], axis=1) == pytest.approx(centres[order], abs=0.6)
    assert pits.curvature[:, 0] == pytest.approx(pits.curvature[:, 1], rel=0.1)


def test_the_kernel_finds_the_curvatures_of_the_reference(device):
    relief = uneven(1)
    points, _ = found(device, relief, Limits(1e-6))
    assert len(points) > 100
    for scale in np.unique(points.scale):
        some = points.take(points.scale == scale)
        taps, _ = ridges.gaussian_taps(scale)
        x, y, *second = reference.derivatives(relief.astype(np.float32).astype(np.float64), taps)
        larger, _, across = (v[some.row, some.column] for v in reference.curvatures(*second))
        most = np.abs(larger).max()
        assert some.curvature == pytest.approx(larger, abs=2e-4 * most)
        assert np.abs((some.along * across).sum(axis=1)).max() < 2e-2
        gradient = np.stack([x, y], axis=-1)[some.row, some.column]
        way = -(gradient * across).sum(axis=1) / larger
        off = np.stack([some.x - some.column, some.y - some.row], axis=1)
        assert (off * across).sum(axis=1) == pytest.approx(way, abs=2e-2)


def test_tiles_of_any_size_find_the_same_bit_for_bit(device):
    relief = uneven(2) + reference.relief_of_pores(SIDE, np.array([[64.0, 64.0]]), 4.0, 1.0)
    for one, two in zip(found(device, relief), found(device, relief, tile=64), strict=True):
        for name in vars(one):
            assert (getattr(one, name) == getattr(two, name)).all(), name


def test_nothing_is_found_outside_of_the_skin(device):
    inside = np.zeros((SIDE, SIDE), np.bool_)
    inside[:, 80:] = True
    points, pits = found(device, uneven(3), inside=inside)
    assert len(points)
    assert points.column.min() >= 80
    assert pits.x.min(initial=80) >= 80


@pytest.mark.parametrize("deviation", [0.002, 0.05])
def test_noise_is_measured_and_gives_no_lines(device, deviation):
    rng = np.random.default_rng(4)
    noise = rng.normal(0.0, deviation, (320, 320)).astype(np.float32)
    measured = noise_of(noise, np.ones(noise.shape, np.bool_))
    assert measured == pytest.approx(deviation, rel=0.15)
    points, pits = found(device, noise, Limits(0.0, measured))
    assert len(points) < 60  # of 102,400 texels
    assert len(pits) < 10


def test_lines_count_little_as_noise():
    lines = np.array([[10.0, 5.0 + 12 * i, 150.0, 9.0 + 12 * i] for i in range(12)])
    relief = reference.relief_of_lines(SIDE, lines, 2.0, 1.0, 1.0)
    rng = np.random.default_rng(5)
    noisy = (relief + rng.normal(0.0, 0.01, relief.shape)).astype(np.float32)
    assert noise_of(noisy, np.ones(noisy.shape, np.bool_)) == pytest.approx(0.01, rel=0.5)


def test_taps_are_exact_for_parabolas():
    for scale in ridges.SCALES:
        taps, radius = ridges.gaussian_taps(scale)
        k = np.arange(-radius, radius + 1)
        moments = taps @ np.stack([k**0, k, k**2], axis=1)
        assert moments[:, :2] == pytest.approx(np.array([[1, 0], [0, 1], [0, 0]]), abs=1e-12)
        assert moments[2, 2] == pytest.approx(2.0)
