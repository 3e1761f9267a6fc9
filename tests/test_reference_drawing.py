"""The reference of drawing and levels against integrals, lone elements and bounds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from reference import redraw
from reference.drawing import (
    Pores,
    Wrinkles,
    crop,
    disc_metric,
    draw,
    mellow_max,
    metric_distance,
    profile,
    segment_distance,
)
from reference.inputs import Graph, Response, Shape
from reference.pyramid import halve, levels

DEPTH = 0.03
heights = st.lists(st.floats(0, 4), min_size=1, max_size=8)


def line(strength=0.8, half_width=0.01):
    ends = np.array([[[0.4, 0.5], [0.6, 0.5]]])
    return Wrinkles(ends, np.array([half_width]), np.array([strength]))


def random_graph(seed, wrinkles=60):
    rng = np.random.default_rng(seed)
    node_uv = rng.uniform(0.02, 0.98, (wrinkles, 2))
    other = (np.arange(wrinkles) + rng.integers(1, wrinkles, wrinkles)) % wrinkles
    edge_nodes = np.stack([np.arange(wrinkles), other], axis=-1)
    weights, sizes = rng.uniform(0, 1, (2, wrinkles)), rng.uniform(0.01, 0.05, (2, wrinkles))
    return Graph(node_uv, weights[0], sizes[0], edge_nodes, weights[1], sizes[1])


@pytest.mark.parametrize(("bulge", "weight"), [(7.0, np.ones_like), (4.0, np.abs)])
def test_a_line_at_7_and_a_disc_at_4_displace_no_volume(bulge, weight):
    x, w = np.polynomial.legendre.leggauss(8)  # exact up to degree 15
    t = (x + 1) / 2
    assert (w * weight(t) * profile(t, bulge)).sum() == pytest.approx(0, abs=1e-14)
    assert (w * weight(t) * profile(t, bulge - 0.1)).sum() > 1e-3


def test_profile_ends_at_the_support_without_a_step():
    np.testing.assert_array_equal(profile([0.0, 1.0, 1.5, 40.0], 2.5), [1, 0, 0, 0])
    assert abs(profile(1 - 1e-5, 2.5)) < 1e-9
    assert profile(0.8, 2.5) < 0 < profile(0.5, 2.5)


def test_distance_to_a_segment_has_round_ends():
    points = np.array([[0.5, 0.2], [1.3, 0.4], [-3.0, 4.0], [0.25, 0.0]])
    distance = segment_distance(points, np.zeros(2), np.array([1.0, 0.0]))
    np.testing.assert_allclose(distance, [0.2, 0.5, 5.0, 0.0], rtol=1e-15)


def test_a_metric_measures_an_ellipse_and_a_disc():
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    matrix = turn @ np.diag([1 / 0.02**2, 1 / 0.05**2]) @ turn.T
    metric = matrix[[0, 0, 1], [0, 1, 1]]
    rim = np.array([0.3, 0.7]) + np.array([turn[:, 0] * 0.02, turn[:, 1] * -0.05])
    np.testing.assert_allclose(metric_distance(rim, np.array([0.3, 0.7]), metric), 1, rtol=1e-12)
    disc = metric_distance(rim, np.array([0.3, 0.7]), disc_metric([0.1])[0])
    np.testing.assert_allclose(disc, [0.2, 0.5], rtol=1e-12)


def test_texels_start_at_the_top_left():
    np.testing.assert_array_equal(crop(0, 0, 1, 2, 4), [[0.125, 0.875], [0.375, 0.875]])
    np.testing.assert_array_equal(crop(3, 1, 1, 1, 4), [[0.375, 0.125]])
    whole = crop(0, 0, 8, 8, 8).reshape(8, 8, 2)
    np.testing.assert_array_equal(crop(2, 5, 4, 3, 8).reshape(4, 3, 2), whole[2:6, 5:8])


@pytest.mark.parametrize("shape", [Shape(), Shape(sharpness=3.0, wrinkle_bulge=7.0)])
def test_a_lone_wrinkle_keeps_its_depth(shape):
    points = np.array([[0.5, 0.5], [0.4, 0.5], [0.5, 0.508], [0.5, 0.511], [0.609, 0.5]])
    t = np.array([0, 0, 0.8, 1.1, 0.9])
    expected = -DEPTH * 0.8 * profile(t, shape.wrinkle_bulge)
    np.testing.assert_allclose(draw(points, line(), None, shape, DEPTH), expected, atol=1e-13)
    assert expected[0] < 0 < expected[2]  # a furrow, and its bulge


def test_a_lone_pore_keeps_its_depth():
    pore = Pores(np.array([[0.5, 0.5]]), disc_metric([0.02]), np.array([0.5]))
    points = np.array([[0.5, 0.5], [0.51, 0.5], [0.5, 0.521]])
    expected = -DEPTH * 0.5 * np.array([1, 0.75**2, 0])
    np.testing.assert_allclose(draw(points, None, pore, Shape(), DEPTH), expected, atol=1e-13)


@given(heights, st.floats(0.1, 20))
def test_mellow_max_lies_between_maximum_and_sum(values, sharpness):
    met = mellow_max(values, sharpness)
    assert max(values) * (1 - 1e-9) - 1e-12 <= met <= sum(values) * (1 + 1e-9) + 1e-12
    assert mellow_max(values, sharpness, 16) <= met
    full = mellow_max(values[:1] * 16, sharpness, 16)  # as many as there are slots
    assert full == pytest.approx(values[0], rel=1e-9, abs=1e-12)
    assert mellow_max(values[:1], sharpness) == pytest.approx(values[0], rel=1e-9, abs=1e-12)


@given(heights, heights)
def test_mellow_maxima_merge_without_slots(one, other):
    together = mellow_max(one + other, 20.0, 16)
    merged = mellow_max([mellow_max(one, 20.0, 16), mellow_max(other, 20.0, 16)], 20.0)
    assert merged == pytest.approx(together, rel=1e-9, abs=1e-12)


def test_valleys_and_bulges_do_not_cancel_before_they_meet():
    crossing = Wrinkles(
        np.array([[[0.4, 0.5], [0.6, 0.5]], [[0.492, 0.4], [0.492, 0.6]]]),
        np.array([0.01, 0.01]),
        np.array([1.0, 1.0]),
    )
    t = np.array([[0.0], [0.8]])
    expected = -DEPTH * profile(t, 2.5).sum()  # one of each: both alone, subtracted
    drawn = draw(np.array([[0.5, 0.5]]), crossing, None, Shape(), DEPTH)
    np.testing.assert_allclose(drawn, expected, rtol=1e-12)


def test_a_crop_is_a_piece_of_the_map_and_the_boxes_lose_nothing():
    graph = random_graph(4)
    graph = graph._replace(node_metric=disc_metric(graph.node_radius) * (1, 0, 2))
    whole = redraw.neutral(crop(0, 0, 64, 64, 64), graph, Shape(), DEPTH).reshape(64, 64)
    piece = redraw.neutral(crop(10, 20, 30, 7, 64), graph, Shape(), DEPTH).reshape(30, 7)
    np.testing.assert_array_equal(piece, whole[10:40, 20:27])
    points, lines, pores = crop(0, 0, 64, 64, 64), redraw.wrinkles(graph), redraw.pores(graph)
    t = np.array([segment_distance(points, *s) for s in lines.segments])
    furrows = -lines.strength * profile(t.T / lines.half_width, 2.5)
    d = [metric_distance(points, c, m) for c, m in zip(pores.centres, pores.metric, strict=True)]
    all_heights = np.concatenate([furrows, -pores.strength * profile(np.transpose(d), 0.0)], axis=1)
    bulges = mellow_max(np.maximum(all_heights, 0), 20.0)
    valleys = mellow_max(np.maximum(-all_heights, 0), 20.0)
    np.testing.assert_allclose(whole.ravel(), DEPTH * (bulges - valleys), atol=1e-12)


def test_redraw_without_stretch_is_neutral_and_a_udim_is_only_an_offset():
    graph, points = random_graph(5), crop(0, 0, 32, 32, 32)
    still = np.zeros((60, 2)), np.broadcast_to(np.eye(2), (60, 2, 2))
    neutral = redraw.neutral(points, graph, Shape(), DEPTH)
    drawn = redraw.redraw(points, graph, still, still, Response(), Shape(), DEPTH)
    np.testing.assert_array_equal(drawn, neutral)
    moved = graph._replace(node_uv=graph.node_uv + np.array([3, 1]))
    shifted = redraw.neutral(points, moved, Shape(), DEPTH, origin=(3, 1))
    np.testing.assert_allclose(shifted, neutral, atol=1e-13)


def test_stretch_across_widens_and_flattens_and_along_does_nothing():
    graph = Graph(
        np.array([[0.4, 0.5], [0.6, 0.5]]), np.zeros(2), np.ones(2),
        np.array([[0, 1]]), np.ones(1), np.array([0.05]),
    )  # fmt: skip
    points = np.array([[0.5, 0.5], [0.5, 0.5 + 0.05 * np.e**0.2 * 0.5]])
    none = np.zeros((2, 2)), np.broadcast_to(np.eye(2), (2, 2, 2))
    across, along = (np.array([r]) for r in ([0.0, 0.2], [0.2, 0.0]))
    shape = Shape(wrinkle_bulge=0.0)
    drawn = [
        redraw.redraw(points, graph, (logs, np.eye(2)[None]), none, Response(), shape, DEPTH)
        for logs in (across, along)
    ]
    np.testing.assert_allclose(drawn[0], -DEPTH * np.e**-0.8 * np.array([1, 0.5625]), rtol=1e-5)
    np.testing.assert_allclose(drawn[1], redraw.neutral(points, graph, shape, DEPTH), rtol=1e-12)


def test_angles_on_the_surface_see_through_a_sheared_uv():
    jacobian = np.array([[1.0, 0.5], [0.0, 1.0]])
    uv = np.array([[0.45, 0.4], [0.55, 0.6]])  # runs halfway between the axes on the surface
    size, axes = np.full(2, 0.02), np.linalg.inv(jacobian).T
    axes /= np.linalg.norm(axes, axis=-1, keepdims=True)
    graph = Graph(uv, np.zeros(2), size, np.array([[0, 1]]), np.ones(1), size[:1])
    stretch, none = (np.array([[0.2, 0.0]]), axes[None]), (np.zeros((2, 2)), np.stack([axes] * 2))
    points = np.array([[0.5, 0.5]])
    settings = (points, graph, stretch, none, Response(), Shape(), DEPTH)
    on_surface = redraw.redraw(*settings, jacobian=jacobian[None])
    np.testing.assert_allclose(on_surface, -DEPTH * np.exp(-4 * 0.1), rtol=1e-5)
    assert abs(redraw.redraw(*settings)[0] / on_surface[0] - 1) > 0.05


def test_a_pore_answers_to_the_mean_of_both_stretches():
    uv, half = np.array([[0.5, 0.5], [0.9, 0.9]]), np.array([0.05, 0.05])
    graph = Graph(uv, np.array([0.6, 0.0]), half, np.array([[0, 1]]), np.zeros(1), half[:1])
    width, deep = np.exp(4 * -0.05), np.exp(-10 * -0.05)
    points = np.array([[0.5, 0.5], [0.5 + 0.05 * width * 0.5, 0.5], [0.5, 0.5 + 0.05]])
    logs, axes = np.array([[0.1, -0.2]] * 2), np.broadcast_to(np.eye(2), (2, 2, 2))
    at_wrinkles, at_pores = (logs[:1], axes[:1]), (logs, axes)
    drawn = redraw.redraw(points, graph, at_wrinkles, at_pores, Response(), Shape(), DEPTH)
    np.testing.assert_allclose(drawn, -DEPTH * 0.6 * deep * np.array([1, 0.5625, 0]), atol=1e-12)


def test_levels_are_means_down_to_one_texel():
    finest = np.random.default_rng(0).normal(size=(16, 16))
    found = levels(finest)
    assert [level.shape for level in found] == [(16, 16), (8, 8), (4, 4), (2, 2), (1, 1)]
    assert found[1][2, 5] == pytest.approx(finest[4:6, 10:12].mean(), rel=1e-14)
    assert found[-1][0, 0] == pytest.approx(finest.mean(), abs=1e-15)
    np.testing.assert_array_equal(halve(np.stack([finest, finest])), [found[1], found[1]])
