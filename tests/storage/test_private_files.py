"""What is stored is for its owner alone, or for the group that the user lets in."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.expressions import Expressions
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.fleet.fleet_store import FleetStore
from rhytid.fleet.local_place import LocalPlace
from rhytid.fleet.options import FleetOptions
from rhytid.storage.records import StoredRequest
from rhytid.storage.shared.mirror import StoreMirror
from rhytid.storage.shared.shared_store import SharedStore
from rhytid.storage.store import AssetStore
from rhytid.support.atomic_files import atomic_write
from rhytid.support.settings import ServiceSettings

ID, OTHER = "00112233aabbccdd", "f" * 16
EXTRA = {"spacing": 0.5, "distance": 0.5, "uv_length": 10.0, "warnings": []}


@pytest.fixture(autouse=True)
def usual_umask() -> Iterator[None]:
    before = os.umask(0o022)
    yield
    os.umask(before)


def modes(folder: Path) -> set[tuple[str, int]]:
    """Of all that is in a folder, and of it."""
    kinds = {True: "folder", False: "file"}
    return {
        (kinds[path.is_dir()], stat.S_IMODE(path.stat().st_mode))
        for path in (folder, *folder.rglob("*"))
    }


PRIVATE = {("folder", 0o700), ("file", 0o600)}
GROUP = {("folder", 0o770), ("file", 0o660)}


def filled(
    store: AssetStore, mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings, shared: Path
) -> None:
    """Everything that a store may have, and a push of it."""
    store.put_request(OTHER, StoredRequest(mesh, settings, graph))
    store.put_asset(ID, mesh, graph, settings, EXTRA)
    store.put_overlay(ID, settings.with_r_max(0.2))
    moved = mesh.positions[None] + np.float32(1)
    store.put_shapes(ID, Expressions(moved, ("up",)))
    with store.packages.making(ID) as made:
        (made / "manifest.json").write_bytes(b"{}")
        store.packages.seal(made)
        store.packages.keep(ID, "0" * 32, made)
    StoreMirror(store, SharedStore.at(str(shared))).push(ID, lambda share, file: None)


def test_a_store_is_for_its_owner_alone(
    mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings, tmp_path: Path
) -> None:
    folder, place = tmp_path / "store", tmp_path / "place"
    place.mkdir()
    with AssetStore(folder) as store:
        filled(store, mesh, graph, settings, place)
        assert modes(folder) == PRIVATE
        with store.snapshots.of(ID) as made:
            (tmp_path / "snapshot").write_bytes(b"".join(made.pieces()))
    assert modes(folder) == PRIVATE
    with AssetStore(tmp_path / "restored") as store:
        store.snapshots.restore(tmp_path / "snapshot")
    assert modes(tmp_path / "restored") == PRIVATE
    with AssetStore(tmp_path / "fetched") as store:
        mirror = StoreMirror(store, SharedStore.at(str(place)))
        assert mirror.bring(ID, lambda share, file: None)
    assert modes(tmp_path / "fetched") == PRIVATE


def test_a_shared_store_is_for_its_owner_alone(
    mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings, tmp_path: Path
) -> None:
    place = tmp_path / "place"
    place.mkdir(mode=0o755)
    with AssetStore(tmp_path / "store") as store:
        filled(store, mesh, graph, settings, place)
    assert modes(place) == PRIVATE | {("folder", 0o755)}, "the folder of the user stays as it is"
    assert {path.name for path in place.iterdir() if path.stat().st_mode & 0o077} == set()


def test_a_group_that_may_write_shares_it(
    mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings, tmp_path: Path
) -> None:
    place = tmp_path / "place"
    place.mkdir()
    place.chmod(0o775)
    with AssetStore(tmp_path / "store") as store:
        filled(store, mesh, graph, settings, place)
        assert modes(place) == GROUP | {("folder", 0o775)}
        SharedStore.at(str(place)).check()
        assert modes(place) == GROUP | {("folder", 0o775)}
    assert modes(tmp_path / "store") == PRIVATE


def test_of_another_group_nobody_gets_what_is_not_made_for_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without the bit for the group, files of a folder have that of the process."""
    place, own = tmp_path / "place", os.getegid()
    place.mkdir()
    place.chmod(0o775)
    monkeypatch.setattr(os, "getegid", lambda: own + 1)
    SharedStore.at(str(place)).check()
    assert modes(place) == PRIVATE | {("folder", 0o775)}
    place.chmod(0o2775)
    SharedStore.at(str(place)).check()
    assert ("folder", 0o770) in {(kind, mode & 0o777) for kind, mode in modes(place)}


def opened_to_all(folder: Path) -> None:
    """As an earlier release made it."""
    for path in (folder, *folder.rglob("*")):
        path.chmod(0o755 if path.is_dir() else 0o644)


def test_of_an_earlier_store_nothing_can_be_reached_by_others(
    mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings, tmp_path: Path
) -> None:
    folder, place = tmp_path / "store", tmp_path / "place"
    place.mkdir()
    with AssetStore(folder) as store:
        filled(store, mesh, graph, settings, place)
    (folder / "packages" / "notes").touch()
    for top in (folder, place):
        opened_to_all(top)
    (folder / "format.json").write_bytes(b'{"format":1}')
    (folder / "cache").mkdir()
    AssetStore(folder).close()
    SharedStore.at(str(place)).check()
    (folder / "cache").rmdir()
    assert stat.S_IMODE((folder / "packages" / "notes").stat().st_mode) == 0o644, "of others"
    (folder / "packages" / "notes").unlink()
    assert modes(folder) == PRIVATE
    for part in (path for path in place.iterdir() if path.is_dir()):
        assert stat.S_IMODE(part.stat().st_mode) == 0o700, part

    (folder / "theirs").mkdir()
    folder.chmod(0o755)
    AssetStore(folder).close()
    assert stat.S_IMODE(folder.stat().st_mode) == 0o755, "something of others is in it"


def test_what_a_fleet_shares_is_for_its_owner_or_its_group(tmp_path: Path) -> None:
    for mode, wanted in ((0o755, PRIVATE), (0o770, GROUP)):
        store = tmp_path / f"{mode:o}"
        store.mkdir()
        store.chmod(mode)
        files = FleetStore.opened(ServiceSettings(), FleetOptions(store=store)).files
        files.put_upload(ID, "me", [b"mesh"])
        files.job_key()
        files.give([b"snapshot"])
        assert modes(store / "shared") == wanted
        assert stat.S_IMODE(store.stat().st_mode) == mode


def test_what_a_replica_keeps_is_for_its_owner_alone(tmp_path: Path) -> None:
    place = LocalPlace(tmp_path / "scratch")
    AssetStore(place.store).close()
    assert modes(tmp_path / "scratch") == PRIVATE
    place.close()


def test_files_for_the_user_have_the_modes_that_the_user_asks_for(tmp_path: Path) -> None:
    with atomic_write(tmp_path / "map.exr") as aside:
        aside.write_bytes(b"map")
    assert stat.S_IMODE((tmp_path / "map.exr").stat().st_mode) == 0o644
