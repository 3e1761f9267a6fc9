"""Which assets a replica has loaded: on first use, as they are now; few of them."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import pytest

from rhytid.domain.asset_settings import AssetSettings
from rhytid.engine.messages import AssetInfo
from rhytid.errors import NotFoundError, SharedDamageError, SnapshotError
from rhytid.fleet.envelopes import ElsewhereError
from rhytid.fleet.loaded_assets import LoadedAssets
from rhytid.fleet.shared_folder import SharedFolder

ASSETS = [f"{number:016x}" for number in range(4)]


class Engine:
    """Notes what it is told."""

    def __init__(self) -> None:
        self.told: list[tuple[str, ...]] = []
        self.assets = self.snapshots = self

    def restore(self, stream: Any, nbytes: int) -> None:
        content = stream.read(nbytes).decode()
        self.told.append(("restore", content))

    def delete(self, asset: str) -> None:
        self.told.append(("delete", asset))

    def change(self, asset: str, settings: Any) -> None:
        self.told.append(("change", asset, str(settings["depth"])))

    def info(self, asset: str) -> AssetInfo:
        settings = AssetSettings().as_json()
        return AssetInfo(asset, "ready", None, None, settings, (1001,), 9, 4, 2, 0, 0)

    def heard(self) -> list[tuple[str, ...]]:
        told, self.told = self.told, []
        return told


class Frames:
    """only: assets with frames that no board has."""

    def __init__(self) -> None:
        self.only: set[str] = set()

    def forget(self, asset: str) -> None: ...

    def only_here(self, asset: str) -> bool:
        return asset in self.only


class Content:
    """A snapshot that holds a word."""

    def __init__(self, word: str) -> None:
        self._word = word

    def pieces(self) -> list[bytes]:
        return [self._word.encode()]


@pytest.fixture
def shared(tmp_path: Path) -> SharedFolder:
    return SharedFolder(tmp_path)


@pytest.fixture
def engine() -> Engine:
    return Engine()


@pytest.fixture
def resumed() -> list[str]:
    return []


@pytest.fixture
def frames() -> Any:
    return Frames()


@pytest.fixture
def residents(engine: Any, shared: SharedFolder, frames: Any, resumed: list[str]) -> LoadedAssets:
    return LoadedAssets(engine, shared, frames, 2, "me", resumed.append, lambda info: info)


def share(shared: SharedFolder, asset: str, word: str = "") -> None:
    content: Any = Content(word or asset)
    shared.put_snapshot(asset, content)


def use(residents: LoadedAssets, *assets: str) -> None:
    for asset in assets:
        with residents.using(asset):
            pass


def test_an_asset_is_loaded_once(
    residents: LoadedAssets, shared: SharedFolder, engine: Engine
) -> None:
    share(shared, ASSETS[0])
    use(residents, ASSETS[0], ASSETS[0])
    assert engine.heard() == [("restore", ASSETS[0])]


def test_the_least_recently_used_leaves(
    residents: LoadedAssets, shared: SharedFolder, engine: Engine
) -> None:
    a, b, c, d = ASSETS
    for asset in ASSETS:
        share(shared, asset)
    use(residents, a, b, a, c)
    assert engine.heard()[-1] == ("delete", b)
    release = residents.pin(a)
    use(residents, c, d)
    assert engine.heard() == [("restore", d), ("delete", c)], "what is in use stays"
    release()
    residents.take(d)
    use(residents, b)
    assert engine.heard() == [("restore", b), ("delete", a)], "what is not shared yet stays"


def test_an_asset_with_frames_that_no_board_has_stays(
    residents: LoadedAssets, shared: SharedFolder, engine: Engine, frames: Any
) -> None:
    a, b, c, d = ASSETS
    for asset in ASSETS:
        share(shared, asset)
    frames.only = {a}
    use(residents, a, b, c)
    assert engine.heard()[-1] == ("delete", b)
    frames.only = set()
    use(residents, d)
    assert engine.heard() == [("restore", d), ("delete", a)]


def test_settings_and_snapshots_are_those_of_now(
    residents: LoadedAssets, shared: SharedFolder, engine: Engine
) -> None:
    asset = ASSETS[0]
    share(shared, asset)
    shared.put_settings(asset, {"depth": 1})
    use(residents, asset)
    assert engine.heard() == [("restore", asset), ("change", asset, "1")]
    shared.put_settings(asset, {"depth": 2})
    use(residents, asset, asset)
    assert engine.heard() == [("change", asset, "2")]
    share(shared, asset, "shapes")
    use(residents, asset)
    assert engine.heard() == [("delete", asset), ("restore", "shapes"), ("change", asset, "2")]


def test_another_snapshot_waits_until_nobody_uses_the_old_one(
    residents: LoadedAssets, shared: SharedFolder, engine: Engine
) -> None:
    asset = ASSETS[0]
    share(shared, asset)
    use(residents, asset)
    release = residents.pin(asset)
    share(shared, asset, "new")
    thread = threading.Thread(target=use, args=(residents, asset))
    thread.start()
    thread.join(0.2)
    assert engine.heard() == [("restore", asset)]
    release()
    thread.join(10)
    assert engine.heard() == [("delete", asset), ("restore", "new")]


def test_what_was_removed_elsewhere_goes(
    residents: LoadedAssets, shared: SharedFolder, engine: Engine
) -> None:
    asset = ASSETS[0]
    share(shared, asset)
    use(residents, asset)
    shared.remove(asset)
    use(residents, asset)
    assert engine.heard() == [("restore", asset), ("delete", asset)]
    assert not residents.has(asset)


def test_a_build_belongs_to_one_replica_while_it_is_there(
    residents: LoadedAssets, shared: SharedFolder, resumed: list[str]
) -> None:
    asset = ASSETS[0]
    shared.put_upload(asset, "other", [b"sent"])
    with pytest.raises(ElsewhereError) as raised, residents.using(asset):
        pass
    assert (raised.value.replica, resumed) == ("other", [])
    with residents.using(asset, gone="other"):
        pass
    assert resumed == [asset]
    shared.remove_upload(asset)
    use(residents, asset)
    assert resumed == [asset], "nothing is known of it"


def test_a_damaged_snapshot_is_a_fault_of_the_store(
    residents: LoadedAssets,
    shared: SharedFolder,
    engine: Engine,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(stream: Any, nbytes: int) -> None:
        raise SnapshotError("it is cut off")

    share(shared, ASSETS[0])
    with monkeypatch.context() as patch:
        patch.setattr(engine, "restore", refuse)
        with pytest.raises(SharedDamageError, match=f"asset {ASSETS[0]} .* it is cut off"):
            use(residents, ASSETS[0])
        with residents.using(ASSETS[0], mend=True):
            assert not residents.has(ASSETS[0])
    (tmp_path / "assets" / f"{ASSETS[0]}.json").write_text("{")
    with pytest.raises(SharedDamageError, match=f"settings of {ASSETS[0]} are damaged"):
        use(residents, ASSETS[0])
    with residents.using(ASSETS[0], mend=True):
        assert residents.has(ASSETS[0])
    use(residents, ASSETS[0])


def test_an_error_of_the_engine_leaves_nothing_held(
    residents: LoadedAssets, shared: SharedFolder
) -> None:
    share(shared, ASSETS[0])
    with pytest.raises(NotFoundError), residents.using(ASSETS[0]):
        raise NotFoundError
    use(residents, ASSETS[0])
