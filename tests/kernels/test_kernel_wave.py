"""Wavy wrinkles in one block, against the reference; straight ones against draw.clh."""

from __future__ import annotations

import numpy as np
import pytest

from kernels.one_line import evaluate, run
from kernels.test_kernel_draw import BLOCK, LANES, SHAPES, options, wrinkles
from reference import waves as reference
from reference.drawing import Wrinkles, crop, meet
from reference.inputs import Shape

DRAWING = """#include "line.clh"
__kernel void block(int count, LINES, __global const float *s, __global float *out)
{
    __local float memory[2 * SUMS];
    shape_t shape = shape_of(vload4(0, s));
    place_t place = place_of_group(1, 0, 0);
    sums_t sums = sums_at(place, memory);
    for (int i = 0; i < count; i++) {
        line_t line = LINE_AT(i, sizes[i], (float2)(0.0f), 0.0f);
        draw_line(sums, line, shape);
    }
    write_rows(sums, place, shape, 1.0f, 0, out);
}"""
WAVY, STRAIGHT = ["-DWAVY=1"], list[str]()


def drawn(device, lines, waves, shape, items=1, rows=None, draw=WAVY):
    rows = rows or device.shape.rows
    values = [shape.wrinkle_bulge, shape.pore_bulge, shape.sharpness, shape.slots]
    given = [np.int32(len(waves)), *lines, None, waves, np.int32(0), None]
    given += [np.array(values, np.float32)]
    out = np.zeros((BLOCK, BLOCK), np.float32)
    size, group = (items, BLOCK // rows), (items, 1)
    return run(device, DRAWING, "block", size, given, out, options(items, rows) + draw, group)


def random_waves(seed, lines, most=1.5):
    """(n, 4): amplitudes up to `most` half widths and a fifth of the length, waves as long as the
    half width or longer, whole wrinkles and parts of both kinds."""
    rng = np.random.default_rng(seed)
    (segments, sizes), count = lines, len(lines[0])
    length = np.linalg.norm(segments[:, 2:], axis=1)
    amplitude = np.minimum(most * sizes[:, 0], 0.2 * length) * rng.uniform(-1, 1, count)
    share = rng.choice([1.0, 0.7, 0.3, -0.6, -0.2], count)
    number = rng.uniform(0, 1, count) * np.minimum(length / sizes[:, 0] / np.abs(share), 30)
    columns = (amplitude, number, rng.uniform(0, 1, count), share)
    return np.stack(columns, axis=1).astype(np.float32)


def wanted(lines, waves, shape):
    segments, sizes = (x.astype(np.float64) for x in lines)
    ends = np.stack([segments[:, :2], segments[:, :2] + segments[:, 2:]], axis=1)
    given = Wrinkles(ends, sizes[:, 0], sizes[:, 1], reference.Waves(*waves.astype(float).T))
    valleys, bulges = meet(crop(0, 0, BLOCK, BLOCK, BLOCK) * BLOCK, given, None, shape)
    return (bulges - valleys).reshape(BLOCK, BLOCK)


@pytest.mark.parametrize("shape", SHAPES)
def test_a_block_is_that_of_double(device, shape):
    lines = wrinkles(1, 40)
    waves = random_waves(2, lines)
    found = drawn(device, lines, waves, shape)
    assert np.abs(found - wanted(lines, waves, shape)).max() <= 1e-4
    assert np.abs(found - drawn(device, lines, waves, shape, draw=STRAIGHT)).max() > 0.1


def test_each_wrinkle_alone_is_that_of_double(device):
    lines = wrinkles(3, 60)
    waves = random_waves(4, lines, most=3.0)
    for i in range(60):
        line, own = [x[i : i + 1] for x in lines], waves[i : i + 1]
        found = drawn(device, line, own, Shape())
        assert np.abs(found - wanted(line, own, Shape())).max() <= 1e-4


def test_amplitude_0_is_the_straight_wrinkle_bit_for_bit(device):
    lines = wrinkles(5, 60)
    waves = random_waves(6, lines) * np.array([0, 1, 1, 1], np.float32)
    straight = drawn(device, lines, waves, Shape(), draw=STRAIGHT)
    np.testing.assert_array_equal(drawn(device, lines, waves, Shape()), straight)
    assert np.abs(straight).max() > 0.5


@pytest.mark.parametrize(
    ("items", "rows"),
    [
        (2, None),
        (16, 32),
        *(
            pytest.param(*more, marks=pytest.mark.slow)
            for more in ((16, None), (64, None), (1, 16))
        ),
    ],
)
def test_any_launch_gives_the_same_bits(device, items, rows):
    lines = wrinkles(7, 60)
    waves = random_waves(8, lines)
    one = drawn(device, lines, waves, Shape())
    np.testing.assert_array_equal(drawn(device, lines, waves, Shape(), items, rows), one)


def test_two_parts_of_one_wave_meet(device):
    """A wrinkle from both ends: the second part goes back, so its left is right of the first."""
    whole = np.array([[8, 20, 48, 16]], np.float32), np.array([[3.0, 1.0]], np.float32)
    wave = np.array([[4.0, 2.3, 0.4, 1.0]], np.float32)
    parts = np.array([[8, 20, 24, 8], [56, 36, -24, -8]], np.float32), whole[1].repeat(2, axis=0)
    both = wave * np.array([[1, 1, 1, 0.5], [-1, 1, 1, -0.5]], np.float32)
    one = drawn(device, whole, wave, Shape())
    halves = [
        drawn(device, [x[i : i + 1] for x in parts], both[i : i + 1], Shape()) for i in (0, 1)
    ]
    # Away from the round ends where the parts meet, each texel is that of one part.
    column, row = np.meshgrid(np.arange(BLOCK) + 0.5, BLOCK - np.arange(BLOCK) - 0.5)
    along = ((column - 32) * 48 + (row - 28) * 16) / np.hypot(48, 16)
    np.testing.assert_allclose(halves[0][along < -4], one[along < -4], atol=1e-5)
    np.testing.assert_allclose(halves[1][along > 4], one[along > 4], atol=1e-5)
    assert one[np.abs(along) > 4].min() < -0.9


def test_the_wave_is_that_of_double_and_stays_within_1(device):
    rng = np.random.default_rng(9)
    x = rng.uniform(0, 1, (4000, LANES)).astype(np.float32)
    x[:, 0], x[:, 1] = 0.0, 1.0
    number = (30 * rng.uniform(0, 1, 4000) ** 3).astype(np.float32)
    phase = rng.uniform(0, 1, 4000).astype(np.float32)
    inputs = {"x": x, "n": number, "p": phase}
    found = evaluate(device, "wave", "wave_at(x, n, p)", inputs, width=LANES, options=options(1))
    each = zip(x.astype(float), number.astype(float), phase.astype(float), strict=True)
    np.testing.assert_allclose(found, [reference.wave(*one) for one in each], atol=1e-4)
    assert np.abs(found).max() <= 1.0
    np.testing.assert_array_equal(found[:, :2], 0.0)


def test_on_arcs_the_wave_is_that_of_double_and_ends_level(device):
    rng = np.random.default_rng(10)
    x = rng.uniform(0, 1, (2000, LANES)).astype(np.float32)
    x[:, 0], x[:, 1] = 1e-4, 1 - 1e-4
    number, phase = (rng.uniform(0, top, 2000).astype(np.float32) for top in (5, 1))
    inputs, bent = {"x": x, "n": number, "p": phase}, [*options(1), "-DBENT=1"]
    found = evaluate(device, "wave", "wave_at(x, n, p)", inputs, width=LANES, options=bent)
    each = zip(x.astype(float), number.astype(float), phase.astype(float), strict=True)
    wanted = [reference.wave(*one, level=True) for one in each]
    np.testing.assert_allclose(found, wanted, atol=1e-4)
    # The slope there, in lengths of the wrinkle: up to 8 n where the wave is not level.
    assert np.abs(found[:, :2]).max() <= 0.2 * 1e-4


def test_a_row_of_arcs_is_nearly_a_sine():
    p = np.linspace(-2, 2, 4001)
    assert np.abs(reference.arcs(p) - np.sin(2 * np.pi * p)).max() < 0.06
