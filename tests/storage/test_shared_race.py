"""An asset that is removed from a shared store while another machine pushes it: whole, or gone."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.errors import NotFoundError, SharedDamageError, SharedStoreError
from rhytid.storage.shared.folder_backend import FolderBackend
from rhytid.storage.shared.mirror import StoreMirror
from rhytid.storage.shared.shared_store import SharedStore
from rhytid.storage.store import AssetStore

ID = "00112233aabbccdd"
MANIFEST = f"manifests/{ID}.json"
EXTRA = {"spacing": 0.5, "distance": 0.5, "uv_length": 10.0, "warnings": []}


class Watched(FolderBackend):
    """A place that does something else once, before the nth call of a method with such a name."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.before: tuple[str, str, Callable[[], object]] | None = None

    def _reach(self, call: str, name: str) -> None:
        if self.before is not None and call == self.before[0] and name.startswith(self.before[1]):
            act, self.before = self.before[2], None
            act()

    def write(self, name: str, data: bytes) -> None:
        self._reach("write", name)
        super().write(name, data)

    def names(self, folder: str) -> list[str]:
        self._reach("names", folder)
        return super().names(folder)

    def remove(self, name: str) -> bool:
        self._reach("remove", name)
        return super().remove(name)


@pytest.fixture
def places(tmp_path: Path) -> tuple[Watched, SharedStore]:
    """The place as one machine watches it, and the shared store of another."""
    (tmp_path / "place").mkdir()
    return Watched(tmp_path / "place"), SharedStore.at(str(tmp_path / "place"))


@pytest.fixture
def built(
    store: AssetStore, mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings
) -> AssetStore:
    store.put_asset(ID, mesh, graph, settings, EXTRA)
    return store


def quiet(share: float, file: str) -> None:
    pass


def push(store: AssetStore, shared: SharedStore) -> bool:
    return StoreMirror(store, shared).push(ID, quiet)


def is_whole_or_gone(shared: SharedStore) -> bool:
    """Whether the asset is there with all of its objects; raises where only the manifest is."""
    if ID not in shared.ids():
        return False
    assert shared.holds(ID), "the manifest is there, and objects are not"
    return True


@pytest.mark.parametrize("pushed_before", [False, True])
def test_all_of_it_is_removed_just_before_the_manifest_is_written(
    pushed_before: bool, built: AssetStore, places: tuple[Watched, SharedStore]
) -> None:
    watched, other = places
    if pushed_before:
        push(built, other)
        built.put_overlay(ID, built.asset(ID).settings.with_r_max(0.3))

    def remove() -> None:
        if pushed_before:
            other.remove(ID)
        else:
            with pytest.raises(NotFoundError):
                other.remove(ID)

    watched.before = ("write", MANIFEST, remove)
    assert push(built, SharedStore(watched))
    assert is_whole_or_gone(other)


@pytest.mark.parametrize("call", ["names", "remove"])
def test_it_is_pushed_while_its_objects_are_removed(
    call: str, built: AssetStore, places: tuple[Watched, SharedStore]
) -> None:
    watched, other = places
    push(built, other)
    watched.before = (call, f"objects/{ID}", lambda: push(built, other))
    SharedStore(watched).remove(ID)
    assert not is_whole_or_gone(other)
    assert push(built, other), "it can be pushed again"
    assert is_whole_or_gone(other)


def test_objects_that_cannot_be_written_again_take_the_manifest_with_them(
    built: AssetStore, places: tuple[Watched, SharedStore]
) -> None:
    watched, other = places

    def remove() -> None:
        with pytest.raises(NotFoundError):
            other.remove(ID)
        built.delete(ID)

    watched.before = ("write", MANIFEST, remove)
    with pytest.raises(NotFoundError, match="was removed while it was pushed"):
        push(built, SharedStore(watched))
    assert not is_whole_or_gone(other)


def test_whatever_the_order_of_pushes_and_removals(
    built: AssetStore, places: tuple[Watched, SharedStore], tmp_path: Path
) -> None:
    place = str(tmp_path / "place")

    def keep_removing() -> None:
        mine = SharedStore.at(place)
        for _ in range(40):
            with suppress(NotFoundError, SharedStoreError):
                mine.remove(ID)

    removing = threading.Thread(target=keep_removing)
    removing.start()
    shared = SharedStore.at(place)
    while removing.is_alive():
        with suppress(SharedStoreError):
            StoreMirror(built, shared).push(ID, quiet, anew=True)
    removing.join()
    is_whole_or_gone(shared)


SPECIAL: dict[str, Callable[[Path, Path], None]] = {
    "a link to a device": lambda path, far: path.symlink_to("/dev/zero"),
    "a link to a file": lambda path, far: path.symlink_to(far),
    "a link to itself": lambda path, far: path.symlink_to(path),
    "a pipe": lambda path, far: os.mkfifo(path),
    "a folder": lambda path, far: path.mkdir(),
}


@pytest.mark.parametrize("kind", SPECIAL)
@pytest.mark.parametrize("what", ["manifest", "object", "marker"])
def test_only_plain_files_of_a_bounded_length_are_read(
    kind: str, what: str, built: AssetStore, places: tuple[Watched, SharedStore], tmp_path: Path
) -> None:
    _, other = places
    push(built, other)
    place = tmp_path / "place"
    named = {"manifest": MANIFEST, "object": "objects/*/*", "marker": "format.json"}
    [path, *_] = sorted(place.glob(named[what]))
    path.rename(tmp_path / "far")
    SPECIAL[kind](path, tmp_path / "far")

    def read() -> None:
        with AssetStore(tmp_path / "other") as here:
            StoreMirror(here, SharedStore.at(str(place))).bring(ID, quiet)

    found: list[BaseException] = []

    def noted() -> None:
        try:
            read()
        except (SharedDamageError, SharedStoreError) as error:
            found.append(error)

    reading = threading.Thread(target=noted, daemon=True)
    reading.start()
    reading.join(60)  # a pipe would be waited for, and a device has no end
    assert not reading.is_alive()
    assert "no plain file" in str(found[0])
    if what != "marker" and kind != "a folder":
        damaged = SharedStore.at(str(place))
        StoreMirror(built, damaged).push(ID, quiet, anew=True)
        assert is_whole_or_gone(damaged)
    if path.is_fifo():
        path.unlink()


@pytest.mark.parametrize("step", range(5))
def test_a_process_that_ends_within_a_push_beside_a_removal_leaves_nothing_that_stays_broken(
    step: int, built: AssetStore, tmp_path: Path
) -> None:
    """The removal comes where the writer ends: before each file, and before the manifest."""
    place, folder = tmp_path / "place", tmp_path / "writer"
    place.mkdir()
    shared = SharedStore.at(str(place))
    push(built, shared)
    with built.snapshots.of(ID) as made, AssetStore(folder) as other:
        (tmp_path / "face.tar").write_bytes(b"".join(made.pieces()))
        other.snapshots.restore(tmp_path / "face.tar")
    built.put_overlay(ID, built.asset(ID).settings.with_r_max(0.3))
    script = Path(__file__).with_name("shared_writer.py")
    writer = subprocess.Popen(
        [sys.executable, script, folder, place, ID, "until", str(step)],
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])},
    )
    while writer.poll() is None:
        with suppress(NotFoundError):
            shared.remove(ID)
    assert writer.returncode == -signal.SIGKILL
    with AssetStore(tmp_path / "reader") as reader:
        mirror = StoreMirror(reader, shared)
        # Not there, or half of it, which is said and not taken.
        with pytest.raises((NotFoundError, SharedDamageError), match=r"no asset|is missing"):
            mirror.bring(ID, quiet)
        assert not mirror.has(ID)
    push(built, shared)
    assert is_whole_or_gone(shared), "the next push completes it"
    shared.remove(ID)
    assert not list(place.glob("objects/*/*")), "a removal takes what the ended process left"
