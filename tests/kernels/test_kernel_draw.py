"""Profiles, the mellow-max and the spans of texels, in one block, against the reference."""

from __future__ import annotations

import numpy as np
import pytest

from kernels.one_line import evaluate, run
from reference.drawing import (
    Pores,
    Wrinkles,
    at_least,
    crop,
    meet,
    mellow_max,
    segment_distance,
)
from reference.inputs import Shape

BLOCK, LANES = 64, 8
BOTH, VALLEYS, BULGES = range(3)  # the parts of draw.clh
SHAPES = (
    Shape(),
    Shape(wrinkle_bulge=7.0, pore_bulge=4.0),
    Shape(wrinkle_bulge=0.0, sharpness=3.0, slots=16),
    Shape(wrinkle_bulge=9.0, pore_bulge=9.0, sharpness=0.1, slots=3),
)
NO_WRINKLES = np.zeros((0, 4), np.float32), np.zeros((0, 2), np.float32)
NO_PORES = np.zeros((0, 2), np.float32), np.zeros((0, 4), np.float32)
DRAWING = """#include "line.clh"
__kernel void block(int wrinkles, LINES, int pores, __global const float2 *centres,
                    __global const float4 *roots, __global const float *s, int part,
                    __global float *out)
{
    __local float memory[2 * SUMS];
    shape_t shape = shape_of(vload4(0, s));
    place_t place = place_of_group(1, 0, 0);
    sums_t sums = sums_at(place, memory);
    for (int i = 0; i < wrinkles; i++) {
        line_t line = LINE_AT(i, sizes[i], (float2)(0.0f), 0.0f);
        draw_line(sums, line, shape);
    }
    for (int i = 0; i < pores; i++)
        draw_pore(sums, centres[i], roots[i].xyz, roots[i].w, shape);
    write_rows(sums, place, shape, 1.0f, part, out);
}"""


def options(items, rows=BLOCK):
    return [f"-DBLOCK={BLOCK}", f"-DROWS={rows}", f"-DITEMS={items}"]


def roots(metrics):
    """(n, 4) factors with the strength last: root.T @ root is the metric."""
    uu, uv, vv, strength = metrics.astype(np.float64).T
    xx = np.sqrt(uu)
    return np.stack([xx, uv / xx, np.sqrt((uu * vv - uv**2) / uu), strength], 1).astype(np.float32)


def wrinkles(seed, count, half_width=(0.3, 12.0)):
    """Segments (n, 4) and sizes (n, 2) in texels; many leave the block."""
    rng = np.random.default_rng(seed)
    ends = rng.uniform(-0.4 * BLOCK, 1.4 * BLOCK, (count, 2, 2)).astype(np.float32)
    segments = np.concatenate([ends[:, 0], ends[:, 1] - ends[:, 0]], axis=1)
    sizes = np.stack([rng.uniform(*half_width, count), rng.uniform(0, 1, count)], axis=1)
    return segments.astype(np.float32), sizes.astype(np.float32)


def pores(seed, count):
    """Centres (n, 2) and metrics (n, 4) with the strength last; ellipses of 0.3 to 15 texels."""
    rng = np.random.default_rng(seed)
    angle, (wide, slim) = rng.uniform(0, np.pi, count), rng.uniform(0.3, 15.0, (2, count))
    c, s, a, b = np.cos(angle), np.sin(angle), wide**-2, slim**-2
    metric = [a * c * c + b * s * s, (a - b) * c * s, a * s * s + b * c * c]
    centres = rng.uniform(-0.2 * BLOCK, 1.2 * BLOCK, (count, 2))
    rows = np.stack([*metric, rng.uniform(0, 1, count)], axis=1)
    return centres.astype(np.float32), rows.astype(np.float32)


def drawn(device, lines, discs, shape, items=1, rows=None, part=BOTH):
    """(BLOCK, BLOCK) displacement of depth 1, top row first, by groups of `items` work-items that
    draw `rows` rows each, as many as fit where that is None."""
    rows = rows or device.shape.rows
    values = [shape.wrinkle_bulge, shape.pore_bulge, shape.sharpness, shape.slots]
    arguments = [np.int32(len(lines[0])), *lines, None, None, np.int32(0), None]
    arguments += [np.int32(len(discs[0])), discs[0], roots(discs[1])]
    filled = [a if np.size(a) else np.zeros(4, np.float32) for a in arguments]
    out = np.zeros((BLOCK, BLOCK), np.float32)
    shape_values = np.array(values, np.float32)
    size, group = (items, BLOCK // rows), (items, 1)
    given = [*filled, shape_values, np.int32(part)]
    return run(device, DRAWING, "block", size, given, out, options(items, rows), group)


def wanted(lines, discs, shape, part=BOTH):
    segments, sizes = (x.astype(np.float64) for x in lines)
    ends = np.stack([segments[:, :2], segments[:, :2] + segments[:, 2:]], axis=1)
    metrics = discs[1].astype(np.float64)
    points = crop(0, 0, BLOCK, BLOCK, BLOCK) * BLOCK
    valleys, bulges = meet(
        points,
        Wrinkles(ends, sizes[:, 0], sizes[:, 1]),
        Pores(discs[0].astype(np.float64), metrics[:, :3], metrics[:, 3]),
        shape,
    )
    height = {BOTH: bulges - valleys, VALLEYS: -valleys, BULGES: bulges}[part]
    return height.reshape(BLOCK, BLOCK)


@pytest.mark.parametrize("shape", SHAPES)
def test_a_block_of_both_is_that_of_double(device, shape):
    lines, discs = wrinkles(1, 40), pores(2, 30)
    found = drawn(device, lines, discs, shape)
    assert np.abs(found - wanted(lines, discs, shape)).max() <= 1e-4


@pytest.mark.parametrize("shape", SHAPES)
def test_each_wrinkle_and_each_pore_alone(device, shape):
    lines, discs = wrinkles(3, 12), pores(4, 12)
    for i in range(12):
        line, disc = ([x[i : i + 1] for x in both] for both in (lines, discs))
        for scene in ((line, NO_PORES), (NO_WRINKLES, disc)):
            found = drawn(device, *scene, shape)
            assert np.abs(found - wanted(*scene, shape)).max() <= 1e-4


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("part", [VALLEYS, BULGES])
def test_one_part_is_that_of_double_and_of_one_sign(device, shape, part):
    lines, discs = wrinkles(1, 40), pores(2, 30)
    found = drawn(device, lines, discs, shape, part=part)
    expected = wanted(lines, discs, shape, part)
    assert np.abs(found - expected).max() <= 1e-4
    np.testing.assert_array_equal(np.sign(found) * (1 if part == BULGES else -1) >= 0, True)
    assert (np.abs(expected).max() > 0.1) == (part == VALLEYS or shape.wrinkle_bulge > 0)


def test_any_number_of_work_items_gives_the_same_bits(device):
    lines, discs = wrinkles(5, 60), pores(6, 60)
    one = drawn(device, lines, discs, Shape())
    for items in (2, 16, 64):
        np.testing.assert_array_equal(drawn(device, lines, discs, Shape(), items), one)


@pytest.mark.parametrize(
    ("rows", "items"),
    [
        *[(16, 1), (16, 32), (32, 16)],
        *(pytest.param(*shape, marks=pytest.mark.slow) for shape in [(16, 16), (32, 1), (32, 32)]),
    ],
)
def test_any_number_of_rows_in_a_group_gives_the_same_bits(device, rows, items):
    lines, discs = wrinkles(5, 60), pores(6, 60)
    whole = drawn(device, lines, discs, Shape())
    np.testing.assert_array_equal(drawn(device, lines, discs, Shape(), items, rows), whole)


def test_a_lone_wrinkle_keeps_its_depth_and_the_rest_is_exactly_flat(device):
    line = np.array([[8.5, 32.5, 40.0, 0.0]], np.float32), np.array([[5.0, 0.75]], np.float32)
    found = drawn(device, line, NO_PORES, Shape())
    np.testing.assert_allclose(found[31, 8:49], -0.75, rtol=1e-6)  # v = 32.5 is row 31
    np.testing.assert_array_equal(found[:26], 0.0)
    np.testing.assert_array_equal(found[37:], 0.0)


def test_elements_beyond_the_block_leave_it_flat(device):
    apart = np.array([[-30, 5, 20, 3], [5, 80, 40, 10], [1e6, -1e6, 3, 3]], np.float32)
    sizes = np.full((3, 2), (9.0, 1.0), np.float32)
    centres = np.array([[-20, 30], [30, 1e7], [90, 90]], np.float32)
    metrics = np.tile(np.array([[0.01, 0, 0.01, 1]], np.float32), (3, 1))
    np.testing.assert_array_equal(drawn(device, (apart, sizes), (centres, metrics), Shape()), 0.0)


def columns_of_segments(seed, count=20000):
    """a, e, half width and the first column of a vector; some upright, some long, some short."""
    rng = np.random.default_rng(seed)
    a = rng.uniform(-0.5, 1.5, (count, 2)) * BLOCK
    e = rng.uniform(-1, 1, (count, 2)) * 10.0 ** rng.uniform(-2, 3, (count, 1))
    e[::2, 0] *= 10.0 ** rng.uniform(-4, 0, count // 2)  # more or less along the columns
    e[::7, 1] = 0.0
    half_width = 10.0 ** rng.uniform(-1, 1.5, count)
    floats = [v.astype(np.float32) for v in (a, e, half_width)]
    return [*floats, rng.integers(0, BLOCK - LANES, count).astype(np.int32)]


@pytest.mark.slow
def test_rows_near_never_cuts_a_texel_that_the_profile_reaches(device):
    a, e, half_width, first = columns_of_segments(7)
    inputs = {"a": a, "e": e, "h": half_width, "x": first}
    rows = [
        evaluate(device, "line", f"rows_near(a, e, h, x).{end}", inputs, np.int32, 1, options(1))
        for end in ("low", "high")
    ]
    reached = 0
    vector = crop(0, 0, BLOCK, LANES, BLOCK)[::-1] * BLOCK  # v ascends
    for i, (low, high) in enumerate(zip(*rows, strict=True)):
        start = a[i].astype(np.float64)
        distance = segment_distance(vector + np.array([first[i], 0]), start, start + e[i])
        # Coordinates round by 2^-24 of their size; nearer to the rim the profile is 1e-4 at most.
        rounding = 2.0**-22 * max(np.abs(a[i]).max(), np.abs(e[i]).max(), BLOCK)
        inside = np.flatnonzero(distance < half_width[i] - rounding) // LANES
        reached += len(inside)
        assert inside.size == 0 or (low <= inside[0] and inside[-1] <= high), i
    assert reached > 100_000


@pytest.mark.slow
def test_fours_hold_every_texel_of_their_rows_that_a_slim_line_reaches(device):
    a, e, half_width, _ = columns_of_segments(8, 30000)
    half_width = np.minimum(half_width, 3)
    row = np.random.default_rng(9).integers(0, BLOCK - 3, len(a)).astype(np.int32)
    inputs = {"a": a, "e": e, "h": half_width, "y": row}
    sums = "(sums_t){0, 0, 0, 0}"
    box = f"box_of_line({sums}, a, e, sqrt(dot(e, e)), h)"
    slim = evaluate(device, "line", f"{box}.way == IN_FOURS", inputs, np.int32, 1, options(1))
    columns = f"convert_float4(columns_of_fours({box}, y))"
    first = evaluate(device, "line", columns, inputs, np.float32, 4, options(1))
    reached = 0
    for i in np.flatnonzero(slim):
        y, x = np.mgrid[row[i] : row[i] + 4, :BLOCK] + 0.5
        texels = np.stack([x.ravel(), y.ravel()], axis=1)
        start = a[i].astype(np.float64)
        distance = segment_distance(texels, start, start + e[i]).reshape(4, BLOCK)
        rounding = 2.0**-22 * max(np.abs(a[i]).max(), np.abs(e[i]).max(), BLOCK)
        y, x = np.nonzero(distance < half_width[i] - rounding)
        reached += len(x)
        assert ((first[i, y] <= x) & (x < first[i, y] + 4)).all(), i
    assert reached > 4_000
    assert 0.05 < slim.mean() < 0.9


def test_rows_of_the_work_items_share_a_block_without_gap_or_overlap(device):
    items = 7
    low = np.repeat(np.arange(30, dtype=np.int32), items)
    first = np.tile(np.arange(items, dtype=np.int32), 30)
    call = "first_owned((sums_t){0, 0, first}, low)"
    inputs = {"low": low, "first": first}
    row = evaluate(device, "draw", call, inputs, np.int32, options=options(items))
    np.testing.assert_array_equal(row % items, first)
    assert ((row >= low) & (row < low + items)).all()


@pytest.mark.parametrize("shape", SHAPES)
def test_mellow_max_of_one_height_is_that_height(device, shape):
    x = np.linspace(0, 4, 16 * 64)
    sums = np.expm1(shape.sharpness * x).astype(np.float32).reshape(-1, LANES)
    none = np.zeros_like(sums)
    call = f"mellow_max(q, v, (shape_t){{0.0f, 0.0f, {shape.sharpness}f, {shape.slots}.0f}})"
    alone = mellow_max(x[:, None], shape.sharpness, shape.slots)
    for q, v, sign in ((sums, none, 1), (none, sums, -1)):
        found = evaluate(device, "draw", call, {"q": q, "v": v}, width=LANES, options=options(1))
        np.testing.assert_allclose(found.ravel(), sign * alone, atol=1e-5, rtol=0)


@pytest.mark.parametrize("least", [0.7, 4.0])
def test_a_pore_is_widened_as_in_double(device, least):
    """Round ones, ones along the axes and slim ones across them, narrower than the least or not."""
    along, across, turn = np.meshgrid(
        np.geomspace(0.05, 50.0, 7), [1.0, 0.999, 0.5, 0.02], np.radians([0, 45, 70, 90, 160])
    )
    first, second = along.ravel() ** -2.0, (along * across).ravel() ** -2.0
    c, s = np.cos(turn.ravel()), np.sin(turn.ravel())
    metrics = np.stack(
        [first * c * c + second * s * s, (first - second) * c * s, first * s * s + second * c * c],
        1,
    )
    given = roots(np.column_stack([metrics, np.full(len(metrics), 0.8)]))
    inputs = {"root": given, "least": np.full(len(given), least, np.float32)}
    found = evaluate(
        device, "least_pore", "at_least_pore(root.xyz, root.w, least)", inputs, width=4
    ).astype(np.float64)
    xx, xy, yy = given[:, :3].astype(np.float64).T
    given_metrics = np.stack([xx * xx, xx * xy, xy * xy + yy * yy], 1)
    wanted, strength = at_least(Pores(None, given_metrics, given[:, 3].astype(float), least))
    x, y, z, w = found.T
    made = np.stack([x * x, x * y, y * y + z * z], 1)
    sizes = np.trace(wanted[:, [0, 1, 1, 2]].reshape(-1, 2, 2), axis1=1, axis2=2)
    np.testing.assert_array_less(np.abs(made - wanted).max(axis=1) / sizes, 1e-6)
    np.testing.assert_allclose(w, strength, rtol=4e-6)
