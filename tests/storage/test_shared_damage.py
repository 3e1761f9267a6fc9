"""What is not as it was written in a shared store is named, and not taken."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.errors import (
    DiskFullError,
    InputError,
    NotFoundError,
    SharedDamageError,
    SharedStoreError,
    StorageError,
    StoreFormatError,
)
from rhytid.storage.canonical import hashed
from rhytid.storage.shared.bucket_backend import BucketBackend
from rhytid.storage.shared.folder_backend import FolderBackend
from rhytid.storage.shared.mirror import StoreMirror
from rhytid.storage.shared.shared_store import SharedStore
from rhytid.storage.store import AssetStore
from storage.backends import new_folder
from storage.disk import Disk, PowerCutError
from storage.test_shared_store import EXTRA, ID, fetch, quiet, taken

MANIFEST = f"manifests/{ID}.json"
Change = Callable[[Path], None]


@pytest.fixture
def pushed(
    store: AssetStore, mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings, tmp_path: Path
) -> Path:
    """A shared folder with an asset."""
    store.put_asset(ID, mesh, graph, settings, EXTRA)
    folder = new_folder(tmp_path)
    StoreMirror(store, SharedStore.at(str(folder))).push(ID, quiet)
    return folder


def objects(folder: Path) -> list[Path]:
    found = sorted((folder / "objects" / ID).iterdir())
    assert len(found) == 4
    return found


def flip(file: Path) -> None:
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 1
    file.write_bytes(data)


def cut(file: Path) -> None:
    file.write_bytes(file.read_bytes()[:-1])


def lengthen(file: Path) -> None:
    file.write_bytes(file.read_bytes() + b" ")


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (flip, "it does not have the SHA-256 that names it"),
        (cut, "bytes, the manifest says"),
        (lengthen, "bytes, the manifest says"),
        (Path.unlink, "is missing, and the manifest of the asset names it"),
    ],
)
@pytest.mark.parametrize("which", range(4))
def test_a_damaged_object_is_named(
    change: Change, why: str, which: int, pushed: Path, store: AssetStore, tmp_path: Path
) -> None:
    damaged, whole = objects(pushed)[which], taken(store)
    change(damaged)
    with AssetStore(tmp_path / "other") as other:
        with pytest.raises(SharedDamageError, match=why) as caught:
            fetch(other, str(pushed))
        assert str(damaged) in str(caught.value)
        assert other.ids() == []
        assert not any((tmp_path / "other" / "partial").iterdir())

        StoreMirror(store, SharedStore.at(str(pushed))).push(ID, quiet, anew=True)
        assert fetch(other, str(pushed))
        assert taken(other) == whole


@pytest.mark.parametrize("change", [flip, cut, lengthen])
def test_a_damaged_manifest_is_named_and_replaced(
    change: Change, pushed: Path, store: AssetStore, tmp_path: Path
) -> None:
    change(pushed / MANIFEST)
    with AssetStore(tmp_path / "other") as other:
        with pytest.raises(SharedDamageError, match=MANIFEST):
            fetch(other, str(pushed))

        assert StoreMirror(store, SharedStore.at(str(pushed))).push(ID, quiet)
        assert fetch(other, str(pushed))


def test_a_manifest_of_another_asset_is_refused(pushed: Path, store: AssetStore) -> None:
    elsewhere = "f" * 16
    (pushed / MANIFEST).rename(pushed / "manifests" / f"{elsewhere}.json")

    with pytest.raises(
        SharedDamageError, match=f"{elsewhere}.json is damaged: it is of asset {ID}"
    ):
        SharedStore.at(str(pushed)).index(elsewhere)


def test_a_large_manifest_is_not_read(pushed: Path) -> None:
    (pushed / MANIFEST).write_bytes(bytes(1 << 20))

    with pytest.raises(SharedDamageError, match="it has 1048576 bytes: at most 65536"):
        SharedStore.at(str(pushed)).index(ID)


def test_a_manifest_of_a_newer_version_stays(pushed: Path, store: AssetStore) -> None:
    value = json.loads((pushed / MANIFEST).read_bytes())["value"]
    newer = hashed({**value, "format": 99})
    (pushed / MANIFEST).write_bytes(newer)
    mirror = StoreMirror(store, SharedStore.at(str(pushed)))

    for call in (lambda: mirror.shared.index(ID), lambda: mirror.push(ID, quiet)):
        with pytest.raises(StoreFormatError, match=f"{MANIFEST} is of format 99"):
            call()
    assert (pushed / MANIFEST).read_bytes() == newer


def test_an_asset_is_removed_with_its_objects(pushed: Path) -> None:
    shared = SharedStore.at(str(pushed))

    shared.remove(ID)

    assert shared.ids() == []
    assert [file for file in pushed.rglob("*") if file.is_file()] == [pushed / "format.json"]
    with pytest.raises(NotFoundError, match=f"no asset {ID} in the shared store"):
        shared.remove(ID)


@pytest.mark.parametrize("id", ["..", ".", "", "../objects", f"{ID}/", ID.upper()])
def test_what_is_no_id_removes_and_reads_nothing(id: str, pushed: Path) -> None:
    """A caller of DELETE chooses it."""
    (pushed / "notes.txt").write_text("of somebody else")
    shared, before = SharedStore.at(str(pushed)), sorted(pushed.rglob("*"))

    for call in (shared.remove, shared.index):
        with pytest.raises(NotFoundError, match="ids are 16 hexadecimal digits"):
            call(id)

    assert sorted(pushed.rglob("*")) == before


def test_an_asset_is_removed_from_a_bucket(store: AssetStore, pushed: Path, bucket: str) -> None:
    mirror = StoreMirror(store, SharedStore.at(bucket))
    mirror.push(ID, quiet)

    mirror.shared.remove(ID)

    place = BucketBackend(bucket)
    assert (place.names("manifests"), place.names(f"objects/{ID}")) == ([], [])


def test_a_reader_of_what_is_replaced_begins_again(
    pushed: Path, store: AssetStore, settings: AssetSettings, tmp_path: Path
) -> None:
    """Between its manifest and its objects the asset is removed and pushed with other settings."""
    shared, turns = SharedStore.at(str(pushed)), 0
    mirror = StoreMirror(store, shared)
    store.put_overlay(ID, settings.with_r_max(0.35))

    def replace(share: float, file: str) -> None:
        nonlocal turns
        turns += 1
        if turns == 1:
            shared.remove(ID)
            mirror.push(ID, quiet)

    with (
        AssetStore(tmp_path / "other") as other,
        StoreMirror(other, shared).fetched(ID, replace) as found,
    ):
        assert found.settings.bins.r_max == 0.35
    assert turns > 4


def test_a_reader_of_what_is_removed_finds_nothing(pushed: Path, tmp_path: Path) -> None:
    shared = SharedStore.at(str(pushed))
    with (
        AssetStore(tmp_path / "other") as other,
        pytest.raises(NotFoundError),
        StoreMirror(other, shared).fetched(ID, lambda *_: _remove(shared)),
    ):
        pass


def test_an_asset_that_is_damaged_here_is_not_pushed(
    pushed: Path, store: AssetStore, folder: Path, tmp_path: Path
) -> None:
    flip(folder / "assets" / ID / "asset" / "graph.safetensors")
    shared = SharedStore.at(str(new_folder(tmp_path / "another")))

    with pytest.raises(StorageError, match=r"graph.safetensors is damaged"):
        StoreMirror(store, shared).push(ID, quiet)

    assert shared.ids() == []


def test_an_asset_that_is_removed_while_it_is_pushed_is_no_fault_of_the_shared_store(
    store: AssetStore, mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings, place: str
) -> None:
    store.put_asset(ID, mesh, graph, settings, EXTRA)
    shared = SharedStore.at(place)

    def removes(share: float, file: str) -> None:
        if store.ids():
            store.delete(ID)

    with pytest.raises(NotFoundError, match=f"asset {ID} was removed while it was pushed"):
        StoreMirror(store, shared).push(ID, removes)
    assert shared.ids() == []


@pytest.mark.parametrize("gone", ["folder", "file and folder"])
def test_a_folder_that_is_removed_beside_a_push_does_not_keep_it(
    gone: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As another machine removes the asset, at the worst of moments."""
    place, tries = FolderBackend(new_folder(tmp_path)), 0
    place.check()

    def install(aside: Path, path: Path) -> None:
        nonlocal tries
        tries += 1
        if gone != "folder":
            aside.replace(path)
            path.unlink()
        path.parent.rmdir()
        if tries > 100:
            raise PowerCutError
        raise FileNotFoundError(path)

    monkeypatch.setattr("rhytid.support.atomic_files.install", install)
    with pytest.raises(SharedStoreError, match=f"objects/{ID} is being removed"):
        place.write(f"objects/{ID}/one", b"data")


def _remove(shared: SharedStore) -> None:
    if shared.ids():
        shared.remove(ID)


@pytest.mark.parametrize("full", [True, False])
def test_a_push_that_fails_at_any_step_leaves_no_half(
    full: bool, store: AssetStore, pushed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A full disk or a power cut: the asset is there whole, or not at all."""
    failed = 0
    for step in range(1, 200):
        folder = new_folder(tmp_path / f"{full}{step}")
        mirror = StoreMirror(store, SharedStore.at(str(folder)))
        with monkeypatch.context() as patch:
            disk = Disk(patch, step, full=full)
            with suppress(DiskFullError, PowerCutError):
                mirror.push(ID, quiet)
        with AssetStore(tmp_path / f"other{full}{step}") as other:
            if mirror.shared.ids():
                assert fetch(other, str(folder))
                assert taken(other) == taken(store)
            else:
                failed += 1
        if disk.steps < step:
            break
    assert failed > 30


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("nowhere", "nowhere: no such folder; make it, or mount it"),
        ("gs://bucket/heads", "must be a folder, or like s3://bucket/prefix"),
        ("s3://", "must be a folder, or like s3://bucket/prefix"),
        ("s3://Bucket", "must be a folder, or like s3://bucket/prefix"),
    ],
)
def test_what_is_no_place_is_refused(
    text: str, why: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)

    with pytest.raises(InputError, match=why):
        SharedStore.at(text)


def test_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "s3fs", None)

    with pytest.raises(
        InputError, match=r"needs the extra s3; in a clone of rhytid: pip install '\.\[s3\]'"
    ):
        SharedStore.at("s3://skin")


def test_a_folder_that_is_gone_is_not_an_empty_one(pushed: Path, tmp_path: Path) -> None:
    shared = SharedStore.at(str(pushed))
    pushed.rename(tmp_path / "unmounted")

    for call in (shared.ids, shared.check, lambda: shared.index(ID)):
        with pytest.raises(SharedStoreError, match=str(pushed)):
            call()


def test_a_bucket_that_is_not_there_is_named(bucket: str) -> None:
    with pytest.raises(SharedStoreError, match="s3://no-such-bucket/heads cannot be read"):
        SharedStore.at("s3://no-such-bucket/heads").check()
    SharedStore.at(bucket).check()


def test_a_server_that_does_not_answer_is_named(
    bucket: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9")

    with pytest.raises(SharedStoreError, match=rf"{bucket}/format.json cannot be read"):
        SharedStore.at(bucket).index(ID)
