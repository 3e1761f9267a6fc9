"""Power cut or full disk at every step of every change: the old state or the new, never between.

Each change is run once for every step it takes on the disk, failing at that step; the store is
then opened anew and read in full.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.errors import StorageError
from rhytid.storage.records import StoredRequest
from rhytid.storage.store import AssetStore
from storage.disk import Disk, PowerCutError

ID = "00112233aabbccdd"
State = dict[str, Any]
Change = Callable[[AssetStore], None]


def state(folder: Path) -> State:
    """Everything that a fresh opening of the store serves; reading verifies every byte."""
    with AssetStore(folder) as store:
        requests = {id: store.request(id).settings for id in store.pending()}
        assets = {id: (store.asset(id).settings, store.overlay(id)) for id in store.ids()}
    assert not any((folder / "partial").iterdir())
    for home in (folder / "assets").iterdir():
        assert (home / "request").is_dir() != (home / "asset").is_dir(), "one of the two is swept"
    return {"requests": requests, "assets": assets}


@pytest.fixture(
    params=["first request", "build", "build unasked", "take in", "overlay", "delete", "forget"]
)
def change(
    request: pytest.FixtureRequest,
    mesh: Mesh,
    graph: WrinkleGraph,
    settings: AssetSettings,
    tmp_path: Path,
) -> tuple[list[Change], Change]:
    """What was done before, and the change that fails."""

    def ask(store: AssetStore) -> None:
        store.put_request(ID, StoredRequest(mesh, settings, graph))

    def build(store: AssetStore) -> None:
        store.put_asset(ID, mesh, graph, settings, {})

    def take_in(store: AssetStore) -> None:
        store.snapshots.restore(tmp_path / "snapshot")

    def first_overlay(store: AssetStore) -> None:
        store.put_overlay(ID, settings.with_r_max(0.11))

    def second_overlay(store: AssetStore) -> None:
        store.put_overlay(ID, settings.with_r_max(0.22))

    def delete(store: AssetStore) -> None:
        store.delete(ID)

    with AssetStore(tmp_path / "source") as source:
        facts = {"spacing": 0.5, "distance": 0.5, "uv_length": 10.0, "warnings": []}
        source.put_asset(ID, mesh, graph, settings, facts)
        with source.snapshots.of(ID) as made:
            (tmp_path / "snapshot").write_bytes(b"".join(made.pieces()))
    cases: dict[str, tuple[list[Change], Change]] = {
        "first request": ([], ask),
        "build": ([ask], build),
        "build unasked": ([], build),
        "take in": ([ask], take_in),
        "overlay": ([build, first_overlay], second_overlay),
        "delete": ([ask, build, first_overlay], delete),
        "forget": ([ask], delete),
    }
    return cases[request.param]


def prepared(folder: Path, before: list[Change]) -> AssetStore:
    store = AssetStore(folder)
    for step in before:
        step(store)
    return store


def steps_of(folder: Path, before: list[Change], act: Change) -> tuple[int, State, State]:
    """How many steps the change takes, the state before it and the state after it."""
    prepared(folder, before).close()
    old = state(folder)
    with AssetStore(folder) as store, pytest.MonkeyPatch.context() as patch:
        disk = Disk(patch, fatal=10**9)
        act(store)
    return disk.steps, old, state(folder)


@pytest.mark.parametrize("full", [False, True], ids=["power cut", "disk full"])
def test_every_step_can_fail(
    tmp_path: Path, change: tuple[list[Change], Change], full: bool
) -> None:
    before, act = change
    count, old, new = steps_of(tmp_path / "whole", before, act)
    assert count >= 3
    assert old != new
    seen = []
    for fatal in range(1, count + 1):
        folder = tmp_path / str(fatal)
        with prepared(folder, before) as store, pytest.MonkeyPatch.context() as patch:
            Disk(patch, fatal, full=full)
            with suppress(StorageError if full else PowerCutError):
                act(store)
        seen.append(state(folder))
        assert seen[-1] in (old, new), f"between two states after step {fatal}"
    turned = seen.index(new) if new in seen else count
    assert seen == [old] * turned + [new] * (count - turned)


def test_disk_full_is_a_storage_error_and_leaves_nothing(
    folder: Path, store: AssetStore, mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings
) -> None:
    with pytest.MonkeyPatch.context() as patch:
        Disk(patch, fatal=4, full=True)
        with pytest.raises(StorageError, match=f"asset {ID} cannot be written.*No space left"):
            store.put_asset(ID, mesh, graph, settings, {})
    assert store.ids() == []
    assert not any((folder / "partial").iterdir())
    store.put_asset(ID, mesh, graph, settings, {})
    assert store.asset(ID).settings == settings


def test_everything_is_synced_before_it_is_visible(
    store: AssetStore, mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings
) -> None:
    with pytest.MonkeyPatch.context() as patch:
        disk = Disk(patch, fatal=10**9)
        store.put_asset(ID, mesh, graph, settings, {})
    names = [name for name, _ in disk.log]
    moved = [(at, Path(to).name) for at, (name, to) in enumerate(disk.log) if name == "replace"]
    assert [name for _, name in moved[:2]] == ["overlay.json", "asset"]
    at = moved[0][0]
    written = names[:at].count("open")
    assert written == 5
    assert names[:at].count("fsync") == written + 2, "each file, its folder and the list of assets"
    assert names[at : at + 4] == ["replace", "fsync"] * 2


def test_interrupted_build_is_pending_after_a_restart(
    folder: Path, mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings
) -> None:
    with AssetStore(folder) as store:
        store.put_request(ID, StoredRequest(mesh, settings, None))
        with pytest.MonkeyPatch.context() as patch:
            Disk(patch, fatal=5)
            with pytest.raises(PowerCutError):
                store.put_asset(ID, mesh, graph, settings, {})
    with AssetStore(folder) as store:
        assert store.pending() == [ID]
        store.put_asset(ID, mesh, graph, store.request(ID).settings, {})
        assert (store.pending(), store.ids()) == ([], [ID])
