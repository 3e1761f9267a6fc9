"""Where triangles stand between the samples (Alg. 3, lines 6 to 10), against the reference."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import rhytid_kernels
from kernels.one_line import run, vector
from reference import bins as reference
from reference.inputs import Bins
from reference.response import scales
from rhytid.pipeline.blend import TILT_NODE
from rhytid.pipeline.reach import response_defines

COUNT = 500
LANES = 16  # triangles of a work-item
KERNEL = """
__kernel void standings(__global const float4 *axes, __global const float2 *logs,
                        __global const float2 *directions, int count, float r_max, float4 exponents,
                        __global float4 *found)
{
    int first = get_global_id(0) * LANES, last = count - 1;
    triangles_t p = triangles_from(first, last, axes, logs, 0);
    for (int n = 0; n < LAYERS; n++) {
        standing_t s = standing(n, p, first, last, 0, directions, r_max, exponents);
        for (int i = 0; i < min(LANES, count - first); i++)
            found[(first + i) * LAYERS + n] = (float4)(s.place[i], s.depth[i], s.rise[i], 0.0f);
    }
}
"""
slow = pytest.mark.slow


def frame(seed):
    """axes (n, 2, 2) and clamped log stretch (n, 2), float32; the last row is the neutral."""
    rng = np.random.default_rng(seed)
    first = rng.uniform(0, 2 * np.pi, COUNT)
    angle = np.stack([first, first + rng.uniform(0.3, np.pi - 0.3, COUNT)], axis=1)
    axes = np.stack([np.cos(angle), np.sin(angle)], axis=-1).astype(np.float32)
    logs = rng.uniform(-0.5, 0.5, (COUNT, 2)).astype(np.float32)
    axes[-1], logs[-1] = np.eye(2), 0.0
    return axes, logs


def weights(device, axes, logs, bins, exponents=(0.0, 0.0)):
    """Positions (n, L), depth scales (n, L), their rise a code, and zeros."""
    layers = bins.count + 1
    oriented = bins.count if bins.count > 1 else 0
    turns = (0.0, -reference.TILT_NODE, reference.TILT_NODE) if bins.tilt else (0.0,)
    turned = [reference.directions(bins.count, turn) for turn in turns]
    directions = np.concatenate(turned).astype(np.float32)
    most = 2 ** (bins.bits - 1) - 1
    options = [f"-DLAYERS={layers}", f"-DSAMPLES={bins.samples}", f"-DORIENTED={oriented}"]
    options += [f"-DPORE_SAMPLES={bins.pore_samples or bins.samples}"]
    options += [f"-DTILT={int(bins.tilt)}", f"-DTILT_NODE={TILT_NODE}f"]
    options += [f"-DCODE_LIMIT={most}"]
    options += [f"-D{name}={value}" for name, value in response_defines(False).items()]
    arguments = [
        axes,
        logs,
        directions,
        np.int32(COUNT),
        np.float32(bins.r_max),
        vector(*exponents, 4.0, 4.0),
    ]
    text, out = rhytid_kernels.source("weights") + KERNEL, np.zeros((COUNT, layers, 4), np.float32)
    found = run(device, text, "standings", (-(-COUNT // LANES),), arguments, out, options)
    return np.moveaxis(found, -1, 0)


def positions(device, axes, logs, bins):
    return weights(device, axes, logs, bins)[0]


# Each is a program of its own.
@pytest.mark.parametrize(
    ("count", "samples"),
    [
        *[(1, 3), (2, 5), (4, 7), (16, 3), (16, 7)],
        *(pytest.param(*sizes, marks=slow) for sizes in [(1, 5), (1, 7), (2, 3), (2, 7)]),
        *(pytest.param(*sizes, marks=slow) for sizes in [(4, 3), (4, 5), (16, 5)]),
    ],
)
def test_positions_are_those_of_the_reference(device, count, samples):
    bins = Bins(count=count, samples=samples, r_max=0.2)
    axes, logs = frame(1)
    r = reference.layer_stretch(logs, axes, count)
    below, share = reference.blend_weights(r, bins)
    found = positions(device, axes, logs, bins)
    np.testing.assert_allclose(found, (below + share).T, atol=2e-5 / 0.2 * samples, rtol=0)
    assert 0 <= found.min() <= found.max() <= samples - 1


def test_pores_stand_between_samples_of_their_own(device):
    bins = Bins(samples=3, pore_samples=7)
    axes, logs = frame(9)
    found = positions(device, axes, logs, bins)
    for samples, layers in ((3, slice(4)), (7, slice(4, 5))):
        wanted = positions(device, axes, logs, Bins(samples=samples))
        np.testing.assert_array_equal(found[:, layers], wanted[:, layers])


@pytest.mark.parametrize("samples", [3, 5, 7])
def test_no_stretch_is_exactly_the_middle_sample(device, samples):
    found = positions(device, *frame(2), Bins(count=4, samples=samples))
    np.testing.assert_array_equal(found[-1], (samples - 1) / 2)


def test_stretch_beyond_r_max_is_exactly_the_last_sample(device):
    axes, logs = frame(3)
    axes[:], logs[:250], logs[250:] = np.eye(2), 0.5, -0.5
    found = positions(device, axes, logs, Bins(count=4, samples=5, r_max=0.2))
    np.testing.assert_array_equal(found[:250], 4.0)
    np.testing.assert_array_equal(found[250:], 0.0)


def test_signs_of_axes_are_free(device):
    axes, logs = frame(4)
    plain = positions(device, axes, logs, Bins())
    for signs in ((-1, 1), (1, -1), (-1, -1)):
        turned = axes * np.array(signs, np.float32)[:, None]
        np.testing.assert_array_equal(positions(device, turned, logs, Bins()), plain)


@pytest.mark.parametrize("count", [1, 4, 16])
@pytest.mark.parametrize("exponents", [(4.0, 10.0), (1.0, 64.0)])
def test_depth_scales_are_those_of_the_stretch_before_its_clamp(device, count, exponents):
    bins = Bins(count=count, r_max=0.05)
    axes, logs = frame(5)
    r = reference.layer_stretch(logs, axes, count)
    assert (np.abs(r) > bins.r_max).mean() > 0.5
    wanted = [scales(layer, 0.0, exponents[i == count])[1] for i, layer in enumerate(r)]
    place, found, rise, nothing = weights(device, axes, logs, bins, exponents)
    # sigma_d = e^(-ar): an error of 1e-5 in r grows by a.
    np.testing.assert_allclose(found, np.transpose(wanted), rtol=1e-5 * max(exponents))
    assert (found.min(), found.max()) == pytest.approx((0.25, 4.0), rel=0.3)
    np.testing.assert_array_equal(found[-1], 1.0)
    np.testing.assert_array_equal(place, positions(device, axes, logs, bins))
    assert not rise.any()
    assert not nothing.any()


def test_maps_that_hold_their_depth_are_scaled_by_exactly_one(device):
    np.testing.assert_array_equal(weights(device, *frame(6), Bins())[1], 1.0)


@pytest.mark.parametrize(
    ("count", "bits"),
    [
        *[(1, 8), (2, 16), (4, 8), (16, 16)],
        *(pytest.param(*sizes, marks=slow) for sizes in [(1, 16), (2, 8), (4, 16), (16, 8)]),
    ],
)
@pytest.mark.parametrize("exponents", [(4.0, 10.0), (64.0, 1.0)])
def test_depth_scales_with_tilts_are_the_lines_of_the_reference(device, count, bits, exponents):
    bins = Bins(count=count, bits=bits, tilt=True, depth_factored=True)
    axes, logs = frame(7)
    plain = weights(device, axes, logs, replace(bins, tilt=False), exponents)
    place, middle, rise, nothing = weights(device, axes, logs, bins, exponents)
    np.testing.assert_array_equal(place, plain[0])
    np.testing.assert_array_equal(nothing, 0.0)
    sides = reference.sides_of(logs, axes, count)
    most = 2 ** (bits - 1) - 1
    for layer in range(count + 1):
        if layer == count or count == 1:
            np.testing.assert_array_equal(middle[:, layer], plain[1][:, layer])
            np.testing.assert_array_equal(rise[:, layer], 0.0)
            continue
        low, high = (scales(side[layer], 0.0, exponents[0])[1] for side in sides)
        for tilt in (-1.0, -0.4, 0.0, 1.0):
            found = middle[:, layer] * (1 + rise[:, layer] * most * tilt)
            wanted = reference.tilted_depth(tilt, low, high)
            np.testing.assert_allclose(found, wanted, atol=1e-4 * max(exponents))
            assert -1e-6 <= found.min() <= found.max() <= 4.0 * (1 + 1e-6)


def test_a_tilt_reaches_the_depth_of_its_own_angle(device):
    """At TILT_NODE half bins off, a wrinkle is as deep as Alg. 1 has it at its own angle."""
    bins = Bins(count=4, tilt=True, depth_factored=True)
    axes, logs = frame(8)
    logs *= 0.3
    _, middle, rise, _ = weights(device, axes, logs, bins, (4.0, 10.0))
    for turn in (-TILT_NODE, TILT_NODE):
        r = reference.layer_stretch(logs, axes, 4, turn=turn)[:4]
        found = (middle * (1 + rise * 127 * turn))[:, :4]
        np.testing.assert_allclose(found, scales(r, 0.0, 4.0)[1].T, rtol=1e-4)
