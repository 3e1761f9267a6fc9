"""Wavy wrinkles through the engine: the laws that hold bit for bit, and changing the waves."""

from __future__ import annotations

import pytest

from engine.engines import (
    CONVOLVED,
    QUERIES,
    assembled,
    built,
    maps,
    new_asset,
    running,
    same,
    settle,
)
from meshes import deform
from pipeline.scenes import sheet
from rhytid.domain.tiles import TileAddress
from rhytid.errors import SettingsError

MESH = sheet(udims=2)
BENT = deform(MESH.positions, 3, 0.15)
WAVES = {"wave_amplitude": 0.1, "wave_frequency": 3.0}


def wavy(engine, **changes):
    asset = built(engine, new_asset(MESH, shape={**WAVES, **changes}))
    engine.frames.put(asset, "bent", BENT)
    return asset


@pytest.mark.parametrize("query", QUERIES, ids=lambda query: query.method)
def test_tiles_put_together_are_the_map(engine, query):
    asset = wavy(engine)
    for udim in (1001, 1012):
        for level in (0, 1, 4, 8):
            whole = engine.tiles.plan_map(asset, "bent", query, udim, level).draw()
            assert same([whole], [assembled(engine, asset, "bent", query, udim, level)])


def test_redraw_and_convolved_of_neutral_are_neutral(engine):
    asset = wavy(engine)
    neutral = engine.tiles.plan_map(asset, "neutral", QUERIES[0], 1001, 0).draw()
    for query in (QUERIES[1], CONVOLVED):
        assert same([neutral], [engine.tiles.plan_map(asset, "neutral", query, 1001, 0).draw()])


@pytest.mark.slow
def test_changing_waves_is_making_them_and_changing_back_is_never_having_had_them(engine):
    straight = built(engine, new_asset(MESH))
    engine.frames.put(straight, "bent", BENT)
    before = maps(engine, straight, "bent")
    address = TileAddress(1001, 0, 1, 1)
    key = engine.tiles.plan(straight, "bent", QUERIES[1], address).key
    made = maps(engine, wavy(engine), "bent")
    engine.assets.change(straight, {"shape": WAVES})
    assert engine.tiles.plan(straight, "bent", QUERIES[1], address).key != key
    assert same(maps(engine, straight, "bent"), made)
    assert not same(before, made)
    engine.assets.change(straight, {"shape": {"wave_frequency": 7.0}})
    assert not same(maps(engine, straight, "bent"), made)
    engine.assets.change(straight, {"shape": {"wave_amplitude": 0.0}})
    assert same(maps(engine, straight, "bent"), before)


def test_the_frequency_is_resolved_from_the_spacing(engine):
    asset = wavy(engine, wave_frequency=None)
    found = engine.assets.info(asset).settings["shape"]["wave_frequency"]
    assert found > 0
    engine.assets.change(asset, {"shape": {"wave_frequency": 2.0}})
    changed = engine.assets.change(asset, {"shape": {"wave_frequency": None}})
    assert changed.settings["shape"]["wave_frequency"] == found


def test_waves_survive_a_restart(tmp_path):
    with running(tmp_path) as engine:
        asset = built(engine, new_asset(MESH))
        engine.assets.change(asset, {"shape": WAVES})
        before = engine.tiles.plan_map(asset, "neutral", QUERIES[0], 1001, 0).draw()
    with running(tmp_path) as engine:
        settle(engine, asset)
        assert same([engine.tiles.plan_map(asset, "neutral", QUERIES[0], 1001, 0).draw()], [before])


def test_bad_waves_are_refused_by_name(engine):
    asset = built(engine, new_asset(MESH))
    for bad in (-0.1, "wide", 1e31):
        with pytest.raises(SettingsError, match=r"shape\.wave_amplitude"):
            engine.assets.change(asset, {"shape": {"wave_amplitude": bad}})


@pytest.mark.slow
@pytest.mark.parametrize("amplitude", [1e-30, 1e3, 1e30])
def test_the_largest_amplitude_is_a_share_of_the_wrinkle(engine, amplitude):
    found = engine.tiles.plan_map(
        wavy(engine, wave_amplitude=amplitude), "bent", QUERIES[1], 1001, 0
    ).draw()
    limit = engine.tiles.plan_map(
        wavy(engine, wave_amplitude=1e4), "bent", QUERIES[1], 1001, 0
    ).draw()
    assert same([found], [limit]) == (amplitude > 1)
