"""Sizes are meant on the surface: a drawn line is as wide there whatever way it runs in UV."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rhytid.domain.mesh import Mesh
from rhytid.synthesis.shapes import edge_weights, half_widths_uv, pore_ellipses
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


@given(slanted(), angles)
def test_the_rim_of_a_pore_is_its_radius_away_on_the_surface(
    surface: Surface, angle: float
) -> None:
    triangle, radius = np.array([0]), np.array([0.05])
    metric, circle = pore_ellipses(surface, triangle, radius)
    uu, uv, vv = metric[0]
    d = np.array([np.cos(angle), np.sin(angle)])
    d /= np.sqrt(uu * d[0] ** 2 + 2 * uv * d[0] * d[1] + vv * d[1] ** 2)
    assert np.linalg.norm(surface.along(triangle, d[None])) == pytest.approx(0.05, rel=1e-6)
    # The circle covers as much of the map as the ellipse.
    assert circle[0] ** 2 == pytest.approx(1 / np.sqrt(uu * vv - uv * uv), rel=1e-6)


def test_weights_rise_with_strength_and_stay_below_one() -> None:
    strength = np.concatenate([[1e-6], np.geomspace(0.01, 1e4, 50)])
    weight = edge_weights(strength, float(strength.mean()))
    assert (np.diff(weight) > 0).all()
    assert weight[0] > 0
    assert weight[-1] < 1
