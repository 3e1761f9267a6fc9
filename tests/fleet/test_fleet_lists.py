"""Lists of assets load none, and what callers send names no object."""

from __future__ import annotations

import json
import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from fleet.test_fleet_files import STRANGE
from fleet.test_fleet_loaded import Engine, Frames, Shared, store_of
from rhytid.engine.operations import OPERATIONS
from rhytid.errors import NotFoundError, SharedDamageError
from rhytid.fleet.caller import FleetCaller
from rhytid.fleet.fleet_assets import SharedCalls
from rhytid.fleet.frame_versions import FrameVersions
from rhytid.fleet.jobs import JobNames
from rhytid.fleet.loaded_assets import LoadedAssets
from rhytid.processes.envelope import Request

MOST = 64


class Fleet:
    """One replica that keeps 64 assets loaded, and an ingress that asks it."""

    def __init__(self, folder: Path) -> None:
        self.shared = Shared()
        self.engine, frames = Engine(self.shared), Frames()
        self.store = store_of(self.shared, folder)
        parts: Any = (self.engine, self.store, frames)
        self.loaded = LoadedAssets(*parts, MOST, "me", lambda asset: None, lambda info: info)

    def call(self, request: Any, prepare: Any = None) -> Any:
        with self.loaded.using(request.asset):
            return self.engine.info(request.asset)

    def ingress(self) -> SharedCalls:
        caller: Any = self
        return SharedCalls(caller, self.store)

    def fetched(self) -> int:
        """Since the last time."""
        return sum(told[0] in ("fetch", "change") for told in self.engine.heard())

    def build(self, asset: str, *, described: bool = True) -> None:
        self.shared.there[asset] = "one"
        if described:
            with self.loaded.changing(asset):
                self.loaded.see_changed(asset)
            self.loaded.forget(asset)
            self.engine.has.pop(asset)
        self.engine.heard()


@pytest.fixture
def fleet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Fleet:
    monkeypatch.setattr("rhytid.engine.local_copies.RESTING", 0.0)
    return Fleet(tmp_path / "shared")


@pytest.mark.slow
def test_a_list_of_many_assets_loads_none(fleet: Fleet) -> None:
    assets = [f"{number:016x}" for number in range(1000)]
    for asset in assets:
        fleet.build(asset)
    for _ in range(2):  # two ingresses: one has kept what it found
        listed = fleet.ingress().all()
        assert [info.id for info in listed] == assets
        assert listed[0] == fleet.engine.info(assets[0])
    assert fleet.fetched() == 0


def test_what_another_machine_shared_is_loaded_once(fleet: Fleet) -> None:
    """A server of the same shared store, or another version, says nothing of it."""
    assets = [f"{number:016x}" for number in range(2 * MOST)]
    for asset in assets:
        fleet.build(asset, described=False)
    assert [info.id for info in fleet.ingress().all()] == assets
    assert fleet.fetched() == len(assets)
    assert [info.id for info in fleet.ingress().all()] == assets
    assert fleet.fetched() == 0


@pytest.mark.parametrize("change", ["manifest", "names", "damage"])
def test_what_is_said_of_another_manifest_is_not_believed(
    fleet: Fleet, tmp_path: Path, change: str
) -> None:
    asset = "0" * 16
    fleet.build(asset)
    path = tmp_path / "shared" / "infos" / f"{asset}.json"
    said = json.loads(path.read_text())
    if change == "manifest":
        fleet.shared.there[asset] = "two"
    elif change == "names":
        del said["info"]["settings"]["depth"]
        path.write_text(json.dumps(said))
    else:
        os.truncate(path, 10)
    for _ in range(2):
        assert [info.id for info in fleet.ingress().all()] == [asset]
    assert fleet.fetched() == 1, "it is loaded, and said again"


def test_an_ingress_that_has_listed_an_asset_looks_at_its_revision_alone(
    fleet: Fleet, tmp_path: Path
) -> None:
    asset = "0" * 16
    fleet.build(asset)
    ingress = fleet.ingress()
    assert [info.id for info in ingress.all()] == [asset]
    (tmp_path / "shared" / "infos" / f"{asset}.json").unlink()
    assert [info.id for info in ingress.all()] == [asset]
    assert fleet.fetched() == 0
    del fleet.shared.there[asset]
    assert ingress.all() == []


def test_a_list_leaves_out_what_is_damaged_and_has_what_builds(fleet: Fleet) -> None:
    assets = [f"{number:016x}" for number in range(3)]
    for asset in assets:
        fleet.store.files.put_upload(asset, "other", [b"sent"])

    def call(request: Any, prepare: Any = None) -> Any:
        if request.asset == assets[1]:
            raise SharedDamageError("it is cut off")
        return SimpleNamespace(id=request.asset, state="building", job=None)

    caller: Any = SimpleNamespace(call=call)
    listed = SharedCalls(caller, fleet.store).all()
    assert [info.id for info in listed] == [assets[0], assets[2]]


@pytest.mark.parametrize("strange", STRANGE)
def test_what_is_no_id_becomes_no_name_of_a_file(fleet: Fleet, strange: str) -> None:
    parts: Any = None
    caller = FleetCaller(parts, FrameVersions(), JobNames(b"a key"), lambda: True)
    for operation in OPERATIONS.values():
        kind = "job" if operation.addresses == "job" else "asset"
        if operation.addresses in ("asset", "frames", "frame", "job"):
            with pytest.raises(NotFoundError, match=f"no {kind}"):
                caller.call(Request(operation, (strange, "smile")))
