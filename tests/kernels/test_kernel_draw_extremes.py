"""What draw.clh claims at the ends of its range: long and thin, tiny, and very many elements."""

from __future__ import annotations

import numpy as np
import pytest

from kernels.one_line import evaluate, run
from kernels.test_kernel_draw import (
    BLOCK,
    LANES,
    NO_PORES,
    NO_WRINKLES,
    drawn,
    mellow_max,
    options,
    wanted,
)
from reference.inputs import Shape

SHAPES = (Shape(), Shape(wrinkle_bulge=9.0, pore_bulge=9.0))


def long_segment(rng, length, half_width):
    """Segment (1, 4) and size (1, 2) through a place of the block, the block anywhere along it."""
    angle, share = rng.uniform(0, 2 * np.pi), rng.uniform()
    extent = length * np.array([np.cos(angle), np.sin(angle)])
    start = rng.uniform(5, BLOCK - 5, 2) - share * extent
    line = np.concatenate([start, extent])[None].astype(np.float32)
    return line, np.array([[half_width, 1.0]], np.float32)


def long_pore(rng, slim, aspect):
    """Centre (1, 2) and metric (1, 4) of a pore `aspect` times as long as its `slim` radius."""
    angle = rng.uniform(0, np.pi)
    c, s, a, b = np.cos(angle), np.sin(angle), (slim * aspect) ** -2.0, slim**-2.0
    metric = [a * c * c + b * s * s, (a - b) * c * s, a * s * s + b * c * c, 1.0]
    return rng.uniform(0, BLOCK, (1, 2)).astype(np.float32), np.array([metric], np.float32)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("half_width", [0.3, 1.0, 3.0])
def test_segments_of_300_half_widths_are_within_the_bound(device, half_width, shape):
    rng = np.random.default_rng(1)
    for _ in range(25):
        line = long_segment(rng, 300 * half_width, half_width)
        found = drawn(device, line, NO_PORES, shape)
        assert np.abs(found - wanted(line, NO_PORES, shape)).max() <= 1e-4


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("aspect", [10, 100, 1000])
def test_pores_1000_times_as_long_as_wide_are_within_the_bound(device, aspect, shape):
    rng = np.random.default_rng(2)
    deepest = 0.0
    for slim in (0.5, 1.0, 3.0) * 8:
        disc = long_pore(rng, slim, aspect)
        found = drawn(device, NO_WRINKLES, disc, shape)
        deepest = min(deepest, found.min())
        assert np.abs(found - wanted(NO_WRINKLES, disc, shape)).max() <= 1e-4
    assert deepest < -0.9


def test_thousands_of_wrinkles_in_one_place_stay_finite(device):
    # Each adds e^80 to a sum; float32 ends at e^88.7. Furrows, and bulges beside them.
    count = 20_000
    line = np.tile(np.array([[8.5, 32.5, 40.0, 0.0]], np.float32), (count, 1))
    sizes = np.tile(np.array([[12.0, 4.0]], np.float32), (count, 1))
    found = drawn(device, (line, sizes), NO_PORES, Shape(wrinkle_bulge=9.0))
    assert np.isfinite(found).all()
    assert found.min() <= -4.0
    assert found.max() >= 4.0


def test_sums_up_to_their_end_are_exact_and_beyond_it_level(device):
    sums = np.tile(np.float32([1e30, 1e35, 7.9e37, np.inf]), 2)[None]
    none = np.zeros_like(sums)
    call = "mellow_max(q, v, (shape_t){0.0f, 0.0f, 20.0f, 1.0f})"
    exact = np.log1p(np.minimum(sums.astype(np.float64), 8e37)) / 20.0
    for q, v, height in ((sums, none, exact), (none, sums, -exact), (sums, sums, 0 * exact)):
        found = evaluate(device, "draw", call, {"q": q, "v": v}, width=LANES, options=options(1))
        np.testing.assert_allclose(found, height, atol=1e-5)
    assert mellow_max(np.array([4.0]), 20.0) < exact.max()


@pytest.mark.parametrize("t2", [1.0, 1e30, np.inf])
def test_a_profile_adds_nothing_outside_however_far(device, t2):
    found = profile_sums(device, "add_profile(sums, 0, t2, 28.0f, 2.5f)", t2)
    np.testing.assert_array_equal(found, 0.0)


def profile_sums(device, call, t2):
    text = f"""#include "draw.clh"
__kernel void one(__global const float *in, __global float *out)
{{
    __local float memory[2 * SUMS];
    sums_t sums = sums_at(place_of_group(1, 0, 0), memory);
    REALS t2 = in[0];
    {call};
    vstore8(vload8(0, sums.valleys), 0, out);
    vstore8(vload8(0, sums.bulges), 1, out);
}}"""
    values = np.full(LANES, t2, np.float32)
    out = np.ones(2 * LANES, np.float32)
    rows = device.shape.rows
    return run(device, text, "one", (1,), [values], out, options(1, rows), (1,))
