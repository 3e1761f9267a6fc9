"""Sizes are meant on the surface: a drawn line is as wide there whatever way it runs in UV."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rhytid.domain.mesh import Mesh
from rhytid.synthesis import shapes
from rhytid.synthesis.shapes import ALONG, edge_weights, half_widths_uv, pore_axes, pore_ellipses
from rhytid.synthesis.surface import Surface

entries = st.floats(-3, 3, allow_nan=False)
angles = st.floats(0, np.pi)


@st.composite
def slanted(draw: st.DrawFn) -> Surface:
    """Two triangles of a parallelogram in space, from a skewed, stretched layout."""
    a, b, c, d = (draw(entries) for _ in range(4))
    uv_axes = np.array([[2.0 + abs(a), b], [c, 1.0 + abs(d) + abs(b * c)]]) * 0.01
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
    positions = corners @ np.array([[1.0, 0.5, 0.2], [-0.3, 1.5, 0.7]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return Surface.of(Mesh(positions.astype(np.float32), faces, corners @ uv_axes + 0.5, faces))


@given(slanted(), angles)
def test_the_rim_of_a_line_is_its_width_away_on_the_surface(surface: Surface, angle: float) -> None:
    triangle, width = np.array([1]), np.array([0.07])
    theta = np.array([[np.cos(angle), np.sin(angle)]])
    half = half_widths_uv(surface, triangle, 0.3 * theta, width)
    rim = surface.along(triangle, half[:, None] * theta[:, ::-1] * [-1, 1])[0]
    line = surface.along(triangle, theta)[0]
    across = rim - line * (rim @ line) / (line @ line)
    assert np.linalg.norm(across) == pytest.approx(0.07, rel=1e-6)


@given(slanted(), angles, angles, st.floats(1, 3))
def test_the_rim_of_a_pore_is_its_ellipse_on_the_surface(
    surface: Surface, angle: float, axis: float, longer: float
) -> None:
    triangle, radius = np.array([0]), np.array([0.05])
    metric, circle = pore_ellipses(surface, triangle, radius, np.array([axis]), np.array([longer]))
    uu, uv, vv = metric[0]
    d = np.array([np.cos(angle), np.sin(angle)])
    d /= np.sqrt(uu * d[0] ** 2 + 2 * uv * d[0] * d[1] + vv * d[1] ** 2)
    rim = surface.along(triangle, d[None])[0]
    long, wide = 0.05 * np.sqrt(longer), 0.05 / np.sqrt(longer)
    along, across = (_along_axis(surface, a) for a in (axis, axis + np.pi / 2))
    assert np.hypot(rim @ along / long, rim @ across / wide) == pytest.approx(1.0, rel=1e-5)
    # The circle covers as much of the map as the ellipse.
    assert circle[0] ** 2 == pytest.approx(1 / np.sqrt(uu * vv - uv * uv), rel=1e-5)


def _along_axis(surface: Surface, angle: float) -> np.ndarray:
    """The direction in space that is `angle` from ∂X/∂u towards ∂X/∂v in the first triangle."""
    u, v = surface.jacobian[0].T
    first = u / np.linalg.norm(u)
    second = v - (v @ first) * first
    return np.cos(angle) * first + np.sin(angle) * second / np.linalg.norm(second)


@pytest.mark.slow
@given(slanted(), st.lists(angles, min_size=1, max_size=6))
def test_pores_are_long_along_the_lines_that_meet_at_them(
    surface: Surface, runs: list[float]
) -> None:
    """Lines from one pore to others, by angle on the surface; one line more leaves the map."""
    key = np.arange(400, dtype=np.uint32)
    triangle = np.zeros(len(key), int)
    goes = np.stack([_along_axis(surface, angle) for angle in runs])
    step = goes @ np.linalg.pinv(surface.jacobian[0]).T
    ends = np.array([[pore, (pore + 1) % len(key)] for pore in key for _ in runs])
    ends = np.concatenate([ends, [[0, len(key)]]])
    step = np.concatenate([np.tile(step, (len(key), 1)), [[0.0, 1.0]]])
    weight = np.full(len(ends), 0.5)
    weight[-1] = 1e6
    angle, longer = pore_axes(surface, triangle, ends, step, weight, key, 7)
    mean = np.exp(2j * np.array(runs)).mean()
    assert longer.min() >= 1
    assert np.median(longer) == pytest.approx(max(1 + ALONG * abs(mean), 1), abs=0.06)
    off = np.angle(np.exp(2j * (angle - 0.5 * np.angle(mean)))) / 2
    if abs(mean) > 1e-3:
        assert np.abs(np.median(off)) < np.radians(3)
        assert np.degrees(off.std()) == pytest.approx(12, rel=0.2)


def test_weights_rise_with_strength_and_stay_below_one() -> None:
    strength = np.concatenate([[1e-6], np.geomspace(0.01, 1e4, 50)])
    weight = edge_weights(strength, float(strength.mean()))
    assert (np.diff(weight) > 0).all()
    assert weight[0] > 0
    assert weight[-1] < 1


def test_a_line_counts_at_both_of_its_pores() -> None:
    """Twice its angle in the frame of each, by its weight; a line beyond a border at neither."""
    frames = np.array([[2.0, 0.5, 3.0], [1.0, 0.0, 1.0]])
    triangle, nodes = np.array([0, 1, 1]), np.array([[0, 1], [2, 1], [0, 3]])
    step, weight = np.array([[1.0, 2.0], [3.0, -1.0], [1.0, 1.0]]), np.array([0.5, 0.25, 1.0])
    wanted = np.zeros((3, 3))
    for line, ends in enumerate(nodes[:2]):
        for end in ends:
            a, b, d = frames[triangle[end]]
            angle = 2.0 * np.arctan2(d * step[line, 1], a * step[line, 0] + b * step[line, 1])
            wanted[:, end] += weight[line] * np.array([np.cos(angle), np.sin(angle), 1.0])
    found = shapes._axes_at_ends(frames, triangle, nodes, step, weight)
    np.testing.assert_allclose(found, wanted, rtol=1e-12, atol=1e-15)
