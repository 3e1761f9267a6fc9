"""Moments of slopes through the engine."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from engine.engines import BINNED, QUERIES, REDRAW, built, draw, maps, new_asset
from meshes import deform
from pipeline.scenes import sheet
from reference import slopes as reference
from rhytid.domain.methods import SLOPES
from rhytid.domain.tiles import MapAddress, TileAddress
from rhytid.engine import call_context
from rhytid.engine.device_assets.slopes import DeviceSlopes
from rhytid.engine.frames import Frame
from rhytid.engine.messages import MapQuery
from rhytid.engine.tiles.slopes import SlopeDrawing
from rhytid.errors import CancelledError, DeviceMemoryError
from rhytid.pipeline import slopes
from rhytid.pipeline.slopes import Band, SlopeChart, SlopeWork

UDIM = 1012


def slopes_of(query):
    return replace(query, layer=SLOPES)


@pytest.mark.parametrize("query", QUERIES, ids=lambda query: query.method)
def test_tiles_put_together_are_the_map(made, query):
    query = slopes_of(query)
    for level in (0, 1, 3):
        whole = made.engine.tiles.plan_map(made.asset, "bent", query, UDIM, level).draw()
        side = 256 >> level
        assert whole.shape == (side, side, 5)
        step = min(64, side)
        for row in range(side // step):
            tile = draw(made.engine, made.asset, "bent", query, TileAddress(UDIM, level, row, 0))
            np.testing.assert_array_equal(whole[row * step : (row + 1) * step, :step], tile)


@pytest.mark.slow
def test_moments_are_those_of_the_displacement_of_level_0(made):
    mesh = sheet(udims=2)
    positions = deform(mesh.positions, 3, 0.15)
    heights = made.engine.tiles.plan_map(made.asset, "bent", REDRAW, UDIM, 0).draw()
    triangles = made.engine.tiles.triangles(made.asset, UDIM)
    surface = reference.surface(positions, mesh.faces, mesh.uv - [1.0, 1.0], mesh.face_uv)
    slopes, inside = reference.slopes(heights.astype(np.float64), triangles, surface)

    found = made.engine.tiles.plan_map(made.asset, "bent", slopes_of(REDRAW), UDIM, 2).draw()

    wanted = reference.moments(slopes, inside, 2)
    assert np.abs(wanted).max() > 0.05
    np.testing.assert_allclose(found, wanted, atol=1e-5)


def test_given_heights_give_the_same(made):
    mesh = sheet(udims=2)
    positions = deform(mesh.positions, 3, 0.15)
    heights = made.engine.tiles.plan_map(made.asset, "bent", BINNED, UDIM, 0).draw()
    for level in (0, 3):
        whole = made.engine.tiles.plan_map(made.asset, "bent", slopes_of(BINNED), UDIM, level)
        place = MapAddress(UDIM, level)
        found, coverage = made.engine.tiles.slope_moments(
            made.asset, Frame.of(positions), BINNED, place, heights
        )
        np.testing.assert_array_equal(found, whole.draw())
        assert coverage.max() == 1.0


def test_the_neutral_method_has_the_surface_of_the_frame(made):
    query = slopes_of(QUERIES[0])
    keys = [
        made.engine.tiles.plan_map(made.asset, frame, query, UDIM, 1).key
        for frame in ("neutral", "bent")
    ]
    assert keys[0] != keys[1]


def test_displacement_stays_as_it_is(made):
    before = maps(made.engine, made.asset, "bent", 1)
    made.engine.tiles.plan_map(made.asset, "bent", slopes_of(REDRAW), UDIM, 1).draw()
    for one, other in zip(before, maps(made.engine, made.asset, "bent", 1), strict=True):
        np.testing.assert_array_equal(one, other)


def test_levels_are_made_by_one_caller_at_a_time(made, monkeypatch):
    begin, release, held, most = SlopeWork.__init__, SlopeWork.release, [], []

    def begun(self, *arguments):
        held.append(self)
        most.append(len(held))
        begin(self, *arguments)

    def released(self):
        held.remove(self)
        release(self)

    monkeypatch.setattr(SlopeWork, "__init__", begun)
    monkeypatch.setattr(SlopeWork, "release", released)
    queries = [slopes_of(MapQuery("redraw", model)) for model in ("tensor", "tension", "uv")]
    plans = [made.engine.tiles.plan_map(made.asset, "bent", q, 1001, 4) for q in queries]
    with ThreadPoolExecutor() as threads:
        list(threads.map(lambda plan: plan.draw(), plans))
    assert (len(most), max(most), held) == (3, 1, [])


def test_strips_and_short_memory_make_the_same(engine, monkeypatch):
    """Each strip is a task of its own; a piece that does not fit is drawn by `maps`."""
    asset = built(engine, new_asset())
    plan = engine.tiles.plan_map(asset, "neutral", slopes_of(REDRAW), 1001, 1)
    whole = plan.draw()
    depth = engine.assets.info(asset).settings["depth"]
    for one in (0.5 * depth, depth):
        engine.assets.change(asset, {"depth": one})  # which drops what is kept
    put, add, added = DeviceSlopes.put, DeviceSlopes.add, []

    def short(self, work, frame, query, udim, place):
        if place[0] >= 128:
            raise DeviceMemoryError("no memory")
        put(self, work, frame, query, udim, place)

    monkeypatch.setattr(slopes, "_AT_ONCE", 256 * 64)
    monkeypatch.setattr(DeviceSlopes, "put", short)
    monkeypatch.setattr(DeviceSlopes, "add", lambda *given: added.append(1) or add(*given))
    np.testing.assert_array_equal(plan.draw(), whole)
    assert len(added) == 4


def test_tiles_larger_than_a_launch_are_drawn_whole(engine, monkeypatch):
    asset = built(engine, new_asset(tile_size=256))
    plan = engine.tiles.plan_map(asset, "neutral", slopes_of(BINNED), 1001, 1)
    whole = plan.draw()
    depth = engine.assets.info(asset).settings["depth"]
    for one in (0.5 * depth, depth):
        engine.assets.change(asset, {"depth": one})
    monkeypatch.setattr(slopes, "_AT_ONCE", 256 * 64)
    np.testing.assert_array_equal(plan.draw(), whole)


def test_a_chart_may_be_dropped_while_strips_are_drawn(engine, monkeypatch):
    asset = built(engine, new_asset())
    monkeypatch.setattr(slopes, "_AT_ONCE", 256 * 64)
    plan = engine.tiles.plan_map(asset, "neutral", slopes_of(REDRAW), 1001, 1)
    whole = plan.draw()
    engine.assets.change(asset, {"depth": 0.02})
    plan = engine.tiles.plan_map(asset, "neutral", slopes_of(REDRAW), 1001, 1)
    put = DeviceSlopes.put

    def short(self, work, frame, query, udim, place):
        self._base.cache.discard("slope chart", udim)
        put(self, work, frame, query, udim, place)

    monkeypatch.setattr(DeviceSlopes, "put", short)
    assert plan.draw().shape == whole.shape


def test_a_band_stays_where_a_piece_fails(engine, monkeypatch):
    """What does not fit is drawn by `maps` into the band that was begun."""
    asset = built(engine, new_asset())
    plan = engine.tiles.plan_map(asset, "neutral", slopes_of(REDRAW), 1001, 1)
    bands, fails, put = [], [True], Band.put

    def short(self, device, part):
        bands.append(self)
        if fails:
            raise DeviceMemoryError(f"no memory: {fails.pop()}")
        assert not self.buffer.released
        put(self, device, part)

    monkeypatch.setattr(Band, "put", short)
    plan.draw()
    assert len(bands) > 1
    assert len({id(band) for band in bands}) == 1


def test_levels_stop_when_nobody_waits(engine, monkeypatch):
    asset = built(engine, new_asset())
    monkeypatch.setattr(slopes, "_AT_ONCE", 256 * 64)
    plan = engine.tiles.plan_map(asset, "neutral", slopes_of(REDRAW), 1001, 1)
    put, drawn = DeviceSlopes.put, []

    def counted(*given):
        drawn.append(1)
        put(*given)

    monkeypatch.setattr(DeviceSlopes, "put", counted)
    with call_context.abandoned_when(lambda: bool(drawn)), pytest.raises(CancelledError):
        plan.draw()
    assert len(drawn) == 1


def test_a_chart_is_made_in_steps_once_for_all_who_ask(engine, monkeypatch):
    asset = built(engine, new_asset())
    of, made = SlopeChart.of, []

    def slow(device, *given):
        made.append(device.steps)
        time.sleep(0.1)
        return of(device, *given)

    monkeypatch.setattr(SlopeChart, "of", slow)
    places = [TileAddress(1001, 0, 0, column) for column in range(4)]
    plans = [engine.tiles.plan(asset, "neutral", slopes_of(REDRAW), place) for place in places]
    with ThreadPoolExecutor() as threads:
        list(threads.map(lambda plan: plan.draw(), plans))
    assert len(made) == 1
    assert made[0] is not None


def test_nothing_is_kept_of_settings_that_changed_meanwhile(engine, monkeypatch):
    asset = built(engine, new_asset())
    fill, changes = SlopeDrawing._fill, [{"depth": 0.02}]

    def changed_after(*arguments):
        fill(*arguments)
        if changes:
            engine.assets.change(asset, changes.pop())

    monkeypatch.setattr(SlopeDrawing, "_fill", changed_after)
    plan = engine.tiles.plan_map(asset, "neutral", slopes_of(REDRAW), 1001, 2)
    found = plan.draw()

    engine.assets.change(asset, {"depth": 0.03})
    engine.assets.change(asset, {"depth": 0.02})
    np.testing.assert_array_equal(found, plan.draw())
