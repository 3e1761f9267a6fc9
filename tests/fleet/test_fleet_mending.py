"""What goes wrong with the shared folder: assets that are damaged there, and uploads that do not
fit."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from engine.engines import new_asset, running
from engine_process.served import await_value
from rhytid.engine import wanted
from rhytid.engine.engine import Engine
from rhytid.errors import CancelledError, DiskFullError, SharedDamageError
from rhytid.fleet.fleet_assets import FleetAssets
from rhytid.fleet.frame_sync import FrameSync
from rhytid.fleet.frame_versions import FrameVersions
from rhytid.fleet.jobs import JobNames
from rhytid.fleet.replica_assets import ReplicaAssets
from rhytid.fleet.shared_folder import SharedFolder

ASSETS = [f"{number:016x}" for number in range(3)]


class NoBoard:
    def forget(self, asset: str, after: int) -> int:
        return after + 1


@pytest.fixture
def shared(tmp_path: Path) -> SharedFolder:
    return SharedFolder(tmp_path / "shared")


@pytest.fixture
def engine(tmp_path: Path) -> Iterator[Engine]:
    with running(tmp_path / "store") as made:
        yield made


@pytest.fixture
def assets(engine: Any, shared: SharedFolder) -> Iterator[ReplicaAssets]:
    board: Any = NoBoard()
    made = ReplicaAssets(
        engine, shared, FrameSync(engine.frames, board), JobNames(b"a key"), "me", 8
    )
    yield made
    made.close()


def sent(assets: ReplicaAssets) -> str:
    return assets.create(new_asset(), "", strict=False, allow=()).id


@pytest.mark.slow
def test_a_damaged_asset_is_sent_again_or_removed(
    assets: ReplicaAssets, shared: SharedFolder, engine: Engine, tmp_path: Path
) -> None:
    asset = sent(assets)
    before = await_value(lambda: shared.revision(asset))
    file = tmp_path / "shared" / "assets" / f"{asset}.tar"
    whole = file.read_bytes()
    os.truncate(file, len(whole) // 2)
    with pytest.raises(SharedDamageError, match=f"asset {asset} is damaged"):
        assets.residents.using(asset).__enter__()
    assert sent(assets) == asset
    await_value(lambda: file.stat().st_size == len(whole))
    assert shared.revision(asset) != before
    with assets.residents.using(asset):
        assert engine.assets.info(asset).state == "ready"
    os.truncate(file, 10)
    with assets.residents.using(asset, mend=True):
        assets.delete(asset)
    assert (shared.ids(), engine.assets.all()) == ([], [])


def test_a_build_whose_upload_cannot_be_kept_is_given_up(
    assets: ReplicaAssets, engine: Engine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*arguments: Any) -> None:
        raise DiskFullError("no room")

    monkeypatch.setattr("rhytid.fleet.shared_folder.write_pieces", full)
    with pytest.raises(DiskFullError):
        sent(assets)
    assert engine.assets.all() == []
    assert not any((tmp_path / "shared" / "uploads").iterdir())


@pytest.mark.slow
def test_a_snapshot_for_nobody_is_not_left(
    assets: ReplicaAssets, shared: SharedFolder, tmp_path: Path
) -> None:
    def broken() -> Iterator[bytes]:
        yield b"half"
        raise CancelledError("gone")

    with pytest.raises(CancelledError):
        shared.give(broken())
    asset = sent(assets)
    await_value(lambda: shared.revision(asset))
    with wanted.unless(lambda: True), pytest.raises(CancelledError):
        assets.snapshot(asset)
    assert not any((tmp_path / "shared" / "given").iterdir())
    assert assets.snapshot(asset).stat().st_size > 0


def test_a_list_leaves_out_what_is_damaged(shared: SharedFolder) -> None:
    for asset in ASSETS:
        shared.put_upload(asset, "other", [b"sent"])

    def call(request: Any, prepare: Any = None) -> Any:
        if request.asset == ASSETS[1]:
            raise SharedDamageError("it is cut off")
        return SimpleNamespace(id=request.asset, state="ready", job=None)

    caller: Any = SimpleNamespace(call=call)
    parts: Any = None
    listed = FleetAssets(caller, FrameVersions(), parts, parts, parts, shared).all()
    assert [info.id for info in listed] == [ASSETS[0], ASSETS[2]]
