"""Lists of assets load none, and what callers send names no file."""

from __future__ import annotations

import errno
import json
import os
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from engine.engines import new_asset, running
from engine_process.served import await_value
from fleet.test_fleet_loaded import Content, Engine, Frames
from rhytid.engine.engine import Engine as RealEngine
from rhytid.engine_process.requests import Request
from rhytid.errors import NotFoundError, SharedDamageError, StorageError
from rhytid.fleet.caller import FleetCaller
from rhytid.fleet.fleet_assets import FleetAssets
from rhytid.fleet.frame_sync import FrameSync
from rhytid.fleet.frame_versions import FrameVersions
from rhytid.fleet.jobs import JobNames
from rhytid.fleet.loaded_assets import LoadedAssets
from rhytid.fleet.replica_assets import ReplicaAssets
from rhytid.fleet.shared_folder import SharedFolder

MOST = 64
STRANGE = ["\0", "a" * 300, "..", "../assets/0123456789abcdef", "0123456789ABCDEF", " ", "é" * 16]


@pytest.fixture
def shared(tmp_path: Path) -> SharedFolder:
    return SharedFolder(tmp_path / "shared")


class Fleet:
    """One replica that keeps 64 assets loaded, and an ingress that asks it."""

    def __init__(self, shared: SharedFolder) -> None:
        self.engine, frames = Engine(), Frames()
        parts: Any = (self.engine, shared, frames)
        self.residents = LoadedAssets(*parts, MOST, "me", lambda asset: None, lambda info: info)
        self._shared = shared

    def call(self, request: Any, prepare: Any = None) -> Any:
        with self.residents.using(request.asset):
            return self.engine.info(request.asset)

    def ingress(self) -> FleetAssets:
        parts: Any = None
        caller: Any = self
        return FleetAssets(caller, FrameVersions(), parts, parts, parts, self._shared)

    def restores(self) -> int:
        """Since the last time."""
        return sum(told[0] == "restore" for told in self.engine.heard())

    def build(self, asset: str, *, described: bool = True) -> None:
        content: Any = Content(asset)
        self.residents.take(asset, self._shared.put_snapshot(asset, content))
        if described:
            self.residents.describe(asset)
        self.residents.forget(asset)


@pytest.mark.slow
def test_a_list_of_many_assets_loads_none(shared: SharedFolder) -> None:
    fleet = Fleet(shared)
    assets = [f"{number:016x}" for number in range(1000)]
    for asset in assets:
        fleet.build(asset)
    for _ in range(2):  # two ingresses: one has kept what it found
        listed = fleet.ingress().all()
        assert [info.id for info in listed] == assets
        assert listed[0] == fleet.engine.info(assets[0])
    assert fleet.restores() == 0


def test_what_another_version_shared_is_loaded_once(shared: SharedFolder) -> None:
    fleet = Fleet(shared)
    assets = [f"{number:016x}" for number in range(2 * MOST)]
    for asset in assets:
        fleet.build(asset, described=False)
    assert [info.id for info in fleet.ingress().all()] == assets
    assert fleet.restores() == len(assets)
    assert [info.id for info in fleet.ingress().all()] == assets
    assert fleet.restores() == 0


@pytest.mark.parametrize("change", ["snapshot", "settings", "names", "damage"])
def test_what_is_said_of_other_files_is_not_believed(
    shared: SharedFolder, tmp_path: Path, change: str
) -> None:
    fleet, asset, content = Fleet(shared), "0" * 16, Content("another")
    fleet.build(asset)
    path = tmp_path / "shared" / "assets" / f"{asset}.info"
    said = json.loads(path.read_text())
    if change == "snapshot":
        given: Any = content
        shared.put_snapshot(asset, given)
    elif change == "settings":
        shared.put_settings(asset, {"depth": 2})
    elif change == "names":
        del said["info"]["settings"]["depth"]
        path.write_text(json.dumps(said))
    else:
        os.truncate(path, 10)
    for _ in range(2):
        assert [info.id for info in fleet.ingress().all()] == [asset]
    assert fleet.restores() == 1, "it is loaded, and said again"


@pytest.fixture
def engine(tmp_path: Path) -> Iterator[RealEngine]:
    with running(tmp_path / "store") as made:
        yield made


def test_a_replica_says_what_it_has_built_and_changed(
    engine: Any, shared: SharedFolder, tmp_path: Path
) -> None:
    board: Any = None
    sync = FrameSync(engine.frames, board)
    assets = ReplicaAssets(engine, shared, sync, JobNames(b"a key"), "me", 8)

    def said() -> Any:
        of = (shared.revision(asset), shared.settings_revision(asset))
        return shared.info(asset, of)

    try:
        asset = assets.create(new_asset(), "", strict=False, allow=()).id
        built = await_value(said)
        assert (built.state, built.wrinkles) == ("ready", engine.assets.info(asset).wrinkles)
        assert JobNames(b"a key").read(built.job).asset == asset
        assets.change(asset, {"depth": 0.25})
        changed = await_value(said)
        assert changed.settings["depth"] == 0.25
        assert json.dumps(changed.settings) == json.dumps(engine.assets.info(asset).settings)
    finally:
        assets.close()
    shared.remove(asset)
    assert not list((tmp_path / "shared" / "assets").iterdir())


@pytest.mark.parametrize("strange", STRANGE)
def test_what_is_no_id_becomes_no_name_of_a_file(shared: SharedFolder, strange: str) -> None:
    parts: Any = None
    caller = FleetCaller(parts, FrameVersions(), JobNames(b"a key"), lambda: True)
    for call in ("assets.info", "assets.delete", "frames.put", "draw_tile", "packages.of"):
        with pytest.raises(NotFoundError, match="no asset"):
            caller.call(Request(call, (strange,)))
    with pytest.raises(NotFoundError, match="no asset"):
        FleetAssets(caller, FrameVersions(), parts, parts, parts, shared).delete(strange)
    with pytest.raises(NotFoundError, match="no job"):
        caller.call(Request("jobs.info", (strange,)))
    for ask in (shared.revision, shared.settings, shared.owner, shared.upload, shared.remove):
        with pytest.raises(NotFoundError, match="no asset"):
            ask(strange)


def test_all_who_start_at_once_have_one_key(shared: SharedFolder, tmp_path: Path) -> None:
    begin = threading.Barrier(8)

    def key() -> bytes:
        begin.wait(30)
        return shared.job_key()

    with ThreadPoolExecutor(8) as pool:
        keys = {one.result() for one in [pool.submit(key) for _ in range(8)]}
    assert len(keys) == 1
    path = tmp_path / "shared" / "jobs.key"
    assert path.stat().st_mode & 0o777 == 0o600


def test_a_key_that_is_cut_off_is_named(
    shared: SharedFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rhytid.fleet.shared_folder._KEY_SECONDS", 0.05)
    (tmp_path / "shared" / "jobs.key").write_bytes(b"half")
    with pytest.raises(SharedDamageError, match=r"jobs\.key is damaged: remove it"):
        shared.job_key()


def test_a_key_that_cannot_be_written_is_made_later(
    shared: SharedFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(nbytes: int) -> bytes:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("secrets.token_bytes", full)
        with pytest.raises(StorageError, match="No space left"):
            shared.job_key()
    assert len(shared.job_key()) == 32
