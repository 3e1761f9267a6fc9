"""Assets that come to the device when they are used, and leave it when memory is short."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

import pytest

from engine.engines import BINNED, REDRAW, built, draw, maps, new_asset, rest, running, same
from meshes import deform
from pipeline.scenes import sheet
from rhytid.domain.tiles import TileAddress
from rhytid.engine.device_assets.levels import DeviceLevels
from rhytid.errors import ConflictError, DeviceMemoryError, NotFoundError

ADDRESS = TileAddress(1001, 0, 0, 0)
BENT = deform(sheet().positions, 3, 0.15)
COUNT = 6


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    """A store of six assets, one tile of each, and the bytes that one has on the device."""
    store = tmp_path_factory.mktemp("stored")
    with running(store) as engine:
        assets = [built(engine, new_asset(seed=seed)) for seed in range(COUNT)]
        tiles = [drawn(engine, asset) for asset in assets]
        only = used(engine)
    with running(store) as engine:
        assert used(engine) == 0  # nothing is loaded at start
        drawn(engine, assets[0])
        one = used(engine)
    assert only > COUNT * one / 2
    return store, assets, tiles, one


def used(engine):
    return next(info.used for info in engine.devices() if info.selected)


def drawn(engine, asset):
    return engine.tiles.plan(asset, "neutral", REDRAW, ADDRESS).draw()


def test_more_assets_than_memory_are_all_ready_and_drawn(stored):
    store, assets, tiles, one = stored
    budget = round(2.5 * one)
    with running(store, device_memory=budget) as engine:
        assert {info.state for info in engine.assets.all()} == {"ready"}
        for _ in range(2):
            assert same([drawn(engine, asset) for asset in assets], tiles)
            assert used(engine) <= budget


def test_assets_that_drive_each_other_out_are_drawn_at_the_same_time(stored):
    store, assets, tiles, one = stored
    with running(store, device_memory=round(2.5 * one)) as engine:
        with ThreadPoolExecutor(COUNT) as pool:
            found = list(pool.map(lambda asset: drawn(engine, asset), assets * 3))
        assert same(found, tiles * 3)


def test_an_asset_larger_than_memory_is_refused_and_still_there(stored):
    store, assets, tiles, one = stored
    with running(store, device_memory=one // 4) as engine:
        with pytest.raises(DeviceMemoryError):
            drawn(engine, assets[0])
        assert engine.assets.info(assets[0]).state == "ready"
        assert engine.assets.graph(assets[0]).wrinkles > 0
        engine._device.budget.limit = 4 * one
        assert same([drawn(engine, assets[0])], tiles[:1])


def test_a_map_is_whole_though_its_asset_leaves_the_device(stored, monkeypatch):
    store, assets, _, _ = stored
    with running(store) as engine:
        plan = engine.tiles.plan_map(assets[0], "neutral", BINNED, 1001, 0)
        wanted, squares, calls = plan.draw(), DeviceLevels.squares, []
        engine._on_device.drop(engine.assets._assets.get(assets[0]))

        def leaving(resident, *about):
            calls.append(resident)
            found = squares(resident, *about)
            if len(calls) == 1:
                engine._device.budget.new_task()  # out of the hands of this task
                engine._device.budget.drop(lambda key: key[0] == "asset")
            return found

        monkeypatch.setattr("rhytid.engine.device_assets.levels._PIECE", dict.fromkeys(
            ("neutral", "redraw", "binned", "convolved"), 64))  # fmt: skip
        monkeypatch.setattr(DeviceLevels, "squares", leaving)
        assert same([plan.draw()], [wanted])
        assert len({id(resident) for resident in calls}) == 2


def test_a_change_of_an_asset_that_is_not_on_the_device(stored, tmp_path):
    with running(tmp_path) as engine:
        asset = built(engine, new_asset(seed=1))
        before = maps(engine, asset, "neutral")
    with running(tmp_path) as engine:
        engine.assets.change(asset, {"response": {"alpha_w": 2.0}})
        engine.frames.put(asset, "bent", BENT)
        found = engine.tiles.plan(asset, "bent", REDRAW, ADDRESS).draw()
        other = built(engine, new_asset(seed=1, response={"alpha_w": 2.0}))
        engine.frames.put(other, "bent", BENT)
        assert same([found], [engine.tiles.plan(other, "bent", REDRAW, ADDRESS).draw()])
        assert same(maps(engine, asset, "neutral")[1:2], before[1:2])


def test_files_that_are_damaged_after_the_start_fail_the_asset_alone(tmp_path):
    with running(tmp_path) as engine:
        asset, other = (built(engine, new_asset(seed=seed)) for seed in (1, 2))
    with running(tmp_path) as engine:
        path = tmp_path / "assets" / asset / "asset" / "graph.safetensors"
        path.write_bytes(path.read_bytes()[:-1] + b"?")
        with pytest.raises(Exception, match="graph"):
            drawn(engine, asset)
        with pytest.raises(ConflictError, match="send it again"):
            drawn(engine, asset)
        assert drawn(engine, other).any()
        assert built(engine, new_asset(seed=1)) == asset
        assert drawn(engine, asset).any()


def test_changes_beside_removals_leave_nothing_behind(tmp_path):
    with running(tmp_path) as engine:
        for seed in range(5):
            asset = built(engine, new_asset(seed=seed))
            start = threading.Barrier(3)

            def change(asset=asset, start=start):
                start.wait()
                with suppress(NotFoundError):
                    for value in (1.0, 2.0, 3.0):
                        engine.assets.change(asset, {"response": {"alpha_w": value}})

            threads = [threading.Thread(target=change) for _ in range(2)]
            for thread in threads:
                thread.start()
            start.wait()
            engine.assets.delete(asset)
            for thread in threads:
                thread.join()
        for job in engine.jobs._known():
            assert job.wait(60)
        assert engine.assets.all() == []
        assert used(engine) == 0
        assert engine._store.ids() == engine._store.pending() == []


def test_assets_that_came_and_went_leave_no_spare_memory(engine):
    device = engine._device
    for seed in range(3):
        asset = built(engine, new_asset(seed=seed))
        draw(engine, asset, "neutral", REDRAW, TileAddress(1001, 0, 0, 0))
        assert device.budget.used > 0
        engine.assets.delete(asset)
        rest(engine)
        assert (device.budget.used, device.pool.held) == (0, 0)
    kept = built(engine, new_asset(seed=9))
    engine.assets.delete(built(engine, new_asset(seed=10)))
    assert 0 < device.pool.held <= device.budget.used
    assert len(engine.tiles.plan(kept, "neutral", REDRAW, TileAddress(1001, 0, 0, 0)).draw())
