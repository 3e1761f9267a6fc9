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
from rhytid.domain.tiles import MapAddress, TileAddress
from rhytid.engine.device_assets.slopes import DeviceSlopes
from rhytid.engine.frames import Frame
from rhytid.engine.messages import SLOPES, MapQuery
from rhytid.engine.tiles.maps import MapDrawing
from rhytid.exports.textures.slope_terms import slope_terms
from rhytid.exports.textures.tangents import Posed

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
    terms = slope_terms(mesh, Posed.of(mesh, positions), 256)
    for level in (0, 3):
        whole = made.engine.tiles.plan_map(made.asset, "bent", slopes_of(BINNED), UDIM, level)
        place = MapAddress(UDIM, level)
        found, coverage = made.engine.tiles.slope_moments(
            made.asset, Frame.of(positions), BINNED, place, heights, terms
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


def test_one_whole_level_0_is_in_memory_at_a_time(made, monkeypatch):
    shared, held, most = MapDrawing.shared, [], []
    whole = (0, 0, 256)

    def counted(self, *arguments):
        if arguments[-1] == whole:
            held.append(0)
            most.append(len(held))
            time.sleep(0.05)
        found = shared(self, *arguments)
        held[:] = held[1:] if arguments[-1] == whole else held
        return found

    monkeypatch.setattr(MapDrawing, "shared", counted)
    queries = [slopes_of(MapQuery("redraw", model)) for model in ("tensor", "tension", "uv")]
    plans = [made.engine.tiles.plan_map(made.asset, "bent", q, 1001, 4) for q in queries]
    with ThreadPoolExecutor() as threads:
        list(threads.map(lambda plan: plan.draw(), plans))
    assert (len(most), max(most)) == (3, 1)


def test_a_chart_is_made_once_for_all_who_ask(engine, monkeypatch):
    asset = built(engine, new_asset())
    codes, made = DeviceSlopes.codes, []
    monkeypatch.setattr(
        DeviceSlopes, "codes", lambda *given: made.append(1) or time.sleep(0.1) or codes(*given)
    )
    places = [TileAddress(1001, 0, 0, column) for column in range(4)]
    plans = [engine.tiles.plan(asset, "neutral", slopes_of(REDRAW), place) for place in places]
    with ThreadPoolExecutor() as threads:
        list(threads.map(lambda plan: plan.draw(), plans))
    assert len(made) == 1


def test_nothing_is_kept_of_settings_that_changed_meanwhile(engine, monkeypatch):
    asset = built(engine, new_asset())
    shared, changes = MapDrawing.shared, [{"depth": 0.02}]

    def changed_after(*arguments):
        heights = shared(*arguments)
        if changes:
            engine.assets.change(asset, changes.pop())
        return heights

    monkeypatch.setattr(MapDrawing, "shared", changed_after)
    plan = engine.tiles.plan_map(asset, "neutral", slopes_of(REDRAW), 1001, 2)
    found = plan.draw()

    engine.assets.change(asset, {"depth": 0.03})
    engine.assets.change(asset, {"depth": 0.02})
    np.testing.assert_array_equal(found, plan.draw())
