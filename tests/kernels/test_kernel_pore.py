"""Lists of pores in one block, drawn sixteen at once on processors, against each alone."""

from __future__ import annotations

import numpy as np
import pytest

from kernels.one_line import run
from kernels.test_kernel_draw import BLOCK, SHAPES, options, pores, roots

LIST = """#include "line.clh"
__kernel void block(int total, __global const int *members, __global const float2 *centres,
                    __global const float4 *roots, __global const float2 *scales,
                    __global const float *s, int alone, __global float *out)
{
    __local float memory[2 * SUMS];
    shape_t shape = shape_of(vload4(0, s));
    place_t place = place_of_group(1, 0, 0);
    sums_t sums = sums_at(place, memory);
    const float2 corner = {3.5f, -2.25f};
    for (int k = 0; alone && k < total; k++) {
        int i = members[k];
        float4 pore = scaled_pore(roots[i], scales[i], 0.7f);
        draw_pore(sums, centres[i] - corner, pore.xyz, pore.w, shape);
    }
    if (!alone)
        DRAW_PORES(sums, shape, members, 0, total, roots, centres, scales[i], corner, 0.7f);
    write_rows(sums, place, shape, 1.0f, 0, out);
}"""


def drawn(device, count, shape, alone, items, rows=BLOCK):
    """(BLOCK, BLOCK) of pores of 0.3 to 15 texels, of which some are narrower than 0.7, and some as
    wide as the block."""
    centres, metrics = pores(11, count)
    rng = np.random.default_rng(12)
    scales = rng.uniform(0.25, 2.0, (count, 2)).astype(np.float32)
    scales[::7, 0] = 6.0
    members = rng.permutation(count).astype(np.int32)
    values = [shape.wrinkle_bulge, shape.pore_bulge, shape.sharpness, shape.slots]
    given = [np.int32(count), members, centres, roots(metrics), scales]
    given += [np.array(values, np.float32), np.int32(alone)]
    out = np.zeros((BLOCK, BLOCK), np.float32)
    size, group = (items, BLOCK // rows), (items, 1)
    return run(device, LIST, "block", size, given, out, options(items, rows), group)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("count", [1, 16, 70])
def test_pores_of_a_list_have_the_bits_of_each_alone(device, count, shape):
    alone = drawn(device, count, shape, True, 1)
    np.testing.assert_array_equal(drawn(device, count, shape, False, 1), alone)
    assert np.ptp(alone) > 0.01


@pytest.mark.parametrize(("items", "rows"), [(1, 32), (8, 64)])
def test_pores_of_a_list_have_the_same_bits_however_rows_are_shared_out(device, items, rows):
    found = drawn(device, 70, SHAPES[0], False, items, rows)
    np.testing.assert_array_equal(found, drawn(device, 70, SHAPES[0], False, 1))
