"""The axes and the kernel of a texel, helper by helper."""

from __future__ import annotations

import numpy as np
import pytest

from kernels.one_line import evaluate
from reference import convolve

COUNT, LIMIT = 1000, 0.5
FIELD = "((field_t){{g.x, g.y, g.z}, {h.x, h.y, h.z}})"
NAMES = ("log1", "log2", "u1", "v1", "u2", "v2")


def metrics(aspect, seed=1):
    """G (n, 2, 2) of UV that are sheared by up to `aspect`."""
    rng = np.random.default_rng(seed)
    j = np.linalg.qr(rng.normal(size=(COUNT, 2, 2)))[0] * [1.0, 1.0 / aspect]
    j = j @ np.linalg.qr(rng.normal(size=(COUNT, 2, 2)))[0] * 10.0 ** rng.uniform(-3, 3)
    return np.swapaxes(j, 1, 2) @ j


def packed(form):
    return np.stack([form[:, 0, 0], form[:, 0, 1], form[:, 1, 1]], axis=1).astype(np.float32)


def in_order(device, metric, log_form, own_axes):
    """log ρ (n, 2) and axes (n, 2, 2)."""
    inputs = {"g": packed(metric), "h": packed(log_form)}
    found = [
        evaluate(device, "convolve_smooth", f"in_order({FIELD}, {own_axes}, {LIMIT}f).{n}", inputs)
        for n in NAMES
    ]
    return np.stack(found[:2], axis=1), np.stack(found[2:], axis=1).reshape(-1, 2, 2)


def test_an_even_stretch_has_u_and_its_conjugate_for_axes(device):
    metric = metrics(3.0)
    even = np.linspace(-0.4, 0.4, COUNT)
    logs, axes = in_order(device, metric, even[:, None, None] * metric, 1)
    np.testing.assert_allclose(logs, np.stack([even, even], axis=1), atol=5e-6)
    np.testing.assert_array_equal(axes[:, 0], np.tile(np.float32([1, 0]), (COUNT, 1)))
    np.testing.assert_allclose(np.linalg.norm(axes[:, 1], axis=1), 1, rtol=1e-6)
    conjugate = np.einsum("nk,nkl,nl->n", axes[:, 0], metric, axes[:, 1])
    assert np.abs(conjugate / np.trace(metric, axis1=1, axis2=2)).max() <= 1e-6


def test_axes_of_their_own_are_the_principal_ones(device):
    metric = metrics(3.0)
    even = np.linspace(-0.4, 0.4, COUNT)
    stretched = even[:, None, None] * metric
    stretched[:, 1, 1] += 0.01 * metric[:, 1, 1]
    logs, axes = in_order(device, metric, stretched, 1)
    assert (logs[:, 0] - logs[:, 1] > 1e-3).all()
    # H s = λ G s.
    for i in range(2):
        force = np.einsum("nkl,nl->nk", stretched - logs[:, i, None, None] * metric, axes[:, i])
        assert np.abs(force / np.trace(metric, axis1=1, axis2=2)[:, None]).max() <= 1e-5


@pytest.mark.slow
def test_models_without_axes_keep_u_before_v(device):
    rng = np.random.default_rng(2)
    r = rng.uniform(-0.7, 0.7, (COUNT, 2)).astype(np.float32)
    r[: COUNT // 10, 1] = r[: COUNT // 10, 0]
    one = np.tile(np.eye(2), (COUNT, 1, 1))
    logs, axes = in_order(device, one, r[:, None, :] * one, 0)
    np.testing.assert_allclose(logs, np.clip(r, -LIMIT, LIMIT), rtol=1e-6)
    np.testing.assert_array_equal(axes, one)


def test_the_kernel_in_a_metric_is_that_of_double(device):
    metric = metrics(10.0, 3)
    rng = np.random.default_rng(4)
    angle, r = rng.uniform(0, 2 * np.pi, COUNT), rng.uniform(-0.5, 0.5, COUNT)
    axis = np.stack([np.cos(angle), np.sin(angle)], axis=1).astype(np.float32)
    inputs = {"g": packed(metric), "axis": axis, "r": r.astype(np.float32)}
    size = np.sqrt(metric[:, 0, 0].mean())
    metric_of = "(form_t){g.x, g.y, g.z}"
    expression = f"kernel_in({metric_of}, axis, r, (float2)(3.0f, 2.0f), {2 * size:.9e}f, 21.0f)"
    found = evaluate(device, "convolve_smooth", expression, inputs, width=4)
    np.testing.assert_array_equal(found[:, :2], axis * [1, -1])
    np.testing.assert_allclose(found[:, 2], convolve.share(np.float32(r), 3.0, 2.0), rtol=1e-6)
    wanted = convolve.deviation_in(metric, axis[:, None].astype(float), 2 * size, 1)[:, 0]
    # sᵀGs rounds by 2^-22 of the trace: by a hundred times that of itself at this aspect.
    np.testing.assert_allclose(found[:, 3], wanted, rtol=100 * 2.0**-22)
    assert wanted.min() < 4
    assert wanted.max() > 10


def test_a_metric_that_vanishes_along_an_axis_has_the_widest_kernel(device):
    inputs = {"g": np.array([[1, 0, 0], [1, 1, 1]], np.float32)}
    expression = "kernel_in((form_t){g.x, g.y, g.z}, (float2)(0.0f, 1.0f), 0.1f, (float2)(3.0f), "
    found = evaluate(device, "convolve_smooth", f"{expression} 1.0f, 21.0f)", inputs, width=4)
    np.testing.assert_allclose(found[:, 3], [21.0, 1.0])
