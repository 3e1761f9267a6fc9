"""Codes of heights, and kernels of whole maps: halve, copy."""

from __future__ import annotations

import numpy as np
import pytest

import rhytid_kernels
from kernels.one_line import run, vector
from rhytid.pipeline.vectors import VECTOR

C_TYPES = {8: "char", 16: "short"}
QUANTISE = """#include "codes.clh"
#include "vectors.clh"
__kernel void quantise(__global const float *heights, float per_step, int2 map,
                       __global CODE *codes)
{
    int i = get_global_id(0) * WIDTH;
    vstore16(CODES16(vload16(0, heights + i), per_step), 0, codes + code_place(i, map));
}"""


def quantised(device, heights, step, bits, maps=1, index=0):
    """Codes of one of some maps, (P,) or all that is in memory where there are more."""
    limit, vectors = 2 ** (bits - 1) - 1, -(-len(heights) // VECTOR)
    out = np.full((vectors, maps, VECTOR), 77, f"i{bits // 8}")
    options = [f"-DCODE={C_TYPES[bits]}", f"-DCODE_LIMIT={limit}"]
    padded = np.resize(heights, vectors * VECTOR)
    arguments = [padded, np.float32(1.0 / step), vector(index, maps, kind=np.int32)]
    found = run(device, QUANTISE, "quantise", (vectors,), arguments, out, options)
    return found.ravel()[: len(heights)] if maps == 1 else found


@pytest.mark.parametrize("bits", [8, 16])
def test_codes_are_within_half_a_step(device, bits):
    limit, step = 2 ** (bits - 1) - 1, np.float32(0.0137)
    heights = (np.linspace(-limit, limit, 9973) * float(step)).astype(np.float32)
    codes = quantised(device, heights, step, bits)
    error = np.abs(codes * float(step) - heights)
    assert (error <= float(step) * (0.5 + limit * 2.0**-22)).all()
    assert (codes.min(), codes.max()) == (-limit, limit)


@pytest.mark.parametrize("bits", [8, 16])
def test_codes_are_symmetric_saturate_and_keep_nothing_as_nothing(device, bits):
    limit = 2 ** (bits - 1) - 1
    heights = np.random.default_rng(1).normal(0, 50, 4001).astype(np.float32)
    codes = quantised(device, heights, 0.5, bits)
    np.testing.assert_array_equal(quantised(device, -heights, 0.5, bits), -codes)
    ends = np.array([0.0, -0.0, 1e30, -1e30, np.inf, -np.inf], np.float32)
    found = quantised(device, ends, 1e-6, bits)
    np.testing.assert_array_equal(found, [0, 0, limit, -limit, limit, -limit])


def test_codes_of_a_map_lie_beside_those_of_the_others(device):
    heights = np.arange(2 * VECTOR + 3, dtype=np.float32)
    wanted = np.full((3, 5, VECTOR), 77)
    wanted[:, 2] = np.resize(heights, 3 * VECTOR).reshape(3, VECTOR)
    np.testing.assert_array_equal(quantised(device, heights, 1.0, 8, maps=5, index=2), wanted)


def halved(fine):
    a, b, c, d = (fine[y::2, x::2] for y in (0, 1) for x in (0, 1))
    return np.float32(0.25) * ((a + b) + (c + d))


@pytest.mark.parametrize("side", [2, 8, 64])
def test_halve_is_the_mean_of_four_added_in_a_fixed_order(device, side):
    fine = np.random.default_rng(2).normal(size=(side, side)).astype(np.float32)
    half = (side // 2, side // 2)
    out = np.zeros(half, np.float32)
    arguments = [fine, np.int32(half[1]), np.int32(0)]
    found = run(device, rhytid_kernels.source("level"), "halve", half, arguments, out)
    np.testing.assert_array_equal(found, halved(fine))


def test_halve_writes_a_part_of_a_square(device):
    fine = np.random.default_rng(2).normal(size=(8, 8)).astype(np.float32)
    wanted = np.full((16, 16), 7.0, np.float32)
    arguments = [fine, np.int32(16), np.int32(3 * 16 + 5)]
    found = run(device, rhytid_kernels.source("level"), "halve", (4, 4), arguments, wanted)
    wanted[3:7, 5:9] = halved(fine)
    np.testing.assert_array_equal(found, wanted)


def test_copy_copies(device):
    source = np.random.default_rng(3).normal(size=16 * 33).astype(np.float32)
    out = np.zeros_like(source)
    found = run(device, rhytid_kernels.source("copy"), "copy_map", (33,), [source], out)
    np.testing.assert_array_equal(found, source)
