"""Which assets a replica has loaded: on first use, as they are now; few of them."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import Any

import pytest

from rhytid.domain.asset_settings import AssetSettings
from rhytid.engine.messages import AssetInfo, FollowedAsset
from rhytid.errors import NotFoundError, SharedDamageError, SharedStoreError
from rhytid.fleet.envelopes import ElsewhereError
from rhytid.fleet.fleet_store import FleetStore
from rhytid.fleet.loaded_assets import LoadedAssets
from rhytid.fleet.shared_files import SharedFiles
from rhytid.storage.shared.folder_backend import FolderBackend

ASSETS = [f"{number:016x}" for number in range(4)]


class Shared:
    """Revisions of manifests, by asset."""

    fresh = 0.0

    def __init__(self) -> None:
        self.there: dict[str, str] = {}
        self.looked = 0
        self.away = False

    def revision(self, asset: str) -> str | None:
        self.looked += 1
        if self.away:
            raise SharedStoreError("it is gone")
        return self.there.get(asset)

    def revisions(self) -> dict[str, str]:
        return dict(sorted(self.there.items()))

    def digest(self, asset: str) -> str:
        return f"digest of {self.there[asset]}"


class Engine:
    """Notes what it is told; revisions that begin with `files` have other files."""

    def __init__(self, shared: Shared) -> None:
        self.told: list[tuple[str, ...]] = []
        self.assets, self._shared = self, shared
        self.building: set[str] = set()
        self.stays: set[str] = set()
        self.has: dict[str, str] = {}

    def follow(self, asset: str, *, replace: bool) -> FollowedAsset | None:
        if asset in self.building:
            return FollowedAsset(self.info(asset), "", replaced=False)
        there, here = self._shared.there.get(asset), self.has.get(asset)
        if there is None:
            self.told.append(("removed", asset))
            self.has.pop(asset, None)
            raise NotFoundError(f"no asset {asset}")
        fetched = here is None or (there != here and there.startswith("files"))
        if fetched and here is not None and not replace:
            return None
        if there != here:
            self.told.append(("fetch" if fetched else "change", asset, there))
        self.has[asset] = there
        return FollowedAsset(self.info(asset), f"digest of {there}", replaced=fetched)

    def leave(self, asset: str) -> bool:
        if asset in self.stays:
            return False
        self.told.append(("leave", asset))
        self.has.pop(asset, None)
        return True

    def info(self, asset: str) -> AssetInfo:
        settings = AssetSettings().as_json()
        return AssetInfo(asset, "ready", None, None, settings, (1001,), 9, 4, 2, 0, 0)

    def heard(self) -> list[tuple[str, ...]]:
        told, self.told = self.told, []
        return told


class Frames:
    """only: assets with frames that no registry has."""

    def __init__(self) -> None:
        self.only: set[str] = set()
        self.forgotten: list[str] = []

    def forget(self, asset: str) -> None:
        self.forgotten.append(asset)

    def only_here(self, asset: str) -> bool:
        return asset in self.only


def store_of(shared: Shared, folder: Path) -> FleetStore:
    folder.mkdir(exist_ok=True)
    assets: Any = shared
    return FleetStore(str(folder), assets, SharedFiles(FolderBackend(folder)))


@pytest.fixture
def shared() -> Shared:
    return Shared()


@pytest.fixture
def store(shared: Shared, tmp_path: Path) -> FleetStore:
    return store_of(shared, tmp_path / "shared")


@pytest.fixture
def engine(shared: Shared) -> Engine:
    return Engine(shared)


@pytest.fixture
def resumed() -> list[str]:
    return []


@pytest.fixture
def frames() -> Any:
    return Frames()


@pytest.fixture
def loaded(
    engine: Any,
    store: FleetStore,
    frames: Any,
    resumed: list[str],
    monkeypatch: pytest.MonkeyPatch,
) -> LoadedAssets:
    monkeypatch.setattr("rhytid.engine.local_copies.RESTING", 0.0)
    return LoadedAssets(engine, store, frames, 2, "me", resumed.append, lambda info: info)


def use(loaded: LoadedAssets, *assets: str) -> None:
    for asset in assets:
        with loaded.using(asset):
            pass


def test_an_asset_is_loaded_once(loaded: LoadedAssets, shared: Shared, engine: Engine) -> None:
    shared.there[ASSETS[0]] = "one"
    use(loaded, ASSETS[0], ASSETS[0])
    assert engine.heard() == [("fetch", ASSETS[0], "one")]


def test_the_least_recently_used_leaves(
    loaded: LoadedAssets, shared: Shared, engine: Engine, monkeypatch: pytest.MonkeyPatch
) -> None:
    a, b, c, d = ASSETS
    shared.there = dict.fromkeys(ASSETS, "one")
    use(loaded, a, b, a, c)
    assert engine.heard()[-1] == ("leave", b)
    release = loaded.pin(a)
    use(loaded, c, d)
    assert engine.heard() == [("fetch", d, "one"), ("leave", c)], "what is in use stays"
    release()
    engine.stays = {a}
    use(loaded, b)
    assert engine.heard() == [("fetch", b, "one"), ("leave", d)], "the engine decides"
    engine.stays = set()
    monkeypatch.setattr("rhytid.engine.local_copies.RESTING", 60.0)
    use(loaded, c)
    assert engine.heard() == [("fetch", c, "one")], "what was used a moment ago stays"


def test_what_is_built_here_and_not_shared_yet_stays(
    loaded: LoadedAssets, shared: Shared, engine: Engine
) -> None:
    a, b, c, _ = ASSETS
    engine.building = {a}
    loaded.take(a)
    shared.there = {b: "one", c: "one"}
    use(loaded, a, b, c)
    assert engine.heard() == [("fetch", b, "one"), ("fetch", c, "one"), ("leave", b)]


def test_an_asset_with_frames_that_no_registry_has_stays(
    loaded: LoadedAssets, shared: Shared, engine: Engine, frames: Any
) -> None:
    a, b, c, d = ASSETS
    shared.there = dict.fromkeys(ASSETS, "one")
    frames.only = {a}
    use(loaded, a, b, c)
    assert engine.heard()[-1] == ("leave", b)
    frames.only = set()
    use(loaded, d)
    assert engine.heard() == [("fetch", d, "one"), ("leave", a)]


def test_settings_and_files_are_those_of_now(
    loaded: LoadedAssets, shared: Shared, engine: Engine, frames: Any
) -> None:
    asset = ASSETS[0]
    shared.there[asset] = "one"
    use(loaded, asset)
    frames.forgotten.clear()
    shared.there[asset] = "two"
    use(loaded, asset, asset)
    assert engine.heard() == [("fetch", asset, "one"), ("change", asset, "two")]
    assert frames.forgotten == []
    shared.there[asset] = "files of another"
    use(loaded, asset)
    assert engine.heard() == [("fetch", asset, "files of another")]
    assert frames.forgotten == [asset], "the engine has none of them now"


def test_other_files_wait_until_nobody_uses_the_old_ones(
    loaded: LoadedAssets, shared: Shared, engine: Engine
) -> None:
    asset = ASSETS[0]
    shared.there[asset] = "one"
    use(loaded, asset)
    release = loaded.pin(asset)
    shared.there[asset] = "files of another"
    thread = threading.Thread(target=use, args=(loaded, asset))
    thread.start()
    thread.join(0.2)
    assert engine.heard() == [("fetch", asset, "one")]
    release()
    thread.join(10)
    assert engine.heard() == [("fetch", asset, "files of another")]


def test_a_call_that_has_shared_an_asset_does_not_wait_for_itself(
    loaded: LoadedAssets, shared: Shared, engine: Engine
) -> None:
    asset = ASSETS[0]
    shared.there[asset] = "one"
    with loaded.using(asset), loaded.changing(asset):
        shared.there[asset] = "files of another"
        loaded.see_changed(asset)
        assert engine.heard() == [("fetch", asset, "one")]
    use(loaded, asset)
    assert engine.heard() == [("fetch", asset, "files of another")], "the next call takes them"


def test_what_was_removed_elsewhere_goes(
    loaded: LoadedAssets, shared: Shared, engine: Engine
) -> None:
    asset = ASSETS[0]
    shared.there[asset] = "one"
    use(loaded, asset)
    del shared.there[asset]
    use(loaded, asset)
    assert engine.heard() == [("fetch", asset, "one"), ("removed", asset)]
    assert not loaded.has(asset)


def test_a_build_belongs_to_one_replica_while_it_is_there(
    loaded: LoadedAssets, store: FleetStore, resumed: list[str]
) -> None:
    asset = ASSETS[0]
    store.files.put_upload(asset, "other", [b"sent"])
    with pytest.raises(ElsewhereError) as raised, loaded.using(asset):
        pass
    assert (raised.value.replica, resumed) == ("other", [])
    with loaded.using(asset, gone="other"):
        pass
    assert resumed == [asset]
    store.files.remove_upload(asset)
    use(loaded, asset)
    assert resumed == [asset], "nothing is known of it"


def test_what_was_sent_goes_once_the_asset_is_shared(
    loaded: LoadedAssets, shared: Shared, engine: Engine, store: FleetStore
) -> None:
    asset = ASSETS[0]
    engine.building = {asset}
    store.files.put_upload(asset, "me", [b"sent"])
    loaded.take(asset)
    use(loaded, asset)
    with loaded.changing(asset):
        loaded.see_changed(asset)
    assert store.files.uploads() == [asset], "it may be pushed later: it is the only copy"
    engine.building, shared.there[asset] = set(), "one"
    use(loaded, asset)
    assert store.files.uploads() == []


def test_a_damaged_asset_is_left_to_the_call_that_mends_it(
    loaded: LoadedAssets, shared: Shared, engine: Engine, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(asset: str, *, replace: bool) -> None:
        raise SharedDamageError(f"{asset} is damaged")

    shared.there[ASSETS[0]] = "one"
    with monkeypatch.context() as patch:
        patch.setattr(engine, "follow", refuse)
        with pytest.raises(SharedDamageError, match=f"{ASSETS[0]} is damaged"):
            use(loaded, ASSETS[0])
        with loaded.using(ASSETS[0], mend=True):
            assert not loaded.has(ASSETS[0])
    use(loaded, ASSETS[0])
    assert loaded.has(ASSETS[0])


def test_an_error_of_the_engine_leaves_nothing_held(loaded: LoadedAssets, shared: Shared) -> None:
    shared.there[ASSETS[0]] = "one"
    with pytest.raises(NotFoundError), loaded.using(ASSETS[0]):
        raise NotFoundError
    use(loaded, ASSETS[0])


def test_a_shared_store_that_is_away_keeps_nobody_from_what_is_here(
    loaded: LoadedAssets, shared: Shared, engine: Engine, monkeypatch: pytest.MonkeyPatch
) -> None:
    shared.there = dict.fromkeys(ASSETS, "one")
    use(loaded, ASSETS[0])
    shared.away, looked = True, shared.looked
    for _ in range(3):
        use(loaded, ASSETS[0])
        with pytest.raises(SharedStoreError):
            use(loaded, ASSETS[1])
    assert shared.looked == looked + 1, "a store that does not answer is not waited for each time"
    with loaded.changing(ASSETS[0]):
        loaded.see_changed(ASSETS[0])
    shared.away, shared.there[ASSETS[0]] = False, "two"
    now = time.monotonic() + 3
    monkeypatch.setattr("rhytid.engine.shared_calls.time.monotonic", lambda: now)
    use(loaded, ASSETS[0])
    assert engine.heard()[-1] == ("change", ASSETS[0], "two")


def test_a_bucket_is_looked_at_once_a_second(
    loaded: LoadedAssets, shared: Shared, engine: Engine, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = 1000.0
    monkeypatch.setattr("rhytid.fleet.loaded_assets.time.monotonic", lambda: now)
    shared.fresh, shared.there[ASSETS[0]] = 1.0, "one"
    use(loaded, ASSETS[0], ASSETS[0], ASSETS[0])
    assert shared.looked == 1
    shared.there[ASSETS[0]] = "two"
    now += 1.1
    use(loaded, ASSETS[0], ASSETS[0])
    assert shared.looked == 2
    assert engine.heard()[-1] == ("change", ASSETS[0], "two")
