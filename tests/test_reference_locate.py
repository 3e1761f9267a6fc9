"""The reference of point location: its rules one by one, and what its margins promise."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meshes import bumpy_grid
from reference.locate import locate, sample

SQUARE = np.array([[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]], float)
PADDING = 0.05


def index_of(points, triangles, padding=PADDING):
    return locate(np.atleast_2d(points), triangles, padding)[0].tolist()


def test_lowest_index_on_edge_corner_and_overlap():
    points = [[0.5, 0.25], [0.25, 0.5], [0.5, 0.5], [0, 0]]
    assert index_of(points, SQUARE) == [0, 1, 0, 0]
    assert index_of(points, SQUARE[::-1]) == [1, 0, 0, 0]
    assert index_of(points, np.concatenate([SQUARE, SQUARE])) == [0, 1, 0, 0]


def test_mirrored_triangles_hold_points_too():
    assert index_of([[0.5, 0.25], [0.25, 0.5]], SQUARE[:, ::-1]) == [0, 1]


def test_nearest_within_padding_and_no_farther():
    points = [[1.05, 0.5], [1.0625, 0.5], [0.5, 1.04], [0.5, -0.06]]
    assert index_of(points, SQUARE, 0.0625) == [0, 0, 1, 0]
    assert index_of(points, SQUARE, 0.05) == [-1, -1, 1, -1]
    assert index_of([[1.0, 0.5], [1.0 + 1e-9, 0.5]], SQUARE, 0.0) == [0, -1]


def test_ties_at_a_shared_corner_go_to_the_lowest_with_a_margin():
    index, margin = locate(np.array([[1.03, 1.03]]), SQUARE, PADDING)
    assert index.tolist() == [0]
    assert margin[0] > 1e-5
    assert index_of([[1.03, 1.03]], SQUARE[::-1]) == [0]


def test_equal_distances_to_different_places_have_no_margin():
    apart = np.array([SQUARE[0], SQUARE[0] + (1.0625, 0)])
    index, margin = locate(np.array([[1.03125, 0.0]]), apart, PADDING)
    assert (index.tolist(), margin.tolist()) == ([0], [0])


def test_triangles_without_area_are_skipped():
    flat = np.array([[[0, 0], [1, 1], [0.5, 0.5]]])
    assert index_of([[0.5, 0.5]], flat) == [-1]
    assert index_of([[0.5, 0.5]], np.concatenate([flat, SQUARE])) == [1]


def test_every_point_agrees_with_barycentric_coordinates():
    mesh = bumpy_grid(6, seed=2)
    triangles = mesh.uv[mesh.face_uv].astype(np.float64)
    points = np.random.default_rng(3).uniform(0, 1, (2000, 2))
    basis = np.linalg.inv(np.swapaxes(triangles[:, 1:] - triangles[:, :1], 1, 2))
    b = np.einsum("fij,pfj->pfi", basis, points[:, None] - triangles[:, 0])
    holds = (b.min(-1) >= 0) & (b.sum(-1) <= 1)
    assert (holds.sum(axis=1) <= 1).all()
    expected = np.where(holds.any(axis=1), holds.argmax(axis=1), -1)
    np.testing.assert_array_equal(locate(points, triangles, 0.0)[0], expected)
    assert 0.2 < holds.any(axis=1).mean() < 0.5


@pytest.mark.slow
@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1))
def test_padding_takes_the_nearest_of_densely_sampled_borders(seed):
    rng = np.random.default_rng(seed)
    triangles = rng.uniform(0, 1, (4, 3, 2))
    points = rng.uniform(-0.1, 1.1, (50, 2))
    index, margin = locate(points, triangles, PADDING)
    t = np.linspace(0, 1, 1001)[:, None]
    start = triangles.reshape(-1, 1, 2)
    border = start + t * (np.roll(triangles, -1, axis=1).reshape(-1, 1, 2) - start)
    distance = (
        np.linalg.norm(points[:, None] - border.reshape(-1, 2), axis=-1).reshape(50, 4, -1).min(-1)
    )
    held = locate(points, triangles, 0.0)[0] >= 0
    near = ~held & (index >= 0) & (margin > 0)
    coarse = 1.5e-3  # half the spacing of the samples, twice
    assert (distance[near, index[near]] <= distance[near].min(axis=1) + coarse).all()
    assert (distance[near, index[near]] <= PADDING + coarse).all()
    assert (distance[index < 0].min(axis=1) > PADDING - coarse).all()


@pytest.mark.slow
@given(st.integers(0, 2**32 - 1))
def test_a_point_moved_by_less_than_its_margin_keeps_its_triangle(seed):
    rng = np.random.default_rng(seed)
    mesh = bumpy_grid(4, seed % 7)
    triangles = np.concatenate([mesh.uv[mesh.face_uv], rng.uniform(0, 1, (3, 3, 2))])
    triangles = rng.permutation(triangles.astype(np.float64))
    points = rng.uniform(0, 1, (300, 2))
    index, margin = locate(points, triangles, PADDING, band=0.02)
    angle = rng.uniform(0, 2 * np.pi, 300)
    step = 0.999 * margin[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    np.testing.assert_array_equal(locate(points + step, triangles, PADDING, band=0.02)[0], index)


def test_margins_are_seldom_small():
    mesh = bumpy_grid(10, seed=1)
    points = np.random.default_rng(0).uniform(0, 1, (20_000, 2))
    triangles = mesh.uv[mesh.face_uv]
    held = locate(points, triangles, 0.0)[0] >= 0
    index, margin = locate(points, triangles, PADDING)
    assert 0.1 < (index < 0).mean() < 0.5
    assert (margin[held] < 1e-6).mean() < 5e-4
    # Outside, distances to two triangles around one corner differ by the square of the angle.
    assert (margin < 1e-6).mean() < 3e-3


def test_samples_outside_are_unstretched():
    logs, axes = sample(np.array([1, -1]), [[9, 9], [0.1, 0.2]], np.ones((2, 2, 2)))
    np.testing.assert_array_equal(logs, [[0.1, 0.2], [0, 0]])
    np.testing.assert_array_equal(axes, [np.ones((2, 2)), np.eye(2)])
