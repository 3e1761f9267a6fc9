"""Assets that are removed, sent again or changed while something else happens to them."""

from __future__ import annotations

import threading

import pytest

from engine.engines import BINNED, REDRAW, built, finish, new_asset, running, settle
from meshes import deform
from pipeline.scenes import settings_of, sheet
from rhytid.domain.tiles import TileAddress
from rhytid.engine.device_assets import levels
from rhytid.engine.device_assets.levels import DeviceLevels
from rhytid.engine.device_assets.mesh import DeviceMesh
from rhytid.engine.frames import Frames
from rhytid.engine.messages import NewAsset
from rhytid.errors import BusyError, DeviceMemoryError, NotFoundError, StorageError
from rhytid.storage.store import AssetStore

ADDRESS = TileAddress(1001, 0, 0, 0)


class Gate:
    """Stands in for the synthesis: waits to be let go, then returns what was made before."""

    def __init__(self, monkeypatch):
        from rhytid.synthesis import generate

        self.entered, self.free = threading.Event(), threading.Event()
        self.real = generate.synthesize
        monkeypatch.setattr(generate, "synthesize", self)

    def __call__(self, mesh, settings, device, report, **how):
        self.entered.set()
        assert self.free.wait(60)
        return self.real(mesh, settings, device, report, **how)


@pytest.fixture
def new():
    """An asset that must be synthesised."""
    return NewAsset(sheet(), settings_of(graph={"wrinkles": 300}, depth=None))


@pytest.mark.slow
def test_removed_and_sent_again_while_it_builds(engine, monkeypatch, new):
    gate = Gate(monkeypatch)
    first = engine.assets.create(new)
    assert gate.entered.wait(60)
    engine.assets.delete(first.id)
    again = engine.assets.create(new)
    gate.free.set()
    assert finish(engine, first.job).state == "cancelled"
    assert finish(engine, again.job).state == "done"
    assert engine.assets.info(again.id).state == "ready"
    assert engine.tiles.plan(again.id, "neutral", REDRAW, ADDRESS).draw().shape == (64, 64)


def test_a_build_that_failed_after_it_was_stored_is_taken_up_again(engine, monkeypatch):
    def no_room(*_):
        raise DeviceMemoryError("no room")

    with monkeypatch.context() as patch:
        patch.setattr(DeviceMesh, "upload", no_room)
        info = engine.assets.create(new_asset())
        assert finish(engine, info.job).state == "failed"
    assert engine.assets.info(info.id).reason == "no room"
    assert built(engine, new_asset()) == info.id


def test_a_cancelled_asset_can_be_removed(engine, monkeypatch, new):
    gate = Gate(monkeypatch)
    info = engine.assets.create(new)
    assert gate.entered.wait(60)
    engine.jobs.cancel(info.job)
    gate.free.set()
    assert finish(engine, info.job).state == "cancelled"
    engine.assets.delete(info.id)
    assert engine.assets.all() == []


def test_settings_that_cannot_be_stored_are_not_taken(engine, monkeypatch):
    asset = built(engine, new_asset())
    before = engine.tiles.plan(asset, "neutral", REDRAW, ADDRESS).draw()
    key = engine.tiles.plan(asset, "neutral", REDRAW, ADDRESS).key

    def full(*_):
        raise StorageError("disk full")

    with monkeypatch.context() as patch:
        patch.setattr(AssetStore, "put_overlay", full)
        with pytest.raises(StorageError):
            engine.assets.change(asset, {"shape": {"wrinkle_bulge": 0.0}})
    assert engine.tiles.plan(asset, "neutral", REDRAW, ADDRESS).key == key
    assert engine.tiles.plan(asset, "neutral", REDRAW, ADDRESS).draw().tobytes() == before.tobytes()


def test_settings_that_the_device_refuses_are_not_kept(tmp_path, monkeypatch):
    with running(tmp_path) as engine:
        asset = built(engine, new_asset())
        old = engine.assets.info(asset).settings

        def no_room(*_):
            raise DeviceMemoryError("no room")

        with monkeypatch.context() as patch:
            patch.setattr(DeviceMesh, "use", no_room)
            with pytest.raises(DeviceMemoryError):
                engine.assets.change(asset, {"shape": {"wrinkle_bulge": 0.0}})
        assert engine.assets.info(asset).settings == old
    with running(tmp_path) as engine:
        settle(engine, asset)
        assert engine.assets.info(asset).settings == old


def test_a_change_that_fails_halfway_leaves_the_elements_in_place(engine, monkeypatch):
    asset = built(engine, new_asset())
    before = engine.tiles.plan(asset, "neutral", REDRAW, ADDRESS).draw()

    def no_room(*_):
        raise DeviceMemoryError("no room")

    with monkeypatch.context() as patch:
        patch.setattr("rhytid.engine.device_assets.mesh.Blend", no_room)
        with pytest.raises(DeviceMemoryError):
            engine.assets.change(asset, {"response": {"alpha_w": 2.0}})
    assert engine.tiles.plan(asset, "neutral", REDRAW, ADDRESS).draw().tobytes() == before.tobytes()


def test_a_map_is_of_one_setting(engine, monkeypatch):
    asset = built(engine, new_asset())
    squares, calls = DeviceLevels.squares, []
    monkeypatch.setitem(levels._PIECE, "binned", 64)

    def changing(levels, *arguments):
        calls.append(1)
        if len(calls) == 3:  # in the middle of the first attempt, on the device thread
            found = engine.assets._assets.get(asset)
            changed = found.settings.changed({"depth": 2 * found.settings.depth})
            levels._base.use(changed)
            found.settings = changed
        return squares(levels, *arguments)

    monkeypatch.setattr(DeviceLevels, "squares", changing)
    drawn = engine.tiles.plan_map(asset, "neutral", BINNED, 1001, 0).draw()
    assert len(calls) == 16 + 2  # every piece, and anew the two before the change
    assert (
        drawn.tobytes() == engine.tiles.plan_map(asset, "neutral", BINNED, 1001, 0).draw().tobytes()
    )


def test_a_removed_asset_takes_no_frame_and_gives_its_memory_back(engine, monkeypatch):
    asset = built(engine, new_asset())
    frames = engine.assets._assets.get(asset).frames
    put = Frames.put
    bent = deform(sheet().positions, 3, 0.15)

    def late(*arguments, **named):
        engine.assets.delete(asset)
        put(*arguments, **named)

    monkeypatch.setattr(Frames, "put", late)
    with pytest.raises(NotFoundError, match="removed"):
        engine.frames.put(asset, "late", bent)
    assert frames._memory._used == 0


def test_no_call_hangs_on_an_engine_that_closed(tmp_path):
    with running(tmp_path) as engine:
        asset = built(engine, new_asset())
    with pytest.raises(BusyError):
        engine.tiles.plan(asset, "neutral", REDRAW, ADDRESS).draw()


def test_removing_an_asset_cancels_all_its_jobs(engine, monkeypatch):
    asset = built(engine, new_asset())
    gate = threading.Event()
    job = engine.jobs.start("build", asset, lambda job: gate.wait(60) and job.progress(1.0, ""))
    engine.assets.delete(asset)
    gate.set()
    assert finish(engine, job.info.id).state == "cancelled"


def test_a_build_stores_nothing_for_an_asset_that_was_removed(engine, monkeypatch, new):
    gate = Gate(monkeypatch)
    info = engine.assets.create(new)
    assert gate.entered.wait(60)
    engine.assets._assets.get(info.id).state = "removed"  # just after the build last asked
    gate.free.set()
    assert finish(engine, info.job).state == "cancelled"
    assert engine._store.ids() == []
