"""The reference of the response (Alg. 1, 2) and of the fast method (Alg. 3)."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from reference import bins as fast
from reference import redraw
from reference.drawing import crop
from reference.inputs import Bins, Graph, Response, Shape
from reference.response import on_surface, pore_stretch, scales, wrinkle_stretch

DEPTH = 0.03
angle = st.floats(0, 2 * np.pi)
logs = st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
counts = st.sampled_from([1, 2, 4, 8, 16])


def towards(*angles):
    return np.stack([np.cos(angles), np.sin(angles)], axis=-1)


@given(logs, angle, angle, st.floats(0.3, 2.8))
def test_r_lies_between_the_log_stretches_whatever_the_signs(log_ratios, a, b, between):
    axes, theta = towards(b, b + between), towards(a)[0]
    r = wrinkle_stretch(log_ratios, axes, theta)
    assert min(*log_ratios, 0) - 1e-15 <= r <= max(*log_ratios, 0) + 1e-15
    assert r == wrinkle_stretch(log_ratios, -axes, theta)
    assert r == wrinkle_stretch(log_ratios, axes, -theta)
    assert r == wrinkle_stretch(log_ratios[::-1], axes[::-1], theta)


def test_only_stretch_across_a_wrinkle_counts():
    axes = towards(0.3, 0.3 + np.pi / 2)
    along, across, between = (
        wrinkle_stretch([0.4, -0.2], axes, towards(0.3 + turn)[0])
        for turn in (0, np.pi / 2, np.pi / 4)
    )
    assert along == pytest.approx(-0.2 / (1 + 1e-6), rel=1e-12)
    assert across == pytest.approx(0.4 / (1 + 1e-6), rel=1e-12)
    assert between == pytest.approx(0.1, rel=1e-5)
    assert pore_stretch([0.4, -0.2]) == pytest.approx(0.1, rel=1e-15)


def test_scales_are_clamped_to_a_quarter_and_four():
    np.testing.assert_allclose(scales(0.1, 4.0, 10.0), [np.e**0.4, np.e**-1.0], rtol=1e-14)
    np.testing.assert_allclose(scales([0.5, -0.5], 4.0, 10.0), [[4, 0.25], [0.25, 4]], rtol=1e-14)
    np.testing.assert_array_equal(scales(0.0, 1.0, 4.0), [1, 1])


def test_angles_on_the_surface_are_taken_after_the_jacobian():
    jacobian = np.array([[2.0, 0.0], [0.0, 1.0]])
    np.testing.assert_allclose(on_surface(jacobian, [[1, 2], [0, -3]]), [[0.5**0.5] * 2, [0, -1]])
    turned = on_surface(jacobian, np.eye(2))
    np.testing.assert_array_equal(turned, np.eye(2))
    r = fast.layer_stretch([0.4, -0.2], towards(0.0, np.pi / 2), 4, jacobian)
    theta = on_surface(jacobian, fast.directions(4)[1])
    expected = wrinkle_stretch([0.4, -0.2], np.eye(2), theta)
    assert r[1] == pytest.approx(expected, rel=1e-14)


def test_four_bins_are_the_points_of_the_compass():
    half = 0.5**0.5
    compass = [[0, 1], [half, half], [1, 0], [half, -half]]  # N-S, NE-SW, E-W, SE-NW
    np.testing.assert_allclose(fast.directions(4), compass, atol=1e-15)
    directions = np.concatenate([compass, np.negative(compass)])
    index, margin = fast.assign(directions, 4)
    assert index.tolist() == [0, 1, 2, 3] * 2
    np.testing.assert_allclose(margin, np.pi / 8, rtol=1e-12)


@given(angle, counts)
def test_a_wrinkle_goes_to_the_bin_nearest_in_angle(a, count):
    theta = towards(a)
    index, margin = fast.assign(theta, count)
    cosines = np.abs(fast.directions(count) @ theta[0])
    assert cosines[index[0]] >= cosines.max() - 1e-12
    if count > 1:
        turn = 0.999 * margin[0]
        assert fast.assign(towards(a + turn, a - turn), count)[0].tolist() == [index[0]] * 2


@given(st.floats(-0.7, 0.7), st.sampled_from([3, 5, 7]), st.floats(0.01, 0.5))
def test_blend_weights_reach_r_between_two_samples(r, count, r_max):
    bins = Bins(samples=count, r_max=r_max)
    below, share = fast.blend_weights(r, bins)
    assert 0 <= below <= count - 2
    assert 0 <= share <= 1
    at = fast.samples(bins)
    reached = (1 - share) * at[below] + share * at[below + 1]
    assert reached == pytest.approx(np.clip(r, -r_max, r_max), abs=1e-14)


def test_steps_cover_the_deepest_map_and_two_tenths():
    steps = fast.steps(Bins(), DEPTH, 4.0)
    np.testing.assert_allclose(steps * 127 / DEPTH, [np.e**0.8 + 0.2, 1.2, np.e**-0.8 + 0.2])
    clamped = fast.steps(Bins(bits=16), DEPTH, 10.0)
    np.testing.assert_allclose(clamped * 32767 / DEPTH, [4.2, 1.2, 0.25 + 0.2])
    np.testing.assert_allclose(fast.steps(Bins(depth_factored=True), DEPTH, 4.0), DEPTH * 1.2 / 127)


@given(st.floats(-1.2, 1.2), st.sampled_from([8, 16]))
def test_quantisation_is_symmetric_and_errs_by_half_a_step(height, bits):
    step = 1.2 / (2 ** (bits - 1) - 1)
    code = fast.quantise(height, step, bits)
    assert abs(code * step - height) <= step / 2 * (1 + 1e-9)
    assert fast.quantise(-height, step, bits) == -code
    assert fast.quantise(0.0, step, bits) == 0
    assert fast.quantise(9.0, step, bits) == 2 ** (bits - 1) - 1


def random_graph(seed, wrinkles=40):
    rng = np.random.default_rng(seed)
    node_uv = rng.uniform(0.1, 0.9, (wrinkles, 2))
    edge_nodes = np.stack([np.arange(wrinkles), np.roll(np.arange(wrinkles), 1)], axis=-1)
    weights, sizes = rng.uniform(0.2, 1, (2, wrinkles)), rng.uniform(0.02, 0.05, (2, wrinkles))
    return Graph(node_uv, weights[0], sizes[0], edge_nodes, weights[1], sizes[1])


def everywhere(log_ratios, axes, count):
    return np.broadcast_to(log_ratios, (count, 2)), np.broadcast_to(axes, (count, 2, 2))


@pytest.mark.parametrize("slots", [1, 16])
@pytest.mark.parametrize("r", [-0.2, 0.0, 0.2])
@pytest.mark.parametrize("factored", [False, True])
def test_mellow_merge_at_a_sample_is_redraw_up_to_quantisation(r, slots, factored):
    graph, points = random_graph(1), crop(0, 0, 48, 48, 48)
    # Gentle exponents: with depth factored, shape and depth part exactly only for lone elements.
    response, shape = Response(1.0, 1.0, 1.0, 1.0), Shape(slots=slots)
    bins = Bins(bits=16, merge="mellow", depth_factored=factored)
    logs, axes = everywhere([r, r], np.eye(2), len(points))
    drawn = fast.binned(points, graph, logs, axes, response, shape, bins, DEPTH)
    at_elements = everywhere([r, r], np.eye(2), 40)
    expected = redraw.redraw(points, graph, at_elements, at_elements, response, shape, DEPTH)
    if factored and r:
        assert 1e-4 < np.abs(drawn - expected).max() / DEPTH < 0.1
    else:
        np.testing.assert_allclose(drawn, expected, atol=2e-4 * DEPTH)


def test_minimum_keeps_the_deepest_layer():
    graph, points = random_graph(2), crop(0, 0, 48, 48, 48)
    logs, axes = everywhere([0.0, 0.0], np.eye(2), len(points))
    bins, response, shape = Bins(), Response(), Shape()
    drawn = fast.binned(points, graph, logs, axes, response, shape, bins, DEPTH)
    codes = [fast.codes(points, graph, n, response, shape, bins, DEPTH) for n in range(5)]
    lowest = np.min([layer[1, 0] for layer in codes], axis=0) * DEPTH * 1.2 / 127
    np.testing.assert_allclose(drawn, lowest, atol=1e-15)
    assert np.mean(drawn < 0) > 0.2


@pytest.mark.parametrize("count", [1, 4])
@pytest.mark.parametrize("factored", [False, True])
def test_a_lone_wrinkle_beyond_r_max(count, factored):
    ends = np.array([[0.2, 0.5], [0.8, 0.5]])
    sizes = np.full(2, 0.05)
    graph = Graph(ends, np.zeros(2), sizes, np.array([[0, 1]]), np.ones(1), sizes[:1])
    bins = Bins(count=count, bits=16, depth_factored=factored)
    logs, axes = everywhere([0.1, -0.4], np.eye(2), 1)
    drawn = fast.binned(np.array([[0.5, 0.5]]), graph, logs, axes, Response(), Shape(), bins, DEPTH)
    r = -0.15 if count == 1 else -0.4  # one bin takes the mean
    if factored:
        expected = min(np.exp(-4 * r), 4.0)
    else:  # linear between sigma_d at -r_max and at 0
        share = min(-r / 0.2, 1.0)
        expected = share * np.exp(0.8) + 1 - share
    assert drawn[0] == pytest.approx(-DEPTH * expected, rel=1e-4)
