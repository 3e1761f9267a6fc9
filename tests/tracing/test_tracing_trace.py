"""Whole scans: what is traced of them, at rest and at seams, and how tracing stops."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from meshes import bumpy_grid
from reference import tracing as reference
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.mesh import Mesh
from rhytid.errors import CancelledError, InputError
from rhytid.support import cancellation
from rhytid.synthesis.surface import Surface
from rhytid.tracing.elements import TracedLines, TracedPores
from rhytid.tracing.fit import drawn_neutral, neutral_graph
from rhytid.tracing.trace import TraceSettings, trace, traced_settings
from synthesis.seam_places import seam_places
from synthesis.sheets import sheet

SIDE, DEPTH = 256, 0.1
LINES = np.array(
    [[50.0, 60.0, 200.0, 90.0], [60.0, 200.0, 190.0, 110.0], [45.0, 120.0, 120.0, 140.0]]
)
PORES = np.array([[150.0, 60.0], [80.0, 90.0], [170.0, 190.0]])


def settings_of(resolution=SIDE, **shape):
    data = {"unit": "mm", "resolution": resolution, "depth": DEPTH, "preset": "paper"}
    return AssetSettings.parse({**data, "shape": shape}).resolved(0.5)


def scan():
    """Three lines and three pores; 0 outside of the chart."""
    lines = reference.relief_of_lines(SIDE, LINES, 3.0, 0.5 * DEPTH, 2.5)
    return (lines + reference.relief_of_pores(SIDE, PORES, 5.0, 0.4 * DEPTH)).astype(np.float32)


def rms(values):
    return float(np.sqrt(np.mean(np.asarray(values, np.float64) ** 2)))


@pytest.fixture(scope="module")
def traced(device):
    return trace(device, sheet(), {1001: scan()}, settings_of(), TraceSettings(steps=20))


def test_graph_and_residual_are_the_scan(device, traced):
    drawn = drawn_neutral(device, traced.graph, traced_settings(settings_of()), 1001)
    assert np.abs(drawn + traced.residual[1001] - scan()).max() < 1e-6 * DEPTH


def test_little_of_lines_and_pores_is_left(traced):
    assert rms(traced.residual[1001]) < 0.25 * rms(scan())
    assert traced.left[1001][-1] < 0.6 * traced.left[1001][0]


def test_lines_lie_where_they_were(traced):
    graph = traced.graph
    ends = graph.node_uv.astype(np.float64)[graph.edge_nodes] * SIDE - 0.5
    ends[..., 1] = SIDE - 1 - ends[..., 1]
    middle, strong = ends.mean(axis=1), graph.edge_weight > 0.2
    apart = np.full(len(middle), np.inf)
    for x0, y0, x1, y1 in LINES:
        e = np.array([x1 - x0, y1 - y0])
        step = middle - [x0, y0]
        s = np.clip(step @ e / (e @ e), 0, 1)
        apart = np.minimum(apart, np.linalg.norm(step - s[:, None] * e, axis=1))
    assert apart[strong].max() < 1.5
    assert np.median(apart[strong]) < 0.15
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)[strong].sum()
    whole = np.linalg.norm(LINES[:, 2:] - LINES[:, :2], axis=1).sum()
    assert length == pytest.approx(whole, rel=0.12)
    inner = strong & (apart < 0.5)
    assert np.median(graph.edge_weight[inner]) == pytest.approx(0.5, rel=0.15)
    assert np.median(graph.edge_half_width[inner]) * SIDE == pytest.approx(3.0, rel=0.15)


def test_pores_lie_where_they_were(traced):
    graph = traced.graph
    strong = graph.pore_weight > 0.15
    place = graph.node_uv[strong].astype(np.float64) * SIDE - 0.5
    place[:, 1] = SIDE - 1 - place[:, 1]
    away = np.linalg.norm(PORES[:, None] - place, axis=-1).min(axis=1)
    assert away.max() < 0.7


def test_the_same_scan_gives_the_same_graph_bit_for_bit(device, traced):
    again = trace(device, sheet(), {1001: scan()}, settings_of(), TraceSettings(steps=20, tile=64))
    for name, array in traced.graph.arrays().items():
        assert (array == getattr(again.graph, name)).all(), name
    assert (again.residual[1001] == traced.residual[1001]).all()


def test_noise_stays_in_the_residual(device):
    noise = np.random.default_rng(1).normal(0, 0.02 * DEPTH, (SIDE, SIDE)).astype(np.float32)
    clean, noisy = (
        trace(device, sheet(), {1001: relief}, settings_of(), TraceSettings(steps=4))
        for relief in (noise, noise + scan())
    )
    assert clean.graph.edge_weight.sum() < 2.0
    assert noisy.noise[1001] == pytest.approx(0.02 * DEPTH, rel=0.3)
    strong = noisy.graph.edge_weight > 0.2
    length = np.linalg.norm(np.diff(noisy.graph.node_uv[noisy.graph.edge_nodes], axis=1), axis=-1)
    whole = np.linalg.norm(LINES[:, 2:] - LINES[:, :2], axis=1).sum()
    assert length[strong].sum() * SIDE == pytest.approx(whole, rel=0.2)


def test_terraces_of_coarse_codes_are_no_lines(device):
    """Rounding of gentle swells cannot be measured from texel to texel."""
    step = 0.1 * DEPTH
    y, x = np.mgrid[:SIDE, :SIDE]
    swells = 3 * DEPTH * np.sin(x / 40.0) * np.sin(y / 50.0)
    coarse = (np.round(swells / step) * step).astype(np.float32)
    known, unknown = (
        trace(device, sheet(), {1001: coarse}, settings_of(), TraceSettings(steps=2, noise=noise))
        for noise in (step / 12**0.5, 0.0)
    )
    assert known.noise[1001] == pytest.approx(step / 12**0.5)
    assert known.graph.edge_weight.sum() < 0.3 * unknown.graph.edge_weight.sum()
    assert unknown.graph.wrinkles > 30


def test_a_flat_scan_is_an_empty_graph(device):
    flat = np.zeros((SIDE, SIDE), np.float32)
    found = trace(device, sheet(), {1001: flat}, settings_of(), TraceSettings(steps=2))
    assert (found.graph.wrinkles, found.graph.pores) == (0, 0)
    assert not found.residual[1001].any()


def test_what_lies_beyond_the_chart_is_no_line(device):
    """The charts of the sheet end at 0.1 and 0.9; the map steps there."""
    relief = np.full((SIDE, SIDE), -DEPTH, np.float32)
    inner = slice(26, 230)
    relief[inner, inner] = 0.0
    found = trace(device, sheet(), {1001: relief}, settings_of(), TraceSettings(steps=1))
    assert found.graph.wrinkles == 0


def position_map(mesh: Mesh, side: int):
    """(side, side, 3) the place on the surface of each texel; NaN outside of charts."""
    found = np.full((side, side, 3), np.nan)
    x, y = (np.arange(side) + 0.5) / side, 1 - (np.arange(side) + 0.5) / side
    for corners, at in zip(mesh.triangle_uv(), mesh.positions[mesh.faces], strict=True):
        low, high = corners.min(axis=0) - 1 / side, corners.max(axis=0) + 1 / side
        columns, rows = (
            np.flatnonzero((low[i] < axis) & (axis < high[i])) for i, axis in enumerate((x, y))
        )
        around = np.ix_(rows, columns)
        uv = np.stack(np.meshgrid(x[columns], y[rows]), axis=-1)
        edges = np.linalg.inv((corners[1:] - corners[0]).T)
        share = (uv - corners[0]) @ edges.T
        inside = (share > -1e-9).all(axis=-1) & (share.sum(axis=-1) < 1 + 1e-9)
        place = at[0] + share @ (at[1:] - at[0])
        found[around] = np.where(inside[..., None], place, found[around])
    return found


def test_both_sides_of_a_seam_are_alike(device):
    """Lines in space that cross the seam of a bumpy sheet, drawn again from what was traced."""
    mesh, side = Mesh(*bumpy_grid()), 512
    place = position_map(mesh, side)
    away = np.abs((place[..., 1] + 0.3 * place[..., 0] + 0.83) % 0.4 - 0.2)
    relief = -0.5 * DEPTH * reference.line_profile(away / 0.03, 2.5)
    relief = np.where(np.isnan(relief), 0.0, relief).astype(np.float32)
    settings = settings_of(side)
    how, seen = TraceSettings(spacing=0.1, steps=6), []
    found = trace(device, mesh, {1001: relief}, settings, how, lambda f, s: seen.append((s, f)))
    assert len({share for stage, share in seen if stage == "seams"}) > 1
    assert (found.graph.edge_copy_of >= 0).any()
    drawn = drawn_neutral(device, found.graph, traced_settings(settings), 1001)
    places = seam_places(mesh, Surface.of(mesh).carries, 0.01, 0.3)
    here, there = (sampled(drawn, uv) for uv in (places.here, places.there))
    assert rms(here) > 0.1 * DEPTH * 0.5
    assert rms(here - there) < 0.12 * rms(here)


def sampled(heights, uv):
    """Heights at texture coordinates (P, 2), linear between texels."""
    side = len(heights)
    x, y = uv[:, 0] * side - 0.5, (1 - uv[:, 1]) * side - 0.5
    column, row = np.floor(x).astype(int), np.floor(y).astype(int)
    a, b = x - column, y - row
    top, bottom = (
        (1 - a) * heights[row + i, column] + a * heights[row + i, column + 1] for i in (0, 1)
    )
    return (1 - b) * top + b * bottom


@pytest.mark.parametrize("after", [0, 5, 20, 60])
def test_tracing_stops_where_it_is_cancelled(device, after):
    asked = 0

    def check():
        nonlocal asked
        asked += 1
        if asked > after:
            raise CancelledError("enough")

    used = device.budget.used
    with cancellation.scope(check), pytest.raises(CancelledError):
        trace(device, sheet(), {1001: scan()}, settings_of(), TraceSettings(steps=5))
    assert device.budget.used == used


def test_progress_rises_to_one(device):
    seen = []
    how = TraceSettings(steps=2)
    trace(device, sheet(), {1001: scan()}, settings_of(), how, lambda f, s: seen.append((f, s)))
    shares = [share for share, _ in seen]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert {"lines", "fit", "seams", "residual"} <= {stage for _, stage in seen}


def test_wrong_scans_are_refused(device):
    settings = settings_of()
    with pytest.raises(InputError, match="UDIM 1001 has 64 by 256 texels: must be 256 by 256"):
        trace(device, sheet(), {1001: scan()[:64]}, settings)
    broken = scan()
    broken[7, 9] = np.nan
    with pytest.raises(InputError, match="not finite at row 7, column 9"):
        trace(device, sheet(), {1001: broken}, settings)
    with pytest.raises(InputError, match="no scan"):
        trace(device, sheet(), {}, settings)


def test_a_traced_graph_has_the_lengths_and_the_mesh(traced):
    origin = traced.graph.origin
    assert origin.depth == DEPTH
    assert origin.unit == "mm"
    origin.check_mesh(sheet())
    assert replace(traced.graph, origin=None).counts() == traced.graph.counts()


def test_faint_lines_on_the_slopes_of_deep_ones_are_found(device):
    """Of lines with broad layers, which hide the valleys of their neighbours."""
    settings = traced_settings(settings_of(cushion=0.7))
    rows = np.array([60.0, 67.0, 130.3, 137.3, 200.0])
    weight = np.array([0.8, 0.2, 0.8, 0.2, 0.2])
    ends = np.arange(10).reshape(5, 2)
    x, y = np.tile([40.0, 215.0], 5), np.repeat(rows, 2)
    none, slopes = np.full((5, 2), -1), np.zeros((5, 2))
    two = np.repeat(weight, 2)
    lines = TracedLines(x, y, np.full(10, 2.5), two, ends, slopes, none, np.arange(5))
    pores = TracedPores(*np.zeros((4, 0)), np.zeros((0, 3)))
    relief = drawn_neutral(device, neutral_graph(lines, pores, settings), settings, 1001)
    graph = trace(device, sheet(), {1001: relief}, settings, TraceSettings(steps=2)).graph
    ends = graph.node_uv.astype(np.float64)[graph.edge_nodes] * SIDE - 0.5
    length, row = np.abs(np.diff(ends[..., 0], axis=1))[:, 0], SIDE - 1 - ends[..., 1].mean(axis=1)
    found = [length[np.abs(row - here) < 1.0].sum() for here in rows]
    assert min(found) > 0.8 * 175.0


def test_lines_bend_and_change_along_their_way_whatever_the_preset_says():
    paper, own = settings_of(), settings_of(curvature=0.5, taper=0.25)
    assert (paper.shape.curvature, paper.shape.taper) == (0.0, 0.0)
    drawn = [traced_settings(settings).shape for settings in (paper, own)]
    assert [(shape.curvature, shape.taper) for shape in drawn] == [(1.0, 1.0), (0.5, 0.25)]
