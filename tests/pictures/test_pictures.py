from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from rhytid.pictures.images import (
    NEUTRAL,
    axis_wheel,
    blur,
    diverging,
    downsample,
    signed_grey,
    to_picture,
)
from rhytid.pictures.relief import height_normals, relief, spline_samples
from rhytid.pictures.sheet import (
    GAP,
    MARGIN,
    STRIP,
    TITLE,
    Panel,
    axis_arrows,
    colour_bar,
    scale_bar,
    sheet,
    wheel_legend,
)


def ramp(across: float, up: float, side: int = 12) -> NDArray[np.float64]:
    """A plane that rises `across` a texel to the right and `up` a texel to the top."""
    row, column = np.mgrid[:side, :side]
    return across * column - up * row


def test_flat_relief_is_one_shade() -> None:
    picture = relief(np.full((9, 7), 0.3), 0.01)
    assert picture.shape == (9, 7, 3)
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) == 1


@pytest.mark.parametrize(("across", "up"), [(1, 0), (0, -1), (0.7, -0.7)])
def test_slope_that_faces_the_light_is_brighter(across: float, up: float) -> None:
    # The light comes from the upper left: it falls on slopes that rise to the right or down.
    towards, flat, away = (
        relief(ramp(s * across, s * up), 2.0).mean(dtype=np.float64) for s in (1, 0, -1)
    )
    assert towards > flat + 5
    assert away < flat - 5


def test_normals_know_the_spacing_of_each_axis_and_the_exaggeration() -> None:
    normals = height_normals(ramp(0.2, 0.6), (0.1, 0.3), exaggeration=0.5)
    expected = np.array([-1.0, -1.0, 1.0]) / np.sqrt(3)
    np.testing.assert_allclose(normals, np.broadcast_to(expected, normals.shape), atol=1e-12)


def test_diverging_is_neutral_at_zero_red_below_and_purple_above() -> None:
    np.testing.assert_allclose(diverging(0.0, 0.3), NEUTRAL)
    red, purple = diverging(-0.2, 0.3), diverging(0.2, 0.3)
    assert red[0] > 2 * max(red[1], red[2])
    assert purple[2] > purple[0] > 1.3 * purple[1]
    np.testing.assert_array_equal(diverging([-9.0, 9.0], 0.3), diverging([-0.3, 0.3], 0.3))


@given(angle=st.floats(-10, 10), turns=st.integers(-4, 4))
def test_axis_colours_repeat_after_half_a_turn(angle: float, turns: int) -> None:
    np.testing.assert_allclose(
        axis_wheel(angle), axis_wheel(angle + turns * np.pi), rtol=0, atol=1e-12
    )


def test_axis_colours_differ_within_half_a_turn_and_fade_without_an_axis() -> None:
    colours = axis_wheel(np.arange(12) * np.pi / 12)
    assert colours.min() >= 0
    assert colours.max() <= 1
    apart = np.linalg.norm(colours[:, None] - colours[None], axis=-1)[~np.eye(12, dtype=bool)]
    assert apart.min() > 0.15
    np.testing.assert_allclose(axis_wheel(1.0, 0.0), NEUTRAL)


def test_signed_grey_is_mid_grey_at_zero_and_clipped() -> None:
    np.testing.assert_allclose(signed_grey([-2.0, 0.0, 1.0], 1.0)[:, 0], [0.0, 0.5, 1.0])


@given(st.tuples(*[st.floats(-2, 2)] * 3), st.floats(3, 8), st.floats(3, 8))
def test_spline_reproduces_planes(
    plane: tuple[float, float, float], row: float, column: float
) -> None:
    y, x = np.mgrid[:12, :12]
    values = plane[0] + plane[1] * y + plane[2] * x
    sampled = spline_samples(values, np.array([row]), np.array([column]))
    assert sampled[0] == pytest.approx(plane[0] + plane[1] * row + plane[2] * column, abs=1e-12)


def test_blur_keeps_constants_and_spreads_by_sigma() -> None:
    np.testing.assert_allclose(blur(np.full((20, 30), 2.5), 3.0), 2.5)
    point = np.zeros((101, 101))
    point[50, 50] = 1
    spread = blur(point, np.sqrt(30))
    offset = np.arange(101) - 50
    assert spread.sum() == pytest.approx(1)
    assert np.sqrt(np.sum(spread.sum(axis=0) * offset**2)) == pytest.approx(np.sqrt(30))


def test_downsample_takes_means() -> None:
    np.testing.assert_array_equal(downsample(np.arange(16.0).reshape(4, 4), 2)[0], [2.5, 4.5])


def test_grey_becomes_rgb_and_is_clipped() -> None:
    np.testing.assert_array_equal(to_picture(np.array([[-1.0, 2.0]])), [[[0] * 3, [255] * 3]])


def test_legends_are_strips_of_the_asked_width() -> None:
    ticks = [(-1.0, "low"), (1.0, "high")]
    bar = colour_bar(300, -1.0, 1.0, lambda v: diverging(v, 1.0), ticks)
    assert bar.shape == (STRIP, 300, 3)
    np.testing.assert_array_equal(bar[8, 45], to_picture(diverging([[-1.0]], 1.0))[0, 0])
    assert wheel_legend(260, "direction").shape == (STRIP, 260, 3)


def test_marks_are_drawn_on_a_copy() -> None:
    picture = np.full((120, 120, 3), 128, np.uint8)
    marked = axis_arrows(scale_bar(picture, 40, "2 mm"), 0.0, True, "to 1.20")
    assert (picture == 128).all()
    assert (marked[44, 120 - 44 + 10 : 120 - 44 + 30] < 60).all(axis=-1).any()
    assert (marked[120 - 14, 14:54] < 60).all()


def test_sheet_has_the_size_of_its_rows_and_caption() -> None:
    def panel(height: int, width: int) -> Panel:
        return Panel("title", np.zeros((height, width, 3), np.uint8))

    rows = [[panel(50, 200), panel(80, 300)], [panel(60, 400)]]
    page = sheet(rows, "")
    assert page.size == (2 * MARGIN + 500 + GAP, 2 * MARGIN + 2 * (TITLE + GAP) + 80 + 60)
    longer = sheet(rows, "one line\n" + "many words " * 40)
    assert longer.width == page.width
    assert longer.height > page.height + 100
    assert page.getpixel((MARGIN + 1, MARGIN + TITLE + 1)) == (0, 0, 0)
