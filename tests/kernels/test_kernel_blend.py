"""The blend of codes (Alg. 3, lines 11 to 14), of one triangle a vector and of many, in double."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

import rhytid_kernels
from kernels.one_line import run
from pairs import pairs
from reference import bins as reference
from reference.inputs import Bins, Shape
from rhytid.domain.asset_settings import AssetSettings
from rhytid.pipeline.blend import MERGES as MERGE_NAMES
from rhytid.pipeline.blend import unit_of
from rhytid.pipeline.reach import response_defines
from rhytid.pipeline.vectors import VectorTriangles

ONE_TILE = """
__kernel void one_tile(__global const int *firsts, __global const int2 *members,
                       __global const CODE *codes, __global const float *coefficients, float unit,
                       __global float *out)
{
    blend_vector(firsts, members, codes, 0, 0, coefficients, 0, unit, 16, 0.0f, 1.0f, out);
}
"""
GRAINY_TILE = """
__kernel void grainy_tile(__global const int *firsts, __global const int2 *members,
                          __global const CODE *codes, __global const float *coefficients,
                          float unit, __global const char *grain, __global const float *gains,
                          __global float *out)
{
    blend_vector(firsts, members, codes, 0, grain, coefficients, gains, unit, 16, 0.25f, 1.0f, out);
}
"""
COEFFICIENTS = """
__kernel void of_weights(__global const float4 *weights, __global const float *steps, float unit,
                         __global float4 *found)
{
    int i = get_global_id(0);
    standing_t at = {weights[i].x, weights[i].y, weights[i].z};
    coefficients_t c = coefficients_at(i % LAYERS, at, steps, unit);
    found[i] = (float4)(c.first.s0, c.second.s0, c.place.s0, c.rise.s0);
}
"""
WIDTH = 16
TEXELS = 64 * WIDTH
C_TYPES = {8: "char", 16: "short"}
MERGES = ("min", "soft", "signed", "mellow")


class Maps(NamedTuple):
    """codes (L, parts, M, P), tilts (L - 1, P) or none, weights (T, L, 4), steps (L, M);
    heights in units of `depth`."""

    codes: NDArray[np.integer]
    tilts: NDArray[np.integer] | None
    weights: NDArray[np.float32]
    steps: NDArray[np.float32]
    merge: str
    depth: float = 1.0
    sharpness: float = 20.0


def maps(layers, samples, bits, triangles, merge="min", tilt=False, seed=1):
    """Random maps; some of the triangles stand at a sample, all have a depth scale of their own."""
    rng = np.random.default_rng(seed)
    most, parts = 2 ** (bits - 1) - 1, 2 if merge == "mellow" else 1
    codes = rng.integers(-most, most + 1, (layers, parts, samples, TEXELS))
    if merge == "mellow":  # valleys down, bulges up
        codes = np.abs(codes) * np.array([-1, 1])[:, None, None]
    codes[..., ::7] //= 8  # shallow places, too
    place = rng.uniform(0, samples - 1, (triangles, layers))
    place[::3] = np.rint(place[::3])
    weights = np.stack([place, rng.uniform(0.25, 1 if tilt else 2, (triangles, layers))], axis=-1)
    steps = rng.uniform(0.5, 2.0, (layers, samples)) / most
    kind, tilts, rise = f"i{bits // 8}", None, np.zeros((triangles, layers))
    if tilt:
        tilts = rng.integers(-most, most + 1, (layers - 1, TEXELS)).astype(kind)
        rise = rng.uniform(-1, 1, (triangles, layers)) / most
    weights = np.concatenate([weights, np.stack([rise, 0 * rise], axis=-1)], axis=-1)
    return Maps(
        codes.astype(kind), tilts, weights.astype(np.float32), steps.astype(np.float32), merge
    )


def options(bits, merge, layers, samples, tilt=False):
    values = {
        "CODE": C_TYPES[bits], "CODE_BITS": bits, "MERGE": MERGE_NAMES[merge],
        "PARTS": 2 if merge == "mellow" else 1, "LAYERS": layers,
        "SAMPLES": samples, "PORE_SAMPLES": samples,
        "MAPS": layers * samples * (2 if merge == "mellow" else 1) + (layers - 1 if tilt else 0),
        "TILT": int(tilt),
    }  # fmt: skip
    return [f"-D{name}={value}" for name, value in values.items()]


def unit(maps):
    shape = {"depth": maps.depth, "shape": {"sharpness": maps.sharpness}}
    return np.float32(unit_of(AssetSettings.parse({**shape, "bins": {"merge": maps.merge}})))


def blended(device, triangle, maps, *more, tile=("one_tile", ONE_TILE), grain=()):
    layers, _, samples, _ = maps.codes.shape
    tilt = maps.tilts is not None
    given = options(8 * maps.codes.itemsize, maps.merge, layers, samples, tilt)
    by_layer = [layer.reshape(-1, TEXELS) for layer in maps.codes]
    tilts = [*maps.tilts[:, None], by_layer[0][:0]] if tilt else [by_layer[0][:0]] * layers
    codes = np.concatenate([m for pair in zip(by_layer, tilts, strict=True) for m in pair])
    arguments = [*placed(device, triangle, codes), coefficients(device, maps), unit(maps)]
    text, out = rhytid_kernels.source("blend") + tile[1], np.zeros(TEXELS, np.float32)
    size = (TEXELS // WIDTH,)
    return run(device, text, tile[0], size, [*arguments, *grain], out, [*given, *more])


def coefficients(device, maps):
    """(T, L, 4), of weights.cl."""
    triangles, layers, _ = maps.weights.shape
    given = [
        f"-DLAYERS={layers}",
        f"-DSAMPLES={maps.codes.shape[2]}",
        f"-DPORE_SAMPLES={maps.codes.shape[2]}",
        "-DORIENTED=0",
        "-DTILT=0",
    ]
    given += [f"-D{name}={value}" for name, value in response_defines(False).items()]
    text, found = rhytid_kernels.source("weights") + COEFFICIENTS, np.zeros_like(maps.weights)
    arguments = [maps.weights, maps.steps, unit(maps)]
    return run(device, text, "of_weights", (triangles * layers,), arguments, found, given)


def placed(device, triangle, codes):
    """Triangles of the vectors, and codes (maps, P), in any shape, as they lie in
    memory."""
    found = VectorTriangles.of(device, device.upload(triangle.astype(np.int32)), TEXELS)
    firsts = device.read(found.firsts, (TEXELS // WIDTH + 1,), np.int32)
    members = device.read(found.members, (firsts[-1], 2), np.int32)
    return firsts, members, np.moveaxis(codes.reshape(-1, TEXELS // WIDTH, WIDTH), 0, 1)


def wanted(triangle, maps):
    """The same in double, (P,)."""
    heights = maps.codes * maps.steps.astype(np.float64)[:, None, :, None]
    weights = maps.weights.astype(np.float64)[triangle]
    place, scale = weights[..., 0].T, weights[..., 1].T
    below = np.minimum(place.astype(int), maps.codes.shape[2] - 2)
    layer, texel = np.ogrid[: len(heights), :TEXELS]
    low, high = heights[layer, :, below, texel], heights[layer, :, below + 1, texel]
    share = (place - below)[..., None]
    if maps.tilts is not None:
        scale = scale.copy()
        scale[:-1] *= 1 + maps.tilts * weights[:, :-1, 2].T
    layers = scale[..., None] * ((1 - share) * low + share * high)  # (L, P, parts)
    if maps.merge == "mellow":
        layers = layers * np.array([-1, 1])
    shape, bins = Shape(sharpness=maps.sharpness), Bins(merge=maps.merge)
    return reference.merge(np.moveaxis(layers, 2, 1), shape, bins, maps.depth)


def check(device, triangle, maps):
    found = blended(device, triangle.astype(np.int32), maps)
    largest = float(np.abs(maps.codes).max() * maps.steps.max() * maps.weights[..., 1].max())
    largest *= 1 if maps.tilts is None else 2
    assert np.abs(found - wanted(triangle, maps)).max() <= 1e-6 * largest


QUICK = pairs([1, 16], [3, 7], [8, 16], MERGES, [False, True])
ALL = pairs([1, 4, 16], [3, 5, 7], [8, 16], MERGES, [False, True])


# Each is a program of its own.
@pytest.mark.parametrize(
    ("bins", "samples", "bits", "merge", "tilt"),
    [*QUICK, *(pytest.param(*row, marks=pytest.mark.slow) for row in ALL if row not in QUICK)],
)
def test_vectors_in_one_triangle_and_in_many_are_those_of_double(
    device, bins, samples, bits, merge, tilt
):
    made = maps(bins + 1, samples, bits, 90, merge, tilt)
    rng = np.random.default_rng(2)
    one_each = np.repeat(rng.integers(0, 90, TEXELS // WIDTH), WIDTH)
    check(device, one_each, made)
    check(device, rng.integers(0, 90, TEXELS), made)
    mixed = one_each.copy()
    mixed[5::48] = 89  # one stranger in some of the vectors
    check(device, mixed, made)


@pytest.mark.parametrize("members", [1, 2, 3, 4, 5])
def test_each_texel_of_a_vector_has_the_height_of_its_own_triangle(device, members):
    made = maps(5, 3, 8, 90, "soft", tilt=True)
    made.weights[1::2, :, 0] = made.weights[::2, :, 0] % 1  # some between the same samples
    triangle = np.arange(TEXELS) // WIDTH + 17 * (np.arange(TEXELS) % members)
    check(device, triangle % 90, made)


@pytest.mark.parametrize("members", [1, 2, 3, 4])
def test_each_texel_of_a_vector_has_the_grain_of_its_own_triangle(device, members):
    made, rng = maps(2, 3, 8, 90, "soft"), np.random.default_rng(4)
    triangle = (np.arange(TEXELS) // WIDTH + 17 * (np.arange(TEXELS) % members)) % 90
    codes = rng.integers(-127, 128, TEXELS).astype(np.int8)
    gains = rng.uniform(0.25, 4, 90).astype(np.float32)
    plain = blended(device, triangle, made).astype(np.float64)
    options = [
        "-DGRAINY=1",
        *(f"-D{name}={value}" for name, value in response_defines(False).items()),
    ]
    tile = ("grainy_tile", GRAINY_TILE)
    found = blended(device, triangle, made, *options, tile=tile, grain=(codes, gains))
    grain = 0.25 * codes * gains[triangle] * np.clip(1 + plain, 0.25, 1)  # less in furrows
    np.testing.assert_allclose(found, plain + grain, atol=1e-4)


@pytest.mark.parametrize("bits", [8, 16])
def test_codes_asked_for_ahead_change_no_bit(device, bits):
    made = maps(5, 3, bits, 90, "soft", tilt=True)
    triangle = np.random.default_rng(3).integers(0, 90, TEXELS).astype(np.int32)
    found = [blended(device, triangle, made, *more) for more in ((), ("-DAHEAD=1",))]
    np.testing.assert_array_equal(*found)


@pytest.mark.slow
@pytest.mark.parametrize("merge", ["soft", "signed", "mellow"])
@pytest.mark.parametrize("depth", [1e-6, 0.03, 1e6])
@pytest.mark.parametrize("sharpness", [0.1, 3.0, 20.0])
def test_the_smooth_merges_at_any_depth_and_sharpness(device, depth, sharpness, merge):
    made = maps(5, 3, 8, 90, merge)._replace(depth=depth, sharpness=sharpness)
    made = made._replace(steps=made.steps * np.float32(depth))
    triangle = np.random.default_rng(3).integers(0, 90, TEXELS).astype(np.int32)
    error = np.abs(blended(device, triangle, made) - wanted(triangle, made)).max() / depth
    # A float32 beside 1 rounds by 2^-24; the logarithm of it is divided by the sharpness.
    assert error <= 1e-6 * 4 + 16 * 2.0**-24 / sharpness


@pytest.mark.slow
@pytest.mark.parametrize("layers", [2, 17])
def test_the_mellow_merge_of_the_largest_heights_is_finite(device, layers):
    """4.8 depths at the largest sharpness, in every layer at once: e^96 is beyond a float32."""
    made = maps(layers, 3, 8, 1, "mellow")
    made.codes[:] = np.array([-127, 127])[:, None, None]
    made.steps[:] = 1.2 / 127
    made.weights[:] = 1.0, 4.0, 0.0, 0.0
    triangle = np.zeros(TEXELS, np.int32)
    deep = made._replace(codes=made.codes * np.array([1, 0], np.int8)[:, None, None])
    high = made._replace(codes=made.codes * np.array([0, 1], np.int8)[:, None, None])
    for one, sign in ((deep, -1), (high, 1)):
        found = blended(device, triangle, one)
        # What is past 2^121.9 is cut there: 4.22 depths, and what layers of that add up to.
        largest = 121.9 * np.log(2) / 20 + np.log(layers) / 20
        np.testing.assert_allclose(found * sign, largest, rtol=1e-6)
    np.testing.assert_array_equal(blended(device, triangle, made), 0.0)


@pytest.mark.parametrize(
    "samples", [3, *(pytest.param(count, marks=pytest.mark.slow) for count in (5, 7))]
)
def test_ends_and_samples_give_back_their_maps(device, samples):
    made = maps(1, samples, 8, samples)
    made.weights[:, 0, 0], made.weights[:, 0, 1] = np.arange(samples), 1.0
    for sample in range(samples):
        triangle = np.full(TEXELS, sample, np.int32)
        exact = made.codes[0, 0, sample].astype(np.float32) * made.steps[0, sample]
        np.testing.assert_array_equal(blended(device, triangle, made), exact)
        triangle[::WIDTH] = (sample + 1) % samples
        found = blended(device, triangle, made)
        np.testing.assert_array_equal(found[1::WIDTH], exact[1::WIDTH])


@pytest.mark.parametrize("merge", MERGES)
def test_nothing_behind_the_last_sample_is_read(device, merge):
    made = maps(1, 3, 8, 1, merge)
    made.weights[:] = 2.0, 1.0, 0.0, 0.0
    triangle = np.zeros(TEXELS, np.int32)
    plain = blended(device, triangle, made)
    behind = made._replace(steps=np.append(made.steps, np.float32("nan"))[None])
    found = blended(device, triangle, behind)
    np.testing.assert_array_equal(found, plain)
    assert np.isfinite(found).all()
