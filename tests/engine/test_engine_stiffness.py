"""Assets with a painted stiffness, and angles changed later: kept, told apart, cut bit for bit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from engine.engines import (
    BINNED,
    CONVOLVED,
    QUERIES,
    REDRAW,
    assembled,
    built,
    finish,
    maps,
    new_asset,
    running,
    same,
    settle,
)
from meshes import deform
from pipeline.scenes import sheet
from pipeline.stiff_scenes import painted
from rhytid.domain.painted_maps import Stiffness
from rhytid.domain.tiles import TileAddress
from rhytid.engine.messages import MapQuery
from rhytid.errors import InputError, NotFoundError, SettingsError
from rhytid.exports.skin_package.maps import SkinMaps
from rhytid.storage.records import StoredRequest
from rhytid.storage.store import AssetStore

MESH = sheet(udims=2)
BENT = deform(MESH.positions, 3, 0.15)
SMOOTH = tuple(MapQuery(method, sampling="smooth") for method in ("redraw", "binned"))
# Coarser than a tile, 1 in some tiles of 1001 and in all of 1011, nothing of 1002.
MAP = np.ones((4, 4), np.float32)
MAP[1:3, 1:3] = painted((2, 2)).maps[1001]
STIFFNESS = Stiffness({1001: MAP, 1011: np.ones((2, 2)), 1012: painted((5, 7)).maps[1001]})


def stiff(stiffness=STIFFNESS, **settings):
    return replace(new_asset(MESH, **settings), stiffness=stiffness)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """An engine with an asset that has a stiffness and one that has none, both bent."""
    with running(tmp_path_factory.mktemp("stiff")) as engine:
        ids = built(engine, stiff()), built(engine, stiff(None))
        for id in ids:
            engine.frames.put(id, "bent", BENT)
        yield engine, *ids


@pytest.mark.slow
def test_it_has_no_place_in_packages(made):
    engine, asset, plain = made
    with pytest.raises(SettingsError, match="the asset has a stiffness map"):
        SkinMaps.of(engine, asset)
    assert set(SkinMaps.of(engine, plain).bins.layers) == {"wrinkles", "pores"}
    with pytest.raises(NotFoundError, match="no cushions"):
        engine.tiles.cushion_lines(plain, 1001)


def test_it_acts_where_it_is_painted_alone(made):
    engine, asset, plain = made
    for query in (*QUERIES[1:], *SMOOTH):
        changed = {
            udim
            for udim in (1001, 1002, 1011, 1012)
            if not same(
                *(
                    [engine.tiles.plan_map(id, "bent", query, udim, 0).draw()]
                    for id in (asset, plain)
                )
            )
        }
        # What is drawn anew may reach over a border from a place that is painted.
        assert changed - ({1002} if query.method == "redraw" else set()) == {1001, 1012}, query


def test_the_neutral_is_the_same_bit_for_bit(made):
    engine, asset, plain = made
    assert same(*(maps(engine, id, "neutral") for id in (asset, plain)))


@pytest.mark.parametrize("query", [*QUERIES[1:], *SMOOTH], ids=str)
@pytest.mark.parametrize("level", [0, 1, 3, 8])
def test_tiles_put_together_are_the_map(made, query, level):
    engine, asset, _ = made
    for udim in (1001, 1012):
        whole = engine.tiles.plan_map(asset, "bent", query, udim, level).draw()
        assert np.isfinite(whole).all()
        assert same([whole], [assembled(engine, asset, "bent", query, udim, level)])


def test_maps_of_painted_udims_alone_are_larger(made):
    engine, *ids = made
    painted, plain = (
        engine._on_device.loaded(engine.assets._assets.get(id)).bins.size() for id in ids
    )
    assert painted - plain == len(STIFFNESS.maps) * 256**2 * np.dtype(np.float32).itemsize


@pytest.mark.slow
def test_it_is_part_of_the_id_and_survives_a_restart(tmp_path):
    other = Stiffness({**STIFFNESS.maps, 1001: 1.0 - MAP})
    with running(tmp_path) as engine:
        ids = [built(engine, stiff(k)) for k in (STIFFNESS, other, None)]
        assert len(set(ids)) == 3
        assert engine.assets.create(stiff()).id == ids[0]
        engine.frames.put(ids[0], "bent", BENT)
        before = maps(engine, ids[0], "bent")
    with running(tmp_path) as engine:
        settle(engine, ids[0])
        engine.frames.put(ids[0], "bent", BENT)
        assert same(before, maps(engine, ids[0], "bent"))


@pytest.mark.slow
def test_an_interrupted_build_goes_on_with_it(tmp_path):
    with running(tmp_path / "one") as engine:
        asset = built(engine, stiff())
        engine.frames.put(asset, "bent", BENT)
        wanted = maps(engine, asset, "bent")
    new = stiff()
    with AssetStore(tmp_path / "two") as store:
        store.put_request(asset, StoredRequest(new.mesh, new.settings, new.graph, new.stiffness))
    with running(tmp_path / "two") as engine:
        settle(engine, asset)
        engine.frames.put(asset, "bent", BENT)
        assert same(wanted, maps(engine, asset, "bent"))


@pytest.mark.slow
def test_a_change_of_response_keeps_it(tmp_path):
    with running(tmp_path) as engine:
        one, other = built(engine, stiff()), built(engine, stiff(response={"alpha_d": 2.0}))
        engine.assets.change(one, {"response": {"alpha_d": 2.0}})
        for id in (one, other):
            engine.frames.put(id, "bent", BENT)
        assert same(*(maps(engine, id, "bent") for id in (one, other)))


@pytest.mark.slow
def test_angles_can_change_and_change_what_is_drawn(tmp_path):
    with running(tmp_path) as engine:
        one, other = (built(engine, stiff(angles=angles)) for angles in ("uv", "surface"))
        for id in (one, other):
            engine.frames.put(id, "bent", BENT)
        address = TileAddress(1001, 0, 1, 1)
        before = maps(engine, one, "bent"), engine.tiles.plan(one, "bent", REDRAW, address).key
        assert engine.assets.change(one, {"angles": "surface"}).settings["angles"] == "surface"
        finish(engine, engine.assets.info(one).job)
        after = maps(engine, one, "bent"), engine.tiles.plan(one, "bent", REDRAW, address).key
        assert before[1] != after[1]
        assert same(after[0], maps(engine, other, "bent"))
        for query in (REDRAW, BINNED, *SMOOTH):
            found = engine.tiles.plan_map(one, "bent", query, 1001, 0).draw()
            assert same([found], [engine.tiles.plan_map(other, "bent", query, 1001, 0).draw()])
        count = len(engine.assets.info(one).udims)
        redrawn, binned, convolved = (slice(i * count, (i + 1) * count) for i in (1, 2, 3))
        for part in (redrawn, binned):
            assert not same(before[0][part], after[0][part])
        assert QUERIES[3] == CONVOLVED
        assert same(before[0][convolved], after[0][convolved])  # it has no angles


def test_a_udim_without_mesh_is_refused(tmp_path):
    with running(tmp_path) as engine:
        with pytest.raises(InputError, match="UDIM 1005, which has no mesh"):
            engine.assets.create(stiff(Stiffness({1005: MAP})))
        assert engine.assets.all() == []
