"""The sums of fit.cl against differences of drawn heights, and what a fit brings back."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import uniform_filter

from reference import tracing as reference
from rhytid.domain.asset_settings import AssetSettings
from rhytid.synthesis.workspace import Workspace
from rhytid.tracing import fit
from rhytid.tracing.elements import TracedLines, TracedPores

SIDE = 256
STEP = 1e-5
DEPTH = np.float32(0.1)


def settings_of(**shape):
    data = {
        "unit": "mm",
        "resolution": SIDE,
        "depth": float(DEPTH),
        "shape": {"cushion": 0.0, **shape},
    }
    return AssetSettings.parse(data).resolved(0.5)


def one_line(slopes=(0.0, 0.0), half_width=(4.0, 6.0), weight=(0.3, 0.2)):
    return TracedLines(
        np.array([80.3, 104.6]), np.array([90.2, 99.7]), np.array(half_width), np.array(weight),
        np.array([[0, 1]]), np.array([slopes]), np.array([[-1, -1]]), np.array([0]),
    )  # fmt: skip


def no_pores():
    return TracedPores(*(np.zeros(0) for _ in range(4)), np.zeros((0, 3)))


def no_lines():
    none, two = np.zeros(0), np.zeros((0, 2))
    whole = np.zeros((0, 2), np.int64)
    return TracedLines(none, none, none, none, whole, two, whole, np.zeros(0, np.int64))


def places():
    y, x = np.mgrid[:SIDE, :SIDE].astype(np.float64)
    return x, y


def left_over(seed):
    rng = np.random.default_rng(seed)
    return rng.normal(0.0, 1.0, (SIDE, SIDE)).astype(np.float32)


def narrow(left):
    """What is left less its mean over 33 texels, twice."""
    once = uniform_filter(left.astype(np.float64), 33, mode="constant")
    return left - uniform_filter(once, 33, mode="constant")


def sums(height, values, left):
    """J r and J J of each value, by differences."""
    found = []
    for i in range(len(values)):
        changes = [np.where(np.arange(len(values)) == i, s * STEP, 0.0) for s in (1, -1)]
        change = (height(values + changes[0]) - height(values + changes[1])) / (2 * STEP)
        found += [(change * left).sum(), (change**2).sum()]
    return np.array(found)


@pytest.mark.parametrize("cushion", [0.0, 0.7])
@pytest.mark.parametrize("slopes", [(0.0, 0.0), (0.3, -0.2)])
@pytest.mark.parametrize("half_width", [(4.0, 6.0), (0.5, 2.0)])
def test_sums_of_a_wrinkle(device, cushion, slopes, half_width):
    settings, lines = settings_of(cushion=cushion), one_line(slopes, half_width)
    left, met = left_over(1), np.zeros((SIDE, SIDE), np.float32)
    with Workspace(device) as work:
        found, _ = fit.sums_of(work, lines, no_pores(), (DEPTH * left, -DEPTH * met), settings)
    extent = (lines.x[1] - lines.x[0], lines.y[1] - lines.y[0])
    segment = np.array([lines.x[0], lines.y[0], *extent])
    shape = (1.0, 0.7, cushion, settings.shape.cushion_width, 1.0)  # of weight 0.25: all there
    x, y = places()

    # Deeper than what it meets is nothing: the kernel's share of a change is that of the height
    # under others, so that here it is 1.
    def height(values):
        order = np.concatenate([values[2:], values[:2]])
        return reference.wrinkle_height(x, y, segment, order, np.array(slopes), shape)

    start = np.concatenate([lines.weight, np.log(lines.half_width)])
    wanted = sums(height, start, narrow(left))
    assert found[0] == pytest.approx(wanted, rel=2e-2, abs=2e-3 * np.abs(wanted).max())


def test_sums_of_a_pore(device):
    root = np.array([1.2, 0.3, 1 / 1.2])
    pores = TracedPores(
        np.array([70.3]), np.array([61.8]), np.array([0.4]), np.array([5.0]), root[None]
    )
    left, met = left_over(2), np.zeros((SIDE, SIDE), np.float32)
    with Workspace(device) as work:
        maps = DEPTH * left, -DEPTH * met
        _, found = fit.sums_of(work, no_lines(), pores, maps, settings_of())
    x, y = places()

    def height(values):
        centre, size = np.array([70.3, 61.8]), values[1]
        return values[0] * reference.pore_height(x, y, centre, root / 5.0, size)

    wanted = sums(height, np.array([0.4, 0.0]), narrow(left))
    assert found[0] == pytest.approx(wanted, rel=1e-3, abs=1e-3)


def test_what_lies_under_deeper_heights_changes_nothing(device):
    maps = DEPTH * left_over(3), np.full((SIDE, SIDE), -DEPTH, np.float32)
    with Workspace(device) as work:
        found, _ = fit.sums_of(work, one_line(), no_pores(), maps, settings_of())
    assert np.abs(found).max() < 1e-4


@pytest.mark.parametrize("cushion", [0.0, 0.7])
def test_a_fit_brings_back_weights_and_widths(device, cushion):
    settings = settings_of(cushion=cushion)
    true = one_line(half_width=(4.0, 4.0), weight=(0.5, 0.35))
    graph = fit.neutral_graph(true, no_pores(), settings)
    scan = fit.drawn_neutral(device, graph, settings, 1001)
    guess = one_line(half_width=(5.5, 3.0), weight=(0.3, 0.5))
    with Workspace(device) as work:
        everywhere = np.ones(scan.shape, np.bool_)
        found = fit.fitted(work, device, guess, no_pores(), scan, everywhere, settings, steps=25)
    assert found.left[-1] < 0.15 * found.left[0]
    assert found.lines.weight == pytest.approx(true.weight, rel=0.08)
    assert found.lines.half_width == pytest.approx(true.half_width, rel=0.12)


def fitted_by(device, monkeypatch, times):
    """What a fit makes of a line of weight .3 for a scan of one of .5, where the step that it is
    offered multiplies weights."""
    settings, start = settings_of(), one_line(weight=(0.3, 0.3))
    true = fit.neutral_graph(one_line(weight=(0.5, 0.5)), no_pores(), settings)
    scan = fit.drawn_neutral(device, true, settings, 1001)

    def step(work, lines, pores, maps, settings):
        return fit.changed(lines, times * lines.weight, lines.half_width), pores

    monkeypatch.setattr(fit, "_stepped", step)
    with Workspace(device) as work:
        everywhere = np.ones(scan.shape, np.bool_)
        return fit.fitted(work, device, start, no_pores(), scan, everywhere, settings, steps=1)


def test_a_step_that_leaves_more_is_not_taken(device, monkeypatch):
    found = fitted_by(device, monkeypatch, 0.9)
    assert found.left[1] == found.left[0]
    np.testing.assert_array_equal(found.lines.weight, [0.3, 0.3])


def test_a_fit_never_ends_worse_than_it_began(device, monkeypatch):
    """Also where maps that steps reckon with promise less than drawing leaves."""
    settings, line = settings_of(), one_line(weight=(0.3, 0.3))
    true = fit.neutral_graph(one_line(weight=(0.31, 0.31)), no_pores(), settings)
    scan = fit.drawn_neutral(device, true, settings, 1001)

    def promise(work, device, here, scan, inside, settings):
        lines = fit.changed(here.lines, 1.5 * here.lines.weight, here.lines.half_width)
        return fit._Place(lines, here.pores, here.drawn, 0.5 * here.apart)

    monkeypatch.setattr(fit, "_further", promise)
    with Workspace(device) as work:
        everywhere = np.ones(scan.shape, np.bool_)
        found = fit.fitted(work, device, line, no_pores(), scan, everywhere, settings, steps=2)
    np.testing.assert_array_equal(found.lines.weight, line.weight)


@pytest.mark.parametrize(("offered", "taken"), [(1.1, 0.3 * 1.16), (2.5, 0.5)])
def test_a_step_is_as_long_as_leaves_least(device, monkeypatch, offered, taken):
    """But 1.6 times what is offered at most."""
    found = fitted_by(device, monkeypatch, offered)
    assert found.left[1] < found.left[0]
    assert found.lines.weight == pytest.approx([taken, taken], rel=0.01)


def test_no_rest_has_a_larger_range_than_the_scan(device):
    """Of a line that is drawn too deep where the scan is highest; less is left even so."""
    settings = settings_of()
    line, deep = one_line(weight=(0.3, 0.3)), one_line(weight=(0.5, 0.5))
    scan = fit.drawn_neutral(device, fit.neutral_graph(line, no_pores(), settings), settings, 1001)
    scan[200:220, 200:220] -= 2 * DEPTH
    with Workspace(device) as work:
        everywhere = np.ones(scan.shape, np.bool_)
        found = fit.fitted(work, device, deep, no_pores(), scan, everywhere, settings, steps=0)
    graph = fit.neutral_graph(found.lines, no_pores(), settings)
    rest = scan - fit.drawn_neutral(device, graph, settings, 1001)
    assert found.left[0] < np.sqrt(np.mean(scan**2))
    assert np.ptp(rest) <= np.ptp(scan)
    assert found.lines.weight.max() > 0.2  # no shallower than needed


def test_what_is_outside_is_no_part_of_the_range(device):
    """A scan is rarely around 0, and the rest is 0 where there is no skin."""
    settings, line = settings_of(), one_line()
    scan = fit.drawn_neutral(device, fit.neutral_graph(line, no_pores(), settings), settings, 1001)
    inside = np.ones(scan.shape, np.bool_)
    inside[:, -32:] = False
    with Workspace(device) as work:
        scan += np.float32(1.0)
        found = fit.fitted(work, device, line, no_pores(), scan, inside, settings, steps=0)
    np.testing.assert_array_equal(found.lines.weight, line.weight)


def test_tiles_change_no_sums(device, monkeypatch):
    settings, maps = settings_of(), (left_over(4), np.zeros((SIDE, SIDE), np.float32))
    lines = one_line()
    with Workspace(device) as work:
        whole, _ = fit.sums_of(work, lines, no_pores(), maps, settings)
        monkeypatch.setattr(fit, "_TILE", 64)
        cut, _ = fit.sums_of(work, lines, no_pores(), maps, settings)
    assert cut == pytest.approx(whole, rel=1e-4, abs=1e-4)


def test_lines_that_leave_more_than_there_was_are_drawn_shallower(device):
    settings, deep = settings_of(), one_line(weight=(0.9, 0.9))
    graph = fit.neutral_graph(one_line(weight=(0.3, 0.3)), no_pores(), settings)
    scan = fit.drawn_neutral(device, graph, settings, 1001) + np.float32(4.0)
    everywhere = np.ones(scan.shape, np.bool_)
    with Workspace(device) as work:
        found = fit.fitted(work, device, deep, no_pores(), scan, everywhere, settings, steps=0)
    assert found.lines.weight == pytest.approx(np.full(len(deep.x), 0.3), rel=0.05)
