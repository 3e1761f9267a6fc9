"""What is not ours stays as it is: files, folders and links, in every place that is swept."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.errors import InputError, StorageError, StoreFormatError
from rhytid.fleet.fleet_store import FleetStore
from rhytid.fleet.local_place import LocalPlace
from rhytid.fleet.options import FleetOptions
from rhytid.storage.shared.mirror import StoreMirror
from rhytid.storage.shared.shared_store import SharedStore
from rhytid.storage.store import AssetStore
from rhytid.support import ownership
from rhytid.support.atomic_files import sweep
from rhytid.support.settings import ServiceSettings
from rhytid.support.temporary_folders import (
    remove_temporary_folders,
    removed_on_abort,
    temporary_folder,
)

ID, UNIQUE = "00112233aabbccdd", "0123456789abcdef" * 2
EXTRA = {"spacing": 0.5, "distance": 0.5, "uv_length": 10.0, "warnings": []}
Tree = dict[str, tuple[int, bytes | str | None]]


def tree(folder: Path) -> Tree:
    """Everything in a folder: its mode, and its bytes or where it points to."""

    def facts(path: Path) -> tuple[int, bytes | str | None]:
        mode = path.lstat().st_mode
        if path.is_symlink():
            return mode, str(path.readlink())
        return mode, path.read_bytes() if path.is_file() else None

    found = {str(path.relative_to(folder)): facts(path) for path in folder.rglob("*")}
    return {**found, ".": facts(folder)}


def made_long_ago(folder: Path) -> None:
    """Give all that is in a folder, and the folder, times of 2001."""
    for path in (*folder.rglob("*"), folder):
        os.utime(path, (1e9, 1e9), follow_symlinks=False)


def opened(folder: Path) -> None:
    AssetStore(folder).close()


def shared(folder: Path) -> None:
    SharedStore.at(str(folder)).check()


def fleet(folder: Path) -> None:
    settings = ServiceSettings()
    if folder.name != "shared":  # named by --shared-store
        settings = replace(settings, shared_store=str(folder))
    store = FleetStore.opened(settings, FleetOptions(store=folder.parent))
    store.assets.check()
    store.files.sweep()


def written(path: Path, text: str = "mine") -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def linked(path: Path, to: Path) -> None:
    written(to / "precious")
    written(to / UNIQUE / "precious")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.symlink_to(to)


# Folders of others that have a name which we use, by who opens what is around them.
IN_THE_WAY: dict[str, tuple[Callable[[Path], None], str, Callable[[Path], None]]] = {
    "store, a file in partial": (opened, "partial", lambda at: written(at / "partial/notes")),
    "store, a name of ours": (opened, "partial", lambda at: written(at / "partial" / UNIQUE / "a")),
    "store, a link": (opened, "partial", lambda at: linked(at / "partial", at.parent / "far")),
    "store, partial is a file": (opened, "partial", lambda at: written(at / "partial")),
    "store, packages": (opened, "packages", lambda at: written(at / "packages/app/index.js")),
    "store, assets": (opened, "assets", lambda at: written(at / "assets" / ID / "face.png")),
    "shared store, partial": (shared, "partial", lambda at: written(at / "partial/a/notes")),
    "shared store, a link": (shared, "partial", lambda at: linked(at / "partial", at.parent / "b")),
    "shared store, manifests": (shared, "manifests", lambda at: written(at / "manifests/a.json")),
    "shared store, objects": (shared, "objects", lambda at: written(at / "objects/a.o")),
    "fleet, given": (fleet, "given", lambda at: written(at / "given/notes")),
    "fleet, a link": (fleet, "given", lambda at: linked(at / "given", at.parent / "far")),
    "fleet, uploads": (fleet, "uploads", lambda at: written(at / "uploads/holiday.jpg")),
}


@pytest.mark.parametrize("case", IN_THE_WAY)
def test_what_is_in_the_way_is_named_and_nothing_is_changed(case: str, tmp_path: Path) -> None:
    use, name, put = IN_THE_WAY[case]
    folder = tmp_path / "project"
    written(folder / "readme.txt")
    put(folder)
    made_long_ago(tmp_path)
    before = tree(tmp_path)

    with pytest.raises((StorageError, InputError), match=rf"{folder / name} is not ours.*another"):
        use(folder)

    assert tree(tmp_path) == before


@pytest.mark.parametrize("use", [opened, shared, fleet])
def test_a_folder_with_other_things_is_of_use_and_they_stay(
    use: Callable[[Path], None], tmp_path: Path
) -> None:
    folder = tmp_path / "project"
    for name in ("readme.txt", f"{UNIQUE}/a", f".unfinished-{UNIQUE}/a", "part/ial"):
        written(folder / name)
    linked(folder / "link", tmp_path / "far")
    made_long_ago(tmp_path)
    before = tree(tmp_path)

    for _ in range(2):
        use(folder)

    assert before.items() <= tree(tmp_path).items()


def _strangers(partial: Path, far: Path) -> None:
    """What nobody of us has put there, but into a folder of ours."""
    linked(partial / ("a" * 32), far)
    (partial / ("b" * 32)).symlink_to(far / "precious")
    os.mkfifo(partial / ("c" * 32))
    written(partial / "notes")
    written(partial / "folder" / "notes")
    written(partial / UNIQUE.upper() / "notes")
    made_long_ago(partial)


@pytest.mark.parametrize(
    ("use", "partial"), [(opened, "partial"), (shared, "partial"), (fleet, "given")]
)
def test_in_a_folder_of_ours_the_rest_is_left_alone_and_named(
    use: Callable[[Path], None], partial: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = tmp_path / "ours"
    folder.mkdir()
    use(folder)
    place = folder / partial
    _strangers(place, tmp_path / "far")
    before = {name: facts for name, facts in tree_without_fifos(tmp_path).items() if name != "."}
    written(place / UNIQUE / "half" if partial == "partial" else place / UNIQUE)
    made_long_ago(place)

    use(folder)

    assert not (place / UNIQUE).exists(), "what we left there is swept"
    assert before.items() <= tree_without_fifos(tmp_path).items()
    assert f"left alone in {place}, not made by rhytid: " in caplog.text


def tree_without_fifos(folder: Path) -> Tree:
    hidden = [path for path in folder.rglob("*") if path.is_fifo()]
    modes = [path.lstat().st_mode for path in hidden]
    for path in hidden:
        path.unlink()
    found = tree(folder)
    for path, mode in zip(hidden, modes, strict=True):
        os.mkfifo(path, mode & 0o777)
        found[str(path.relative_to(folder))] = (mode, None)
    return found


def test_of_an_output_folder_only_marked_leftovers_are_swept(tmp_path: Path) -> None:
    for name in (".unfinished-business/a", f".unfinished-{UNIQUE}/a", f"{UNIQUE}/a"):
        written(tmp_path / name)
    linked(tmp_path / f".unfinished-{'a' * 32}", tmp_path / "far")
    written(tmp_path / f".unfinished-{'b' * 32}")
    made_long_ago(tmp_path)
    before = tree(tmp_path)

    sweep(tmp_path)
    sweep(tmp_path, lambda name: name == "a")

    assert tree(tmp_path) == before


def test_homes_that_hold_something_else_stay(
    folder: Path, mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings, tmp_path: Path
) -> None:
    opened(folder)
    written(folder / "assets" / ID / "notes")
    linked(folder / "assets" / ("f" * 16), tmp_path / "far")
    (folder / "assets" / ("e" * 16)).mkdir()  # of a change that was interrupted
    before = tree(folder)
    before.pop(f"assets/{'e' * 16}")

    opened(folder)

    assert tree(folder) == before


def test_removing_an_asset_that_is_a_link_leaves_what_it_points_to(
    folder: Path, mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings, tmp_path: Path
) -> None:
    with AssetStore(folder) as store:
        store.put_asset(ID, mesh, graph, settings, EXTRA)
        home = folder / "assets" / ID
        home.rename(tmp_path / "moved")
        home.symlink_to(tmp_path / "moved")
        before = tree(tmp_path / "moved")
        store.delete(ID)
        assert not any((folder / "partial").iterdir())
    assert tree(tmp_path / "moved") == before


@pytest.mark.parametrize("number", ["0", "replica-0"])
@pytest.mark.parametrize("what", ["files", "a store", "a link"])
def test_a_replica_removes_nothing_of_others(number: str, what: str, tmp_path: Path) -> None:
    scratch = tmp_path / "scratch"
    if what == "files":
        written(scratch / number / "film.mov")
    elif what == "a store":
        scratch.mkdir()
        opened(scratch / number)
    else:
        linked(scratch / number, tmp_path / "far")
    before = tree(tmp_path / "far" if what == "a link" else scratch / number)

    if number == "replica-0":
        with pytest.raises(StorageError, match=f"{scratch / number} is not ours"):
            LocalPlace(scratch)
    else:
        place = LocalPlace(scratch)
        opened(place.store)
        place.close()
        assert not place.store.exists()

    assert tree(tmp_path / "far" if what == "a link" else scratch / number) == before


def test_a_folder_that_took_the_place_of_an_unfinished_one_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "rhytid.support.temporary_folders._folders", {}
    )  # others of this process stay
    with temporary_folder("rhytid-", tmp_path) as ours, removed_on_abort(ours):
        written(ours / "half")
        ours.rename(tmp_path / "moved")
        written(ours / "of another")
        remove_temporary_folders()
        assert (ours / "of another").exists()
        shutil.rmtree(tmp_path / "moved")


def test_stores_of_the_last_release_are_opened_and_marked(
    folder: Path, mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings, tmp_path: Path
) -> None:
    place = tmp_path / "place"
    place.mkdir()
    with AssetStore(folder) as store:
        store.put_asset(ID, mesh, graph, settings, EXTRA)
        StoreMirror(store, SharedStore.at(str(place))).push(ID, lambda share, file: None)
        with store.snapshots.of(ID) as made:
            for name in ("assets", "uploads", "packages", "given"):
                (folder / "shared" / name).mkdir(parents=True)
            (folder / "shared" / "assets" / f"{ID}.tar").write_bytes(b"".join(made.pieces()))
    marker = folder / "format.json"
    marker.write_bytes(b'{"format":1}')
    (place / "format.json").unlink()
    for partial in (folder / "partial", place / "partial"):
        written(partial / UNIQUE / "half")
        made_long_ago(partial)

    with AssetStore(folder) as store:
        assert store.asset(ID).settings == settings
    again = SharedStore.at(str(place))
    again.check()
    assert again.holds(ID)
    fleet(folder / "shared")
    assert SharedStore.at(str(folder / "shared")).holds(ID)

    marked = (marker, place / "format.json", folder / "shared" / "format.json")
    assert [json.loads(path.read_bytes()) for path in marked] == [
        {"format": 1, "kind": f"rhytid {kind}"}
        for kind in ("store", "shared store", "shared store")
    ]
    assert [*(folder / "partial").iterdir(), *(place / "partial").iterdir()] == []


@pytest.mark.parametrize(
    ("use", "kind"), [(opened, "store"), (shared, "shared store"), (fleet, "fleet")]
)
def test_what_a_newer_release_made_is_said_to_be_that_and_left_alone(
    use: Callable[[Path], None], kind: str, tmp_path: Path
) -> None:
    folder = tmp_path / "newer"
    for name in ("partial", "assets", "objects", "given"):
        written(folder / name / UNIQUE)
    (folder / "format.json").write_text(json.dumps({"format": 2, "kind": f"rhytid {kind}"}))
    made_long_ago(folder)
    before = tree(folder)

    text = rf"{folder} was made by a newer release of rhytid \(format 2, this one reads up to 1\)"
    with pytest.raises(StoreFormatError, match=text):
        use(folder)

    assert tree(folder) == before


@pytest.mark.parametrize("other", [shared, fleet])
def test_a_store_is_not_taken_for_something_else(
    other: Callable[[Path], None], folder: Path
) -> None:
    opened(folder)
    before = tree(folder)

    with pytest.raises((StorageError, InputError), match=r"format\.json is not ours"):
        other(folder)

    assert tree(folder) == before


def test_a_format_without_a_kind_is_of_a_store_that_has_its_folders(folder: Path) -> None:
    written(folder / "format.json", '{"format": 1}')
    written(folder / "partial" / UNIQUE / "download")
    before = tree(folder)

    with pytest.raises(StorageError, match=f"{folder / 'partial'} is not ours"):
        opened(folder)

    assert tree(folder) == before


@pytest.mark.parametrize(
    "text",
    ['{"format": "3"}', '{"version": 1}', "[1]", '{"format": true}', '{"format": 1, "tool": "x"}'],
)
def test_a_format_file_of_others_is_not_a_marker(text: str, folder: Path) -> None:
    written(folder / "format.json", text)

    with pytest.raises(StorageError, match=r"format\.json is not ours"):
        opened(folder)

    assert [path.name for path in folder.iterdir()] == ["format.json"]


@pytest.mark.parametrize("use", [shared, fleet])
def test_servers_that_begin_together_take_a_folder_together(
    use: Callable[[Path], None], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second marks the folder and fills it while the first has just found no marker there."""
    folder.mkdir(exist_ok=True)
    read, others = ownership.read_plain, iter([use])

    def read_late(path: Path, most: int) -> bytes:
        try:
            return read(path, most)
        finally:
            for other in others:
                other(folder)
                for name in ("partial", "assets"):
                    if (folder / name).is_dir():
                        written(folder / name / f"{ID}.tar")

    monkeypatch.setattr(ownership, "read_plain", read_late)
    use(folder)
    assert (folder / "format.json").is_file()


def test_a_shared_store_that_may_only_be_read_is_read(
    store: AssetStore, mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings,
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    place = tmp_path / "place"
    place.mkdir()
    store.put_asset(ID, mesh, graph, settings, EXTRA)
    StoreMirror(store, SharedStore.at(str(place))).push(ID, lambda share, file: None)
    (place / "format.json").unlink()  # as the last release left it

    def refused(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("rhytid.support.atomic_files.install", refused)
    assert SharedStore.at(str(place)).holds(ID)


def test_a_folder_is_ours_until_it_is_gone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A process that ends while one is removed removes what is left of it."""
    monkeypatch.setattr("rhytid.support.temporary_folders._folders", {})
    cleanup = tempfile.TemporaryDirectory.cleanup

    def ends(made: tempfile.TemporaryDirectory[str]) -> None:
        remove_temporary_folders()
        assert not Path(made.name).exists()
        cleanup(made)

    monkeypatch.setattr(tempfile.TemporaryDirectory, "cleanup", ends)
    with temporary_folder("rhytid-", tmp_path) as folder:
        (folder / "part").touch()
    assert [*tmp_path.iterdir()] == []
