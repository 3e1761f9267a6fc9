"""Alg. 1 and 2 on the device against the reference."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import rhytid_kernels
from kernels.one_line import evaluate, run
from reference import response as reference
from rhytid.pipeline.reach import response_defines
from rhytid.pipeline.vectors import VECTOR

OPTIONS = [f"-D{name}={value}" for name, value in response_defines(False).items()]


def unit(angle):
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def sampled(seed, count=3000):
    """theta (n, 2), axes (n, 4) and logs (n, 2) of triangles whose axes need not be orthogonal."""
    rng = np.random.default_rng(seed)
    first = rng.uniform(0, 2 * np.pi, count)
    second = first + rng.uniform(0.3, np.pi - 0.3, count)
    return {
        "theta": unit(rng.uniform(0, 2 * np.pi, count)).astype(np.float32),
        "axes": np.concatenate([unit(first), unit(second)], axis=1).astype(np.float32),
        "logs": rng.uniform(-0.5, 0.5, (count, 2)).astype(np.float32),
    }


def across(device, inputs):
    return evaluate(
        device, "response", "log_stretch_across(theta, axes, logs)", inputs, options=OPTIONS
    )


def test_log_stretch_across_is_algorithm_1(device):
    inputs = sampled(1)
    wanted = reference.wrinkle_stretch(
        inputs["logs"], inputs["axes"].reshape(-1, 2, 2), inputs["theta"]
    )
    # 1 - |θ·ŝ| rounds by 1e-7 at most; the two of them add up to 0.01 at least with these axes.
    np.testing.assert_allclose(across(device, inputs), wanted, atol=2e-5, rtol=0)


def test_signs_of_axes_and_of_the_wrinkle_are_free(device):
    inputs = sampled(2)
    plain = across(device, inputs)
    for name, sign in (("axes", [-1, -1, 1, 1]), ("axes", [1, 1, -1, -1]), ("theta", [-1, -1])):
        turned = {**inputs, name: inputs[name] * np.array(sign, np.float32)}
        np.testing.assert_array_equal(across(device, turned), plain)


def test_a_wrinkle_along_both_axes_is_not_stretched(device):
    along = np.array([[0.6, 0.8]], np.float32)
    inputs = {
        "theta": along,
        "axes": np.tile(along, 2),
        "logs": np.array([[0.5, -0.2]], np.float32),
    }
    assert abs(across(device, inputs)[0]) < 0.05


def test_mean_log_stretch_is_algorithm_2(device):
    logs = sampled(3)["logs"]
    found = evaluate(device, "response", "mean_log_stretch(logs)", {"logs": logs}, options=OPTIONS)
    np.testing.assert_allclose(found, reference.pore_stretch(logs), atol=1e-7, rtol=0)


def scales(device, r, width, depth):
    expression = (
        f"(float2)(scales_of(r, {width}f, {depth}f, 4.0f).width, "
        f"scales_of(r, {width}f, {depth}f, 4.0f).depth)"
    )
    return evaluate(device, "response", expression, {"r": r}, width=2, options=OPTIONS)


@pytest.mark.parametrize(("width", "depth"), [(1.0, 4.0), (4.0, 10.0), (0.5, 0.25)])
def test_scales_are_exact_to_1e_5(device, width, depth):
    r = np.linspace(-0.5, 0.5, 4001, dtype=np.float32)
    wanted = np.stack(reference.scales(r, width, depth), axis=1)
    np.testing.assert_allclose(scales(device, r, width, depth), wanted, rtol=1e-5)


def test_scales_without_stretch_are_exactly_one(device):
    np.testing.assert_array_equal(scales(device, np.zeros(1, np.float32), 64.0, 64.0), 1.0)


@given(st.floats(-4, 4, width=32), st.sampled_from([0.0, 1.0, 10.0, 64.0]))
def test_scales_stay_within_a_quarter_and_four(device, r, exponent):
    found = scales(device, np.array([r], np.float32), exponent, exponent)
    assert (found >= 0.25).all()
    assert (found <= 4.0).all()


@pytest.mark.parametrize("exponent", [1.0, 10.0, 64.0])
def test_scales_are_as_exact_at_every_exponent(device, exponent):
    r = np.linspace(-1.5 / exponent, 1.5 / exponent, 4001, dtype=np.float32)
    wanted = np.stack(reference.scales(r, exponent, exponent), axis=1)
    np.testing.assert_allclose(scales(device, r, exponent, exponent), wanted, rtol=1e-6)


def test_an_error_of_r_counts_as_often_as_the_exponent(device):
    inputs = sampled(4)
    axes = inputs["axes"].reshape(-1, 2, 2)
    exact = reference.wrinkle_stretch(inputs["logs"], axes, inputs["theta"])
    found = scales(device, across(device, inputs), 64.0, 64.0)
    wanted = np.stack(reference.scales(exact, 64.0, 64.0), axis=1)
    np.testing.assert_allclose(found, wanted, rtol=1.3e-3)


def test_the_limit_of_scales_is_the_one_that_is_given(device):
    r = np.array([-2.0, 2.0], np.float32)
    call = "(float2)(scales_of(r, 1.0f, 1.0f, 2.0f).width, scales_of(r, 1.0f, 1.0f, 2.0f).depth)"
    found = evaluate(device, "response", call, {"r": r}, width=2, options=["-DSCALE_LIMIT=2.0f"])
    np.testing.assert_array_equal(found, [[0.5, 2.0], [2.0, 0.5]])


@pytest.mark.parametrize("count", [1, 15, 16, 17, 48])
def test_ends_go_to_the_mean_with_their_partners_and_none_has_nothing(device, count):
    random = np.random.default_rng(count)
    r = random.normal(size=count).astype(np.float32)
    partners = random.integers(-1, count, (count, 2)).astype(np.int32)
    out = np.full((count + 2, 2), 7.0, np.float32)
    arguments = [r, partners, np.int32(count), np.float32(0.75)]
    text, options = rhytid_kernels.source("ends"), ["-DSCALE_LIMIT=4.0f"]
    size = (count // VECTOR + 1,)
    found = run(device, text, "end_stretches", size, arguments, out, options)
    own = r[:, None].astype(np.float64)
    wanted = np.where(partners < 0, own, own + 0.375 * (r[np.maximum(partners, 0)] - own))
    np.testing.assert_allclose(found[:count], wanted, atol=1e-6)
    np.testing.assert_array_equal(found[:count][partners < 0], np.repeat(own, 2, 1)[partners < 0])
    np.testing.assert_array_equal(found[count:], [[0.0, 0.0], [7.0, 7.0]])


# Numbers of elements around those of a group.
COUNTS = [1, 15, 16, 17, 48]


def elements(count, seed=5):
    """sampled(…) of 7 triangles, with a matrix each; and of elements: which they sample, where they
    run, how stiff they are."""
    found = sampled(seed, count=7)
    rng = np.random.default_rng(count)
    segments = rng.uniform(-3, 3, (count, 4)).astype(np.float32)
    return {
        **found,
        "triangle": rng.integers(0, 7, count).astype(np.int32),
        "segments": segments,
        "stiffness": rng.uniform(0, 2, count).astype(np.float32),
        "jacobians": (np.eye(2).ravel() + rng.uniform(-0.4, 0.4, (7, 4))).astype(np.float32),
    }


def of_triangles(inputs, on_surface):
    """θ of the elements, and axes and logs of what they sample."""
    triangle = inputs["triangle"]
    theta, axes = inputs["segments"][:, 2:], inputs["axes"].reshape(-1, 2, 2)[triangle]
    theta = theta / np.linalg.norm(theta, axis=1, keepdims=True)
    if on_surface:
        jacobians = inputs["jacobians"].reshape(-1, 2, 2)[triangle]
        theta = reference.on_surface(jacobians, theta)
        axes = reference.on_surface(jacobians[:, None], axes)
    return theta, axes, inputs["logs"][triangle]


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize(("stiff", "surface"), [(False, False), (True, False), (False, True)])
def test_every_wrinkle_of_a_group_answers_to_its_own_triangle(device, count, stiff, surface):
    inputs = elements(count)
    theta, axes, logs = of_triangles(inputs, surface)
    wanted = reference.wrinkle_stretch(logs, axes, theta)
    arguments = [
        None, inputs["segments"], inputs["triangle"], inputs["axes"], inputs["logs"],
        inputs["jacobians"] if surface else None, inputs["stiffness"] if stiff else None,
        np.int32(count), np.float32(1.0), np.float32(2.0),
    ]  # fmt: skip
    out, size = np.full(count + 3, 7.0, np.float32), (count // VECTOR + 2,)
    text, options = rhytid_kernels.source("respond"), [*OPTIONS, "-DBENT=1"]
    found = run(device, text, "respond_wrinkles", size, arguments, out, options)
    wanted = wanted * (inputs["stiffness"] if stiff else 1.0)
    np.testing.assert_allclose(found[:count], wanted, atol=1e-4 if surface else 2e-5, rtol=0)
    np.testing.assert_array_equal(found[count:], 7.0)


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize(("stiff", "limit"), [(False, 4.0), (True, 1.25)])
def test_every_pore_of_a_group_has_its_own_scales(device, count, stiff, limit):
    inputs = elements(count)
    r = reference.pore_stretch(inputs["logs"][inputs["triangle"]])
    r = r * (inputs["stiffness"] if stiff else 1.0)
    width, depth = reference.scales(r, 1.0, 3.0)
    arguments = [
        None, inputs["triangle"], inputs["logs"], inputs["stiffness"] if stiff else None,
        np.int32(count), np.float32(1.0), np.float32(3.0), np.float32(limit),
    ]  # fmt: skip
    out, size = np.full((count + 3, 2), 7.0, np.float32), (count // VECTOR + 2,)
    text = rhytid_kernels.source("respond")
    found = run(device, text, "respond_pores", size, arguments, out, OPTIONS)
    wanted = np.stack([width, np.minimum(depth, limit)], axis=1)
    np.testing.assert_allclose(found[:count], wanted, rtol=1e-5)
    np.testing.assert_array_equal(found[count:], 7.0)


def test_some_groups_alone_respond_where_they_are_named(device):
    inputs, count = elements(48), 48
    arguments = [
        np.array([2, 0], np.int32), inputs["triangle"], inputs["logs"], None,
        np.int32(count), np.float32(1.0), np.float32(3.0), np.float32(4.0),
    ]  # fmt: skip
    out = np.full((count, 2), 7.0, np.float32)
    found = run(
        device, rhytid_kernels.source("respond"), "respond_pores", (2,), arguments, out, OPTIONS
    )
    np.testing.assert_array_equal(found[16:32], 7.0)
    r = reference.pore_stretch(inputs["logs"][inputs["triangle"]])
    wanted = np.stack(reference.scales(r, 1.0, 3.0), axis=1)
    others = np.r_[0:16, 32:48]
    np.testing.assert_allclose(found[others], wanted[others], rtol=1e-5)
