"""Wrinkles that bend, taper and are kept from breaking up, in one block, against the reference."""

from __future__ import annotations

import numpy as np
import pytest

from kernels.one_line import evaluate, run
from kernels.test_kernel_draw import BLOCK, SHAPES, options
from reference import arcs
from reference import waves as wavy
from reference.drawing import Wrinkles, crop, meet
from reference.inputs import Shape

DRAWING = """#include "line.clh"
__kernel void block(int count, LINES, __global const float *s, float least, __global float *out)
{
    __local float memory[2 * SUMS];
    shape_t shape = shape_of(vload4(0, s));
    place_t place = place_of_group(1, 0, 0);
    sums_t sums = sums_at(place, memory);
    for (int i = 0; i < count; i++) {
        line_t line = LINE_AT(i, sizes[i], (float2)(0.0f), least);
        draw_line(sums, line, shape);
    }
    write_rows(sums, place, shape, 1.0f, 0, out);
}"""
LIST = """#include "line.clh"
__kernel void block(int total, __global const int *members, LINES, __global const float *s,
                    int alone, __global float *out)
{
    __local float memory[2 * SUMS];
    shape_t shape = shape_of(vload4(0, s));
    place_t place = place_of_group(1, 0, 0);
    sums_t sums = sums_at(place, memory);
    const float2 corner = {3.5f, -2.25f};
    for (int k = 0; alone && k < total; k++) {
        int i = members[k];
        if (i % 5 > 0) {
            line_t line = LINE_AT(i, sizes[i] * 1.5f, corner, 0.7f);
            draw_line(sums, line, shape);
        }
    }
    if (!alone)
        DRAW_LINES(sums, shape, members, 0, total, i % 5 > 0, sizes[i] * 1.5f, corner, 0.7f);
    write_rows(sums, place, shape, 1.0f, 0, out);
}"""
# What nearest_on claims, by the steepest slopes: half widths over the length, and the error.
CLAIMS = {
    0.3: {1 / 8: 2e-3, 1 / 5: 4e-3, 1 / 4: 6e-3, 0.35: 0.01, 0.5: 0.02, 0.75: 0.06, 1.0: 0.11},
    0.6: {1 / 8: 2e-3, 1 / 5: 4e-3, 1 / 4: 6e-3, 0.35: 0.04, 0.5: 0.11, 0.75: 0.19, 1.0: 0.25},
    0.8: {1 / 8: 2e-3, 1 / 5: 6e-3, 1 / 4: 0.02, 0.35: 0.08, 0.5: 0.19, 0.75: 0.25, 1.0: 0.32},
}
WIDE = [
    (steepest, ratio, bound)
    for steepest, bounds in CLAIMS.items()
    for ratio, bound in bounds.items()
]


def drawn(device, lines, shape, least=0.0, items=1, rows=None, waves=None):
    """lines: segments (n, 4), sizes (n, 4) and slopes (n, 2), or only segments and sizes (n, 2)."""
    values = [shape.wrinkle_bulge, shape.pore_bulge, shape.sharpness, shape.slots]
    defines = ["-DBENT=1"] * (len(lines) == 3) + ["-DWAVY=1"] * (waves is not None)
    segments, sizes, slopes = lines if len(lines) == 3 else (*lines, None)
    given = [np.int32(len(segments)), segments, sizes, slopes, waves, np.int32(0), None]
    given += [np.array(values, np.float32), np.float32(least)]
    out = np.zeros((BLOCK, BLOCK), np.float32)
    rows = rows or device.shape.rows  # as many as fit
    size, group = (items, BLOCK // rows), (items, 1)
    return run(device, DRAWING, "block", size, given, out, options(items, rows) + defines, group)


def wanted(lines, shape, least=0.0, waves=None):
    segments, sizes = (x.astype(np.float64) for x in lines[:2])
    ends = np.stack([segments[:, :2], segments[:, :2] + segments[:, 2:]], axis=1)
    half = sizes.shape[1] // 2
    given = Wrinkles(
        ends, sizes[:, :half], sizes[:, half:], least=least,
        slopes=lines[2].astype(np.float64) if len(lines) == 3 else None,
        waves=None if waves is None else wavy.Waves(*waves.astype(float).T),
    )  # fmt: skip
    valleys, bulges = meet(crop(0, 0, BLOCK, BLOCK, BLOCK) * BLOCK, given, None, shape)
    return (bulges - valleys).reshape(BLOCK, BLOCK)


def lines_of(seed, count, steepest, ratio, narrowest=0.02, length=(4.0, 60.0)):
    """Arcs all over the block and beyond, half widths from `narrowest` to `ratio` of the length."""
    rng = np.random.default_rng(seed)
    angle, long = rng.uniform(0, 2 * np.pi, count), rng.uniform(*length, count)
    extent = long[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    start = rng.uniform(-0.2 * BLOCK, 1.2 * BLOCK, (count, 2)) - 0.5 * extent
    half_width = rng.uniform(narrowest, ratio, (count, 2)) * long[:, None]
    sizes = np.concatenate([half_width, rng.uniform(0, 1, (count, 2))], axis=1)
    slopes = rng.uniform(-steepest, steepest, (count, 2))
    slopes[: count // 2] = steepest * np.sign(slopes[: count // 2])
    segments = np.concatenate([start, extent], axis=1)
    return [x.astype(np.float32) for x in (segments, sizes, slopes)]


@pytest.mark.parametrize(
    ("steepest", "ratio", "bound"),
    [(0.8, 1 / 8, 1e-3)]
    + [
        pytest.param(*one, marks=pytest.mark.slow)
        for one in ((0.6, 1 / 5, 1e-3), (0.8, 0.25, 6e-3))
    ],
)
def test_each_arc_alone_is_that_of_the_true_distance(device, steepest, ratio, bound):
    lines = lines_of(1, 60, steepest, ratio)
    for i in range(60):
        line = [x[i : i + 1] for x in lines]
        off = np.abs(drawn(device, line, Shape()) - wanted(line, Shape())).max()
        assert off <= bound


@pytest.mark.slow
@pytest.mark.parametrize("bulge", [0.0, 1.0])
@pytest.mark.parametrize(("steepest", "ratio", "bound"), WIDE)
def test_wide_arcs_are_as_near_as_it_is_said(device, steepest, ratio, bound, bulge):
    """All of their widths near the ratio; the bounds are none that any method would keep."""
    shape = Shape(wrinkle_bulge=bulge)
    lines = lines_of(9, 40, steepest, ratio, 0.7 * ratio, (12.0, 24.0))
    off = []
    for i in range(40):
        line = [x[i : i + 1] for x in lines]
        off.append(np.abs(drawn(device, line, shape) - wanted(line, shape)).max())
    assert max(off) <= bound
    assert max(off) >= bound / 50


@pytest.mark.parametrize("shape", SHAPES)
def test_a_block_of_arcs_is_that_of_double(device, shape):
    lines = lines_of(2, 40, 0.5, 0.2)
    found = drawn(device, lines, shape)
    # A larger bulge has steeper sides.
    bound = 1e-3 * max(shape.wrinkle_bulge / 2.5, 1.0)
    assert np.abs(found - wanted(lines, shape)).max() <= bound
    straight = [*lines[:2], 0 * lines[2]]
    assert np.abs(found - drawn(device, straight, shape)).max() > 0.1


def test_straight_tapers_are_those_of_double_closely(device):
    lines = lines_of(3, 40, 0.0, 0.3)
    assert np.abs(drawn(device, lines, Shape()) - wanted(lines, Shape())).max() <= 1e-4


def test_an_even_line_without_slopes_is_the_plain_one(device):
    segments, sizes, slopes = lines_of(4, 60, 0.0, 0.3)
    plain = segments, sizes[:, 1:3].copy()
    even = segments, sizes[:, [1, 1, 2, 2]].copy(), slopes
    found = drawn(device, even, Shape())
    np.testing.assert_allclose(found, drawn(device, plain, Shape()), atol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("steepest", [0.0, 0.6])
@pytest.mark.parametrize("bent", [True, False])
def test_lines_below_the_least_half_width_are_wider_and_keep_their_mean(device, bent, steepest):
    lines = lines_of(5, 40, steepest, 0.012, 0.004, (20.0, 60.0))
    if not bent:
        lines = lines[0], lines[1][:, 1:3].copy()
    least = 0.7
    found, reference = drawn(device, lines, Shape(), least), wanted(lines, Shape(), least)
    assert np.abs(found - reference).max() <= 1e-3
    assert np.abs(reference - wanted(lines, Shape())).max() > 0.1


@pytest.mark.parametrize(("items", "rows"), [(2, None), (16, None), (64, None), (1, 16), (16, 32)])
def test_any_launch_gives_the_same_bits(device, items, rows):
    lines = lines_of(6, 60, 0.8, 0.2)
    one = drawn(device, lines, Shape(), 0.7)
    np.testing.assert_array_equal(drawn(device, lines, Shape(), 0.7, items, rows), one)


@pytest.mark.parametrize("count", [1, 16, 19, 20, 21, 90])
@pytest.mark.parametrize("more", [(), ("-DWAVY=1",), ("-DWAVY=1", "-DSKEWED=1")])
def test_a_list_of_lines_is_that_of_each_alone_bit_for_bit(device, count, more):
    """Sixteen are made ready at once; some are not chosen, some lie beyond the block."""
    rng = np.random.default_rng(count)
    segments, sizes, slopes = lines_of(8, 100, 0.8, 0.2)
    segments[::3, :2] += rng.choice([-90, 90], (34, 2)).astype(np.float32)
    waves = rng.uniform([-4, 1, 0, 1], [4, 5, 1, 1], (100, 4)).astype(np.float32)
    skews = rng.uniform([0.5, -0.5, 0.5, 0], [2, 0.5, 2, 0], (40, 4)).astype(np.float32)
    members = np.sort(rng.permutation(100)[:count]).astype(np.int32)
    lines = [segments, sizes, slopes, waves, np.int32(60), skews]
    given = [np.int32(count), members, *lines, np.array([2.5, 0, 8, 8], np.float32)]
    defines = [*options(1, device.shape.rows), "-DBENT=1", *more]
    size = (1, BLOCK // device.shape.rows)
    found, alone = (
        run(device, LIST, "block", size, [*given, np.int32(way)],
            np.zeros((BLOCK, BLOCK), np.float32), defines, (1, 1))
        for way in (0, 1)
    )  # fmt: skip
    np.testing.assert_array_equal(found, alone)
    assert count == 1 or np.ptp(found) > 0.1


def test_two_lines_that_share_a_tangent_are_one_at_their_pore(device):
    """Along the normal of the common tangent, where each chord is turned away from it, no step."""
    turn, length, half_width = 0.45, 24.0, 4.0
    pore, slope = np.array([32.0, 30.0]), np.tan(turn)
    way = length * np.array([np.cos(turn), -np.sin(turn)])
    segments = np.array([[*(pore - way * [1, -1]), *(way * [1, -1])], [*pore, *way]])
    sizes = np.array([[half_width, half_width, 1, 1]] * 2)
    slopes = np.array([[0, -slope], [slope, 0]])
    pair = [x.astype(np.float32) for x in (segments, sizes, slopes)]
    # At the pore both are there, deeper by log(2)/20 at most; the rest is one smooth trough.
    heights = drawn(device, pair, Shape())[::-1]  # v ascends
    np.testing.assert_allclose(heights[:, 20:32], heights[:, 32:44][:, ::-1], atol=1e-5)
    assert roughness(heights) < 0.06
    kinked = drawn(device, [*pair[:2], 0 * pair[2]], Shape())[::-1]
    assert roughness(kinked) > 0.12


def roughness(heights):
    """The largest change of a row's slope from column to column near the pore, over that farther
    along the trough."""
    change = np.abs(np.diff(heights[20:40], n=2, axis=1))
    return change[:, 26:36].max() - change[:, 14:24].max()


def test_waves_on_arcs_are_those_of_double(device):
    lines = lines_of(7, 40, 0.5, 0.15)
    rng, length = np.random.default_rng(8), np.linalg.norm(lines[0][:, 2:], axis=1)
    share = rng.choice([1.0, 0.7, -0.4], 40)
    columns = (0.1 * length * rng.uniform(-1, 1, 40), rng.uniform(0, 3, 40), rng.random(40), share)
    waves = np.stack(columns, axis=1).astype(np.float32)
    found = drawn(device, lines, Shape(), waves=waves)
    # As arc.clh claims.
    assert np.abs(found - wanted(lines, Shape(), waves=waves)).max() <= 3e-3
    assert np.abs(found - drawn(device, lines, Shape())).max() > 0.1


def test_waves_ride_on_the_arc(device):
    segments = np.array([[6.0, 20.0, 50.0, 0.0]], np.float32)
    sizes, slopes = np.array([[2.0, 2, 1, 1]], np.float32), np.array([[0.5, -0.5]], np.float32)
    wave = np.array([[1.5, 2.5, 0.3, 1.0]], np.float32)
    found = drawn(device, (segments, sizes, slopes), Shape(), waves=wave)[::-1]
    s = (np.arange(BLOCK) + 0.5 - 6.0) / 50.0
    inside = (s > 0.1) & (s < 0.9)
    y = 20.0 + 50.0 * arcs.offset(s, slopes[0]) + 1.5 * wavy.wave(s, 2.5, 0.3, level=True)
    bottom = found.argmin(axis=0) + 0.5
    assert np.abs(bottom - y)[inside].max() <= 1.0
    still = drawn(device, (segments, sizes, slopes), Shape(), waves=wave * np.float32([0, 1, 1, 1]))
    np.testing.assert_array_equal(still, drawn(device, (segments, sizes, slopes), Shape()))


def test_places_of_the_broad_layer_are_rounded_as_rint_does(device):
    half = np.arange(-9, 9) + 0.5
    large = 2.0 ** np.arange(21, 27)
    values = np.concatenate([half, large - 1, large - 0.5, -large - 0.25, [0.0, -0.0, 0.49999997]])
    v = np.resize(values, 2 * 32).reshape(-1, 2).astype(np.float32)
    sizes = {"BLOCK": 68, "ROWS": 68, "ITEMS": 1, "APRON": 2, "COARSE_BLOCK": 64}
    given = [f"-D{name}={size}" for name, size in sizes.items()]
    given += ["-DWIDENED=1.5f", "-DLEAST_HALF_WIDTH=1.25f"]
    found = evaluate(device, "coarse", "nearest_whole(v)", {"v": v}, width=2, options=given)
    np.testing.assert_array_equal(found, np.rint(v))
