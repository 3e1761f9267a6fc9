"""Templates: lines where the charts are, arrows that point up, texels as large as they are."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh
from rhytid.pictures.uv_template import Charts, filled, guide, starter, template

SIZE = 200
# The corners of a square of two triangles, seen from +z, and the same in UV turned by 90°.
CORNERS = np.array([[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]], np.float32)
FACES = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
UPRIGHT = np.array([[0.25, 0.25], [0.75, 0.25], [0.75, 0.75], [0.25, 0.75]])
NEXT = UPRIGHT + np.array([1, 0])
CUT = np.array([[0, 1, 2], [4, 6, 7]])  # in UV the second triangle has corners of its own
TURNED = np.roll(UPRIGHT, 1, axis=0)  # up on the surface is -u


def charts(
    uv: NDArray[np.float64], udim: int = 1001, corners: NDArray[np.float32] = CORNERS
) -> Charts:
    return Charts.of(Mesh(corners, FACES, uv, FACES), udim, SIZE)


@pytest.mark.parametrize(
    ("uv", "up", "right"),
    [
        (UPRIGHT, (0, 1), (1, 0)),
        (TURNED, (1, 0), (0, -1)),
        (UPRIGHT * (-1, 1) + (1, 0), (0, 1), (-1, 0)),
    ],
)
def test_up_and_right_on_the_surface(
    uv: NDArray[np.float64], up: tuple[int, int], right: tuple[int, int]
) -> None:
    found = charts(uv)
    np.testing.assert_allclose(found.up, [up, up], atol=1e-9)
    np.testing.assert_allclose(found.right, [right, right], atol=1e-9)


def test_level_ground_has_no_arrow() -> None:
    lying = charts(UPRIGHT, corners=CORNERS[:, [0, 2, 1]])
    assert (lying.up == 0).all()
    assert (lying.right == 0).all()


def test_a_texel_is_as_large_as_it_is() -> None:
    np.testing.assert_allclose(charts(UPRIGHT).texels, 2 / (0.5 * SIZE))
    assert charts(UPRIGHT).usual == pytest.approx(0.02)


def test_a_chart_ends_at_edges_of_one_triangle() -> None:
    found = charts(UPRIGHT)
    assert len(found.wire) == 5
    assert len(found.border) == 4
    seam = Mesh(CORNERS, FACES, np.concatenate([UPRIGHT, UPRIGHT + 0.01]), CUT)
    assert len(Charts.of(seam, 1001, SIZE).border) == 6


def test_lines_lie_on_the_chart_and_nothing_beside_it() -> None:
    image = np.asarray(template(charts(UPRIGHT), SIZE))
    assert image.shape == (SIZE, SIZE, 4)
    ink = image[..., 3] > 0
    assert ink[50, 60:140].all()
    assert ink[60:140, 149].all()
    assert not ink[:45].any()
    assert not ink[:, 155:].any()
    red, green, blue, _ = image[50, 100]
    assert red > 180 > green > blue


def test_colours_lie_where_triangles_do() -> None:
    found = charts(UPRIGHT * (0.5, 1) + np.array([1, 0]), 1002)  # u from 0.125 to 0.375
    image = np.asarray(filled(found, np.array([[1.0, 0, 0], [0, 0, 1.0]]), SIZE))
    assert image[140, 70].tolist() == [255, 0, 0]  # the lower right triangle
    assert image[60, 30].tolist() == [0, 0, 255]
    assert image[100, 90].tolist() == [255, 255, 255]
    assert len(charts(UPRIGHT, 1002).uv) == 0


@pytest.mark.parametrize(("value", "code"), [(0.0, 0), (0.5, 32768), (1.0, 65535)])
def test_starters_are_grey_throughout(value: float, code: int) -> None:
    image = starter(value, 16)
    assert image.mode == "I;16"
    assert image.size == (16, 16)
    assert image.getextrema() == (code, code)


def test_the_guide_has_a_row_for_each_udim() -> None:
    one = guide({1001: charts(UPRIGHT)}, 0.02, 10.0, "one")
    two = guide({1001: charts(UPRIGHT), 1002: charts(NEXT, 1002)}, 0.02, 10.0, "two")
    assert two.width == one.width
    assert two.height > one.height + 600
