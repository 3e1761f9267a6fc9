"""The kernel of a triangle and one pass of convolution, helper by helper."""

from __future__ import annotations

import numpy as np
import pytest

from kernels.one_line import evaluate, run
from reference import convolve

GAINS = (3.0, 2.0)
WIDTH, APRON = 16, 64
PASS = """#include "convolve.clh"
__kernel void one_pass(__global const float *source, int apron, __global const float4 *kernels,
                       __global float *out)
{
    int y = get_global_id(0), stride = 16 + 2 * apron;
    vstore16(convolved(source + (y + apron) * stride + apron, stride, kernels[0]), y, out);
}"""


def one_pass(device, heights, axis, alpha, sigma):
    """The middle (rows, 16) of heights (rows + 2 APRON, 16 + 2 APRON), by the kernel."""
    kernel = np.array([[axis[0], -axis[1], alpha, sigma]], np.float32)
    out = np.zeros((len(heights) - 2 * APRON, WIDTH), np.float32)
    arguments = (heights.astype(np.float32), np.int32(APRON), kernel)
    return run(device, PASS, "one_pass", (len(out),), arguments, out)


def reference(heights, axis, alpha, sigma):
    full = [np.full(heights.shape, value) for value in (alpha, sigma)]
    wide = convolve.along(heights, np.broadcast_to(axis, (*heights.shape, 2)), *full)
    return wide[APRON:-APRON, APRON:-APRON]


def noise(rows=8):
    shape = (rows + 2 * APRON, WIDTH + 2 * APRON)
    return np.random.default_rng(1).uniform(-1, 1, shape).astype(np.float32).astype(np.float64)


def test_share_blurs_stretch_and_sharpens_compression(device):
    r = np.linspace(-1, 1, 41).astype(np.float32)
    found = evaluate(device, "convolve", f"share_of(r, {GAINS[0]}f, {GAINS[1]}f)", {"r": r})
    np.testing.assert_allclose(found, convolve.share(r, *GAINS), rtol=1e-6)
    assert (np.sign(found) == np.sign(r)).all()
    assert (found.min(), found.max()) == (-1.0, 1.0)


def kernels_along(device, axis, r, jacobian, reach):
    expression = f"kernel_along(axis, r, jacobian, (float2)(3.0f, 2.0f), {reach}f, 21.0f)"
    inputs = {"axis": axis, "r": r, "jacobian": jacobian}
    inputs = {name: values.astype(np.float32) for name, values in inputs.items()}
    return evaluate(device, "convolve", expression, inputs, width=4)


def test_the_kernel_of_a_triangle_is_that_of_double(device):
    rng = np.random.default_rng(2)
    angle, r = rng.uniform(0, 2 * np.pi, 500), rng.uniform(-0.5, 0.5, 500)
    axis = np.stack([np.cos(angle), np.sin(angle)], axis=1).astype(np.float32)
    jacobian = (rng.normal(size=(500, 4)) * np.exp(rng.uniform(-5, 5, (500, 1)))).astype(np.float32)
    found = kernels_along(device, axis, r, jacobian, 2.5)
    np.testing.assert_array_equal(found[:, :2], axis * [1, -1])
    np.testing.assert_allclose(found[:, 2], np.where(r > 0, *GAINS) * r, rtol=1e-6)
    assert np.abs(found[:, 2]).max() > 1.2
    sigma = convolve.deviation(jacobian.reshape(-1, 2, 2), axis[:, None].astype(float), 2.5, 1)
    assert sigma.max() == 21
    assert sigma.min() < 0.1
    # |J s| rounds by 2^-23 of |J|, most where s is nearly what J flattens.
    size = np.linalg.norm(jacobian, axis=1)
    np.testing.assert_array_less(
        np.abs(found[:, 3] / sigma[:, 0] - 1), 4 * 2.0**-23 * (1 + size * sigma[:, 0] / 2.5)
    )


@pytest.mark.parametrize(
    ("axis", "jacobian"), [((1, 0), (0, 0, 0, 0)), ((np.nan, 0), (1, 0, 0, 1))]
)
def test_what_has_no_area_or_no_axis_is_left_as_it_is(device, axis, jacobian):
    found = kernels_along(
        device, np.array([axis]), np.array([0.3]), np.array([jacobian], np.float32), 2.5
    )
    assert not found.any()


@pytest.mark.parametrize("sigma", [0.01, 0.33, 0.34, 1.1, 3.0, 9.9, 21.0])
@pytest.mark.parametrize("alpha", [-1.0, -0.2, 0.4, 1.0])
def test_a_pass_is_that_of_double(device, sigma, alpha):
    heights = noise()
    for angle in (0.0, 0.5 * np.pi, 0.7, 2.5, -1.2):
        axis = np.float32([np.cos(angle), np.sin(angle)]).astype(np.float64)
        found = one_pass(device, heights, axis, alpha, np.float32(sigma))
        wanted = reference(heights, axis, alpha, float(np.float32(sigma)))
        assert np.abs(found - wanted).max() <= 2e-5


def test_weights_stay_those_of_a_gaussian_to_the_last_tap(device):
    """A row for each tap, with a one there."""
    heights, taps = np.zeros((64 + 2 * APRON, WIDTH + 2 * APRON)), np.arange(64)
    heights[APRON + taps, APRON + taps] = 1.0
    found = one_pass(device, heights, (1.0, 0.0), 1.0, 21.0)[:, 0]
    wanted = reference(heights, (1.0, 0.0), 1.0, 21.0)[:, 0]
    assert (wanted > 0).all()
    assert (np.abs(found - wanted) <= 3e-4 * wanted).all()


def test_the_sign_of_the_axis_changes_no_bit(device):
    heights = noise()
    one, other = (one_pass(device, heights, (s * 0.6, s * 0.8), 0.7, 5.0) for s in (1, -1))
    np.testing.assert_array_equal(one, other)


def test_no_share_changes_no_bit(device):
    heights = noise()
    found = one_pass(device, heights, (0.6, 0.8), 0.0, 5.0)
    np.testing.assert_array_equal(found, heights[APRON:-APRON, APRON:-APRON])


def test_a_slope_stays_a_slope(device):
    rows, columns = np.indices(noise().shape)
    heights = 0.25 * rows - 0.5 * columns
    for alpha in (-1.0, 0.5, 1.0):
        found = one_pass(device, heights, (0.6, 0.8), alpha, 5.0)
        np.testing.assert_allclose(found, heights[APRON:-APRON, APRON:-APRON], atol=2e-4)
