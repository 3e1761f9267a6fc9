"""Builds and calibrations as jobs: progress, cancelling, removing while at work."""

from __future__ import annotations

import math
import threading
import time
from contextlib import closing
from dataclasses import replace

import pytest

from engine.engines import (
    BINNED,
    REDRAW,
    built,
    finish,
    maps,
    new_asset,
    rest,
    running,
    same,
    settle,
)
from meshes import deform
from pipeline.scenes import reference_stretch, settings_of, sheet
from reference.stretch import calibrated_r_max
from rhytid.domain.tiles import TileAddress
from rhytid.engine.engine import Engine
from rhytid.engine.frames import Frame
from rhytid.engine.job import Job
from rhytid.engine.messages import NewAsset, Refusal
from rhytid.errors import (
    FatalRequestError,
    FrameError,
    GraphError,
    LimitError,
    NotFoundError,
    NotReadyError,
    SettingsError,
)
from rhytid.support.settings import ServiceSettings

ADDRESS = TileAddress(1001, 0, 0, 0)


class Halted:
    """Stands in for the synthesis: says that it runs, then waits until it is let go."""

    def __init__(self, monkeypatch):
        self.running, self.free = threading.Event(), threading.Event()
        monkeypatch.setattr("rhytid.synthesis.generate.synthesize", self)

    def __call__(self, mesh, settings, device, report, **how):
        self.running.set()
        assert self.free.wait(60)
        report(0.5, "halted")  # raises where the job was cancelled
        raise AssertionError("the job was not cancelled")

    def start(self, engine):
        """The id and the job of an asset that is being synthesised."""
        info = engine.assets.create(NewAsset(sheet(), settings_of()))
        assert self.running.wait(60)
        return info.id, info.job


@pytest.fixture
def halted(monkeypatch):
    halted = Halted(monkeypatch)
    yield halted
    halted.free.set()


@pytest.fixture
def reports(monkeypatch):
    """What jobs said of themselves, in order."""
    found = []
    update = Job.update

    def record(job, **changes):
        update(job, **changes)
        found.append(job.info)

    monkeypatch.setattr(Job, "update", record)
    return found


@pytest.mark.slow
def test_progress_rises_from_nothing_to_the_end(engine, reports):
    small = settings_of(graph={"wrinkles": 300}, depth=None)
    info = engine.assets.create(NewAsset(sheet(), small))
    assert info.state == "building"
    finish(engine, info.job)
    own = [report for report in reports if report.id == info.job]
    grown = [report for report in own if 0 < report.progress < 0.8]
    assert own[1].detail == ""
    assert {report.detail.partition(" and ")[0] for report in grown} == {"about 300 wrinkles"}
    progress = [report.progress for report in own]
    assert progress == sorted(progress)
    assert (progress[0], progress[-1]) == (0.0, 1.0)
    assert len(set(progress)) > 10
    states = [report.state for report in own]
    assert states == ["running"] * (len(own) - 1) + ["done"]
    made = engine.assets.info(info.id)
    assert made.wrinkles >= 300
    assert made.settings["depth"] > 0
    assert abs(engine.tiles.plan_map(info.id, "neutral", REDRAW, 1001, 0).draw()).max() > 0


def test_an_asset_that_builds_is_not_ready(engine, halted):
    asset, job = halted.start(engine)
    assert engine.assets.info(asset).state == "building"
    assert engine.jobs.info(job).state == "running"
    positions = sheet().positions
    for call in (
        lambda: engine.tiles.plan(asset, "neutral", REDRAW, ADDRESS).draw(),
        lambda: engine.tiles.plan(asset, "neutral", REDRAW, ADDRESS).key,
        lambda: engine.tiles.plan_map(asset, "neutral", BINNED, 1001, 0).draw(),
        lambda: engine.frames.put(asset, "bent", positions),
        lambda: engine.tiles.draw(asset, Frame.of(positions), REDRAW, ADDRESS),
        lambda: engine.assets.calibrate(asset, positions),
        lambda: engine.assets.change(asset, {"depth": 1.0}),
        lambda: engine.assets.graph(asset),
        lambda: engine.tiles.bins(asset),
        lambda: engine.frames.stretch(asset, "neutral"),
    ):
        with pytest.raises(NotReadyError, match=asset) as raised:
            call()
        assert raised.value.retry_after > 0


def test_a_cancelled_build_is_forgotten_by_the_store(tmp_path, monkeypatch):
    halted = Halted(monkeypatch)
    with running(tmp_path) as engine:
        asset, job = halted.start(engine)
        engine.jobs.cancel(job)
        halted.free.set()
        assert finish(engine, job).state == "cancelled"
        info = engine.assets.info(asset)
        assert (info.state, "cancelled" in (info.reason or "")) == ("failed", True)
        assert used(engine) == 0
    with running(tmp_path) as engine:
        assert engine.assets.all() == []


def test_a_cancelled_build_can_be_asked_for_again(engine, monkeypatch):
    with monkeypatch.context() as patch:
        halted = Halted(patch)
        asset, job = halted.start(engine)
        engine.jobs.cancel(job)
        halted.free.set()
        finish(engine, job)
    again = engine.assets.create(NewAsset(sheet(), settings_of(graph={"wrinkles": 300})))
    assert again.id != asset
    halted = Halted(monkeypatch)
    second = engine.assets.create(NewAsset(sheet(), settings_of()))
    assert (second.id, second.state) == (asset, "building")
    engine.jobs.cancel(second.job)
    halted.free.set()


def used(engine):
    return next(info.used for info in engine.devices() if info.selected)


def test_removing_an_asset_while_it_builds(tmp_path, monkeypatch):
    halted = Halted(monkeypatch)
    with running(tmp_path) as engine:
        asset, job = halted.start(engine)
        engine.assets.delete(asset)
        with pytest.raises(NotFoundError):
            engine.assets.info(asset)
        halted.free.set()
        assert finish(engine, job).state == "cancelled"
        other = built(engine, new_asset())
        engine.assets.delete(other)
        built(engine, new_asset(seed=2))  # jobs go in order: both removals are done
        assert [info.id for info in engine.assets.all()] != [asset]
    with running(tmp_path) as engine:
        assert len(engine.assets.all()) == 1


def test_a_removed_asset_gives_everything_back(engine):
    before = used(engine)
    asset = built(engine, new_asset())
    engine.frames.put(asset, "bent", deform(sheet().positions, 1))
    maps(engine, asset, "bent")
    assert used(engine) > before
    engine.assets.delete(asset)
    other = built(engine, new_asset(seed=2))
    engine.assets.delete(other)
    third = engine.assets.create(new_asset(seed=3))
    finish(engine, third.job)
    engine.assets.delete(third.id)
    rest(engine)
    assert used(engine) == before


def test_calibration_sets_r_max_and_survives_a_restart(tmp_path):
    mesh, settings = sheet(), settings_of()
    bent = deform(mesh.positions, 8, 0.1)
    wanted = calibrated_r_max(reference_stretch(mesh, bent)[0], 0.5)
    assert 0.05 < wanted < 0.5
    with running(tmp_path) as engine:
        asset = built(engine, new_asset())
        key = engine.tiles.plan(asset, "neutral", BINNED, ADDRESS).key
        job = engine.assets.calibrate(asset, bent)
        assert job.kind == "calibration"
        assert finish(engine, job.id).state == "done"
        r_max = engine.assets.info(asset).settings["bins"]["r_max"]
        assert r_max == pytest.approx(wanted, rel=1e-5)
        assert engine.tiles.bins(asset).samples == pytest.approx((-r_max, 0.0, r_max))
        assert engine.tiles.plan(asset, "neutral", BINNED, ADDRESS).key != key
        engine.frames.put(asset, "bent", bent)
        before = maps(engine, asset, "bent")
        engine.frames.put(made_so(engine, r_max), "bent", bent)
        assert same(before, maps(engine, made_so(engine, r_max), "bent"))
    with running(tmp_path) as engine:
        settle(engine, asset)
        assert engine.assets.info(asset).settings["bins"]["r_max"] == r_max
        engine.frames.put(asset, "bent", bent)
        assert same(before, maps(engine, asset, "bent"))
    assert settings.bins.r_max != r_max


def made_so(engine, r_max):
    return built(engine, new_asset(bins={"r_max": r_max}))


@pytest.mark.parametrize(("squeeze", "r_max"), [(1.0, 0.01), (0.0, 0.5), (1e-30, 0.5)])
def test_calibration_with_nothing_or_everything_stretched(engine, squeeze, r_max):
    asset = built(engine, new_asset())
    job = engine.assets.calibrate(asset, sheet().positions * squeeze)
    assert finish(engine, job.id).state == "done"
    assert engine.assets.info(asset).settings["bins"]["r_max"] == r_max


def test_what_does_not_fit_the_mesh_is_refused(engine):
    asset = built(engine, new_asset())
    for positions in (sheet().positions[1:], sheet().positions[:, :2]):
        with pytest.raises(FrameError):
            engine.assets.calibrate(asset, positions)
        with pytest.raises(FrameError):
            engine.frames.put(asset, "bad", positions)
    new = new_asset()
    graph = type(new.graph)(**{**new.graph.arrays(), "edge_triangle": [200] * 80})
    with pytest.raises(GraphError, match=r"edge_triangle\[0\] is 200: .* 200 triangles"):
        engine.assets.create(NewAsset(new.mesh, new.settings, graph))


def test_a_graph_that_covers_too_much_is_refused_at_once(engine, monkeypatch):
    monkeypatch.setattr("rhytid.pipeline.reach._MOST_COVER", 0.5)
    with pytest.raises(
        LimitError, match=r"the graph's wrinkles cover \d+ times the map of UDIM 1001"
    ):
        engine.assets.create(new_asset())
    assert engine.assets.all() == []


@pytest.mark.parametrize("key", ["resolution", "tile_size", "graph", "padding", "unit"])
def test_what_is_fixed_cannot_be_changed(engine, key):
    asset = built(engine, new_asset())
    with pytest.raises(SettingsError, match=key):
        engine.assets.change(asset, {key: settings_of().as_json()[key]})
    with pytest.raises(SettingsError, match="nothing_like_this"):
        engine.assets.change(asset, {"nothing_like_this": 1})


def settings_of_store(folder):
    return replace(ServiceSettings.from_environment(), store=folder / "store")


def test_what_was_refused_is_built_once_it_was_removed(tmp_path):
    new = new_asset()
    with running(tmp_path / "other") as engine:
        id = engine.assets.create(new).id
    refused = {id: Refusal("it ended twice", math.inf)}
    with (
        closing(Engine(settings_of_store(tmp_path), refused)) as engine,
        pytest.raises(FatalRequestError, match="it ended twice"),
    ):
        engine.assets.create(new)
    with closing(Engine(settings_of_store(tmp_path), refused)) as engine:
        assert engine.assets.info(id).state == "failed"
        with pytest.raises(FatalRequestError, match="it ended twice"):
            engine.assets.create(new)
        engine.assets.delete(id)
        assert built(engine, new) == id


def test_a_refusal_that_is_over_refuses_nothing(tmp_path):
    with running(tmp_path / "other") as engine:
        id = engine.assets.create(new_asset()).id
    refused = {id: Refusal("it was late twice", time.monotonic() - 1)}
    with closing(Engine(settings_of_store(tmp_path), refused)) as engine:
        assert built(engine, new_asset()) == id


def test_frames_sent_with_a_mesh_are_there_when_it_is_built(engine):
    mesh = sheet()
    frames = [deform(mesh.positions, seed) for seed in range(3)]
    new = new_asset(mesh)
    info = engine.assets.create(NewAsset(mesh, new.settings, new.graph, frames))
    assert finish(engine, info.job).state == "done"
    rest(engine)
    names = [frame.name for frame in engine.frames.all(info.id)]
    assert names == ["neutral", "0001", "0002", "0003"]
    for name, positions in zip(names[1:], frames, strict=True):
        assert same([engine.frames.positions(info.id, name)], [positions])


def test_a_frame_that_is_stored_while_an_upload_waits_stays(engine, monkeypatch):
    """The upload came before; of two uploads the later one's frames are there."""
    mesh, new = sheet(), new_asset()
    first, second, put = (deform(mesh.positions, seed) for seed in range(3))
    asset = built(engine, new)
    begun, free = threading.Event(), threading.Event()
    progress = Job.progress

    def wait(job, *said):
        begun.set()
        assert free.wait(60)
        progress(job, *said)

    monkeypatch.setattr(Job, "progress", wait)
    jobs = [
        engine.assets.create(NewAsset(mesh, new.settings, new.graph, [frame, frame])).job
        for frame in (first, second)
    ]
    assert begun.wait(60)
    engine.frames.put(asset, "0000", put)
    free.set()
    assert [finish(engine, job).state for job in jobs] == ["done", "done"]
    assert same([engine.frames.positions(asset, "0000")], [put])
    assert same([engine.frames.positions(asset, "0001")], [second])
