"""The blend of codes (Alg. 3, lines 11 to 14), of one triangle a vector and of many, in double."""

from __future__ import annotations

import numpy as np
import pytest

import rhytid_kernels
from kernels.one_line import run

WIDTH = 16
TEXELS = 64 * WIDTH
C_TYPES = {8: "char", 16: "short"}


def scene(layers, samples, bits, triangles, seed=1):
    """codes (L, M, P), positions (T, L) and steps (L, M) with positions at samples, too."""
    rng = np.random.default_rng(seed)
    most = 2 ** (bits - 1) - 1
    codes = rng.integers(-most, most + 1, (layers, samples, TEXELS)).astype(f"i{bits // 8}")
    positions = rng.uniform(0, samples - 1, (triangles, layers)).astype(np.float32)
    positions[::3] = np.rint(positions[::3])
    steps = (rng.uniform(0.5, 2.0, (layers, samples)) / most).astype(np.float32)
    return codes, positions, steps


def blended(device, triangle, codes, positions, steps):
    layers, samples, _ = codes.shape
    bits = 8 * codes.itemsize
    options = [f"-DCODE={C_TYPES[bits]}", f"-DCODE_BITS={bits}"]
    options += [f"-DLAYERS={layers}", f"-DSAMPLES={samples}"]
    arguments = [triangle, codes, positions, steps, np.int32(TEXELS)]
    text, out = rhytid_kernels.source("blend"), np.zeros(TEXELS, np.float32)
    return run(device, text, "blend", (TEXELS // WIDTH,), arguments, out, options)


def wanted(triangle, codes, positions, steps):
    """The same in double, (P,)."""
    heights = codes * steps.astype(np.float64)[..., None]
    place = positions.astype(np.float64)[triangle].T
    below = np.minimum(place.astype(int), codes.shape[1] - 2)
    layer, texel = np.ogrid[: len(codes), :TEXELS]
    low, high = heights[layer, below, texel], heights[layer, below + 1, texel]
    return ((1 - (place - below)) * low + (place - below) * high).min(axis=0)


def check(device, triangle, scene):
    codes, _, steps = scene
    found = blended(device, triangle.astype(np.int32), *scene)
    largest = float(np.abs(codes).max() * steps.max())
    assert np.abs(found - wanted(triangle, *scene)).max() <= 1e-6 * largest


@pytest.mark.parametrize("samples", [3, 5, 7])
@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("bins", [1, 4, 16])
def test_vectors_in_one_triangle_and_in_many_are_those_of_double(device, bins, samples, bits):
    parts = scene(bins + 1, samples, bits, triangles=90)
    rng = np.random.default_rng(2)
    one_each = np.repeat(rng.integers(0, 90, TEXELS // WIDTH), WIDTH)
    check(device, one_each, parts)
    check(device, rng.integers(0, 90, TEXELS), parts)
    mixed = one_each.copy()
    mixed[5::48] = 89  # one stranger in some of the vectors
    check(device, mixed, parts)


@pytest.mark.parametrize("samples", [3, 5, 7])
def test_ends_and_samples_give_back_their_maps(device, samples):
    codes, positions, steps = scene(1, samples, 8, triangles=samples)
    positions[:, 0] = np.arange(samples)
    for sample in range(samples):
        triangle = np.full(TEXELS, sample, np.int32)
        exact = codes[0, sample].astype(np.float32) * steps[0, sample]
        found = blended(device, triangle, codes, positions, steps)
        np.testing.assert_array_equal(found, exact)
        triangle[::WIDTH] = (sample + 1) % samples
        found = blended(device, triangle, codes, positions, steps)
        np.testing.assert_array_equal(found[1::WIDTH], exact[1::WIDTH])


def test_nothing_behind_the_last_sample_is_read(device):
    codes, positions, steps = scene(1, 3, 8, triangles=1)
    positions[:] = 2.0
    behind = np.append(steps, np.float32("nan"))
    more = np.concatenate([codes, codes[:, :1]], axis=1)
    options = ["-DCODE=char", "-DCODE_BITS=8", "-DLAYERS=1", "-DSAMPLES=3"]
    arguments = [np.zeros(TEXELS, np.int32), more, positions, behind, np.int32(TEXELS)]
    text, out = rhytid_kernels.source("blend"), np.zeros(TEXELS, np.float32)
    found = run(device, text, "blend", (TEXELS // WIDTH,), arguments, out, options)
    np.testing.assert_array_equal(found, codes[0, 2].astype(np.float32) * steps[0, 2])
