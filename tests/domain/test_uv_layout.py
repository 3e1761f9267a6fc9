"""Overlapping triangles in UV, counted on a grid, against points that are asked one by one."""

from __future__ import annotations

import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from reference.overlaps import covers, overlap_share
from rhytid.domain import uv_layout
from rhytid.domain.uv_layout import SIDE, overlap_of
from rhytid_lab.samples.face import procedural_face

pytestmark = pytest.mark.release


def lattice(n: int) -> NDArray[np.float64]:
    """(2n², 3, 2) triangles that cover the unit square once, their corners moved about."""
    rng = np.random.default_rng(5)
    x, y = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1))
    points = np.stack([x, y], axis=-1).reshape(-1, 2)
    inner = (points > 0).all(axis=1) & (points < 1).all(axis=1)
    points[inner] += rng.uniform(-0.3, 0.3, (inner.sum(), 2)) / n
    corner = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).reshape(-1, 1)
    faces = np.concatenate([corner + np.array(c) for c in ([0, 1, n + 2], [0, n + 2, n + 1])])
    return points[faces]


def test_triangles_side_by_side_do_not_overlap() -> None:
    assert overlap_of(lattice(40)) is None


@pytest.mark.slow
@given(st.integers(1, 10_000))
def test_shares_are_those_of_points(seed: int) -> None:
    rng = np.random.default_rng(seed)
    corners = rng.uniform(0.05, 0.95, (6, 3, 2))
    points = (np.stack(np.meshgrid(*2 * [np.arange(200)]), -1).reshape(-1, 2) + 0.37) / 200
    found, wanted = overlap_of(corners), overlap_share(corners, points)
    assert (found.share if found else 0.0) == pytest.approx(wanted, abs=0.02)
    assert (found.most if found else 1) >= covers(points, corners).max()


def test_the_place_lies_under_several() -> None:
    corners = lattice(8)
    corners = np.concatenate(
        [corners, corners[20:21] * [1, -1] + [0, 1]]
    )  # mirrored: its own place
    found = overlap_of(corners)
    assert found is not None
    assert found.most == 2
    assert covers([found.uv], corners)[0] == 2


def test_what_is_outside_is_cut_off() -> None:
    inside = np.array([[[0.1, 0.1], [0.9, 0.1], [0.5, 0.9]]])
    beyond = inside + np.array([2.0, 0.0])
    assert overlap_of(np.concatenate([inside, beyond, beyond])) is None
    assert overlap_of(np.empty((0, 3, 2))) is None


def test_a_layout_of_many_large_triangles_is_looked_at_coarsely(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(uv_layout, "_MOST_ROWS", 100 * SIDE)
    monkeypatch.setattr(uv_layout, "_ROWS", 64)
    corners = np.tile([[[0.1, 0.1], [0.9, 0.1], [0.5, 0.9]]], (1000, 1, 1))
    found = overlap_of(corners)
    assert found is not None
    assert (found.share, found.most) == (1.0, 1000)


@pytest.mark.slow
def test_three_hundred_thousand_triangles_take_little_time() -> None:
    corners = procedural_face(388).mesh.triangle_uv()
    spent = []
    for _ in range(3):
        start = time.process_time()
        assert overlap_of(corners) is None
        spent.append(time.process_time() - start)
    assert min(spent) < 0.5
