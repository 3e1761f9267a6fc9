"""One replica and its shared store: what is built, changed and removed, and what goes wrong."""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from engine.engines import new_asset, rest, running
from processes.served import await_value
from rhytid.engine import call_context
from rhytid.engine.assets.builder import AssetBuilder
from rhytid.engine.engine import Engine
from rhytid.errors import (
    CancelledError,
    DiskFullError,
    FetchingError,
    NotFoundError,
    SharedDamageError,
)
from rhytid.fleet.envelopes import ElsewhereError
from rhytid.fleet.fleet_assets import GivenName
from rhytid.fleet.fleet_store import FleetStore
from rhytid.fleet.frame_sync import FrameSync
from rhytid.fleet.jobs import JobNames
from rhytid.fleet.replica_assets import ReplicaAssets
from rhytid.storage.shared.shared_store import SharedStore


class NoRegistry:
    def forget(self, asset: str, after: int) -> int:
        return after + 1


pytestmark = pytest.mark.usefixtures("no_maps_ahead")


@contextmanager
def replica_of(tmp_path: Path, place: str, name: str) -> Iterator[tuple[ReplicaAssets, Engine]]:
    """The assets of a replica, over an engine in this process; nothing of it is left behind."""
    registry: Any = NoRegistry()
    with running(tmp_path / name, shared_store=place, in_step=True) as engine:
        made: Any = engine
        sync = FrameSync(made.frames, registry)
        names = JobNames(b"a key")
        assets = ReplicaAssets(made, FleetStore.at(place), sync, names, name, 8)
        try:
            yield assets, engine
        finally:
            assets.close()


@pytest.fixture
def store(place: str) -> FleetStore:
    return FleetStore.at(place)


@pytest.fixture
def replica(tmp_path: Path, place: str) -> Iterator[tuple[ReplicaAssets, Engine]]:
    with replica_of(tmp_path, place, "me") as made:
        yield made


def sent(assets: ReplicaAssets, gone: str = "", **changes: Any) -> Any:
    return assets.create(new_asset(**changes), gone, strict=False, allow=())


def built(assets: ReplicaAssets, engine: Engine, **changes: Any) -> str:
    """The id of an asset that was built, once what follows has been done."""
    info = sent(assets, **changes)
    rest(engine)
    assets.settle(info.job)
    return str(info.id)


def test_an_asset_is_said_as_it_is_from_its_build_to_its_removal(
    replica: tuple[ReplicaAssets, Engine], store: FleetStore
) -> None:
    assets, engine = replica

    def said() -> Any:
        return store.files.info(asset, store.assets.digest(asset))

    asset = built(assets, engine)
    assert store.files.uploads() == [], "what was sent is not needed any more"
    found = said()
    assert (found.state, found.wrinkles) == ("ready", engine.assets.info(asset).wrinkles)
    assert JobNames(b"a key").read(found.job).asset == asset
    assets.change(asset, {"depth": 0.25})
    assert said().settings["depth"] == 0.25
    assert json.dumps(said().settings) == json.dumps(engine.assets.info(asset).settings)
    with assets.loaded.using(asset):
        assets.delete(asset)
    assert (store.assets.ids(), store.files.info(asset, "")) == ([], None)
    assert store.files._backend.names("infos") == []
    assert engine.assets.all() == []


def test_another_replica_has_what_was_built_changed_and_removed(
    replica: tuple[ReplicaAssets, Engine],
    tmp_path: Path,
    place: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("rhytid.storage.shared.bucket_backend.BucketBackend.fresh", 0.0)
    assets, engine = replica
    asset = built(assets, engine)
    with replica_of(tmp_path, place, "other") as (others, second):
        with others.loaded.using(asset):
            assert second.assets.info(asset).state == "ready"
        assets.change(asset, {"depth": 0.25})
        with others.loaded.using(asset):
            assert second.assets.info(asset).settings["depth"] == 0.25
        with assets.loaded.using(asset):
            assets.delete(asset)
        with others.loaded.using(asset), pytest.raises(NotFoundError):
            second.assets.info(asset)


def test_a_build_goes_on_on_another_replica(
    tmp_path: Path, place: str, store: FleetStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The replica that had begun it ends before it is shared; its machine is gone."""
    going, begun = threading.Event(), threading.Event()
    build = AssetBuilder._build

    def slowly(*arguments: Any) -> None:
        begun.set()
        going.wait(60)
        build(*arguments)

    with monkeypatch.context() as patch, replica_of(tmp_path, place, "first") as (assets, engine):
        patch.setattr(AssetBuilder, "_build", slowly)
        asset = sent(assets).id
        assert begun.wait(60)
        assert (store.files.uploads(), store.files.owner(asset)) == ([asset], "first")
        assets.loaded._store.files.remove_upload = lambda asset: None  # type: ignore[method-assign]
        engine.jobs.cancel_all(asset, resumes=True)
        going.set()
    assert store.assets.ids() == []
    with replica_of(tmp_path, place, "second") as (others, second):
        with pytest.raises(ElsewhereError), others.loaded.using(asset):
            pass
        with others.loaded.using(asset, "first"):
            assert store.files.owner(asset) == "second"
        rest(second)
        await_value(lambda: not store.files.uploads())
        assert store.assets.holds(asset)


def test_a_build_that_cannot_be_shared_is_shared_later(
    replica: tuple[ReplicaAssets, Engine], store: FleetStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rhytid.storage.shared.bucket_backend.BucketBackend.fresh", 0.0)
    assets, engine = replica

    def full(*arguments: Any, **named: Any) -> None:
        raise DiskFullError("no room")

    with monkeypatch.context() as patch:
        patch.setattr(SharedStore, "push", full)
        asset = built(assets, engine)
        assert engine.assets.info(asset).state == "ready"
        assert store.files.uploads() == [asset], "the only copy that another replica could use"
    engine.shared.push(asset)
    rest(engine)
    with assets.loaded.using(asset):
        pass
    assert (store.files.uploads(), store.assets.ids()) == ([], [asset])


@pytest.mark.slow
@pytest.mark.parametrize("harm", ["manifest", "object"])
def test_a_damaged_asset_is_sent_again_or_removed(
    tmp_path: Path, harm: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rhytid.engine.shared_calls.FORGOTTEN", 0.0)
    place = tmp_path / "shared"
    place.mkdir()
    store = FleetStore.at(str(place))
    with replica_of(tmp_path, str(place), "first") as (assets, engine):
        asset = built(assets, engine)

    def damage() -> None:
        objects = (place / "objects" / asset).iterdir()
        large = max(objects, key=lambda path: path.stat().st_size)
        os.truncate(place / "manifests" / f"{asset}.json" if harm == "manifest" else large, 100)

    damage()
    with replica_of(tmp_path, str(place), "second") as (others, second):
        with pytest.raises(SharedDamageError, match="is damaged"):
            others.loaded.using(asset).__enter__()
        assert built(others, second) == asset
        assert store.assets.holds(asset)
        with others.loaded.using(asset):
            assert second.assets.info(asset).state == "ready"
        damage()
    with replica_of(tmp_path, str(place), "third") as (others, third):
        with others.loaded.using(asset, mend=True):
            others.delete(asset)
        assert (store.assets.ids(), third.assets.all()) == ([], [])


def test_a_build_whose_upload_cannot_be_kept_is_given_up(
    replica: tuple[ReplicaAssets, Engine], store: FleetStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    assets, engine = replica

    def full(*arguments: Any) -> None:
        raise DiskFullError("no room")

    monkeypatch.setattr("rhytid.storage.shared.folder_backend.FolderBackend.put", full)
    monkeypatch.setattr("rhytid.storage.shared.bucket_backend.BucketBackend.put", full)
    monkeypatch.setattr(AssetBuilder, "_build", lambda *arguments: threading.Event().wait(0.5))
    with pytest.raises(DiskFullError):
        sent(assets)
    assert engine.assets.all() == []
    assert (store.files.uploads(), store.assets.ids()) == ([], [])


@pytest.mark.slow
def test_a_snapshot_for_nobody_is_not_left(
    replica: tuple[ReplicaAssets, Engine], store: FleetStore
) -> None:
    assets, engine = replica

    def broken() -> Iterator[bytes]:
        yield b"half"
        raise CancelledError("gone")

    with pytest.raises(CancelledError):
        store.files.give(broken())
    asset = built(assets, engine)
    with call_context.abandoned_when(lambda: True), pytest.raises(CancelledError):
        assets.snapshot(asset)
    assert store.files._backend.names("given") == []
    name = assets.snapshot(asset)
    with store.files.given(name) as file:
        nbytes = len(file.read())
    with assets.loaded.using(asset):
        assets.delete(asset)
    info, new = assets.restore(GivenName(asset, name), nbytes)
    assert (info.id, new, store.assets.ids()) == (asset, True, [asset])
    assert store.files.info(asset, store.assets.digest(asset)) is not None


@pytest.mark.parametrize("first", ["remove", "put"])
def test_an_asset_that_is_sent_while_it_is_removed_is_whole_or_gone(
    replica: tuple[ReplicaAssets, Engine], tmp_path: Path, place: str, store: FleetStore, first: str
) -> None:
    """Beside a second replica, which takes the first for gone and goes on with its builds, and is
    gone itself then."""
    assets, engine = replica
    asset = built(assets, engine)

    def begin(*steps: Callable[[], object]) -> list[threading.Thread]:
        threads = [threading.Thread(target=_unless_removed, args=(step,)) for step in steps]
        for thread in threads:
            thread.start()
        return threads

    def keep_using() -> None:
        for _ in range(20):
            with others.loaded.using(asset, "me", mend=True):
                pass

    with replica_of(tmp_path, place, "other") as (others, _):
        with others.loaded.using(asset):
            pass
        steps = [lambda: assets.delete(asset), lambda: built(assets, engine)]
        for thread in begin(*(steps if first == "remove" else steps[::-1]), keep_using):
            thread.join(60)
            assert not thread.is_alive()
        rest(engine)
    there = store.assets.ids() == [asset]
    assert not there or store.assets.holds(asset)
    with replica_of(tmp_path, place, "third") as (thirds, third):
        with thirds.loaded.using(asset, "me"):
            states = [info.state for info in third.assets.all()]
        assert states == (["ready"] if there else []) or store.files.uploads()


def _unless_removed(step: Callable[[], object]) -> None:
    """A call of an asset that is removed meanwhile finds none, or is told to ask again."""
    with suppress(NotFoundError, FetchingError):
        step()
