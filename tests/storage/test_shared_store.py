"""A store that machines share: an asset is there as one writer left it, or not at all."""

from __future__ import annotations

import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.expressions import Expressions
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.errors import CancelledError, NotFoundError
from rhytid.storage.records import StoredRequest
from rhytid.storage.shared import shared_store
from rhytid.storage.shared.mirror import StoreMirror
from rhytid.storage.shared.shared_store import SharedStore
from rhytid.storage.snapshots import Snapshot
from rhytid.storage.store import AssetStore
from storage import shared_writer
from storage.backends import new_folder

ID = "00112233aabbccdd"
EXTRA = {"spacing": 0.5, "distance": 0.5, "uv_length": 10.0, "warnings": []}
# Files of the asset, and the manifest.
STEPS = 7
LONG = 120
# What a bucket answers is met by the other tests: each of these asks it some fifty times.
BUCKET_IS_SLOW = pytest.mark.parametrize(
    "place", ["folder", pytest.param("bucket", marks=pytest.mark.slow)], indirect=True
)


def quiet(share: float, file: str) -> None:
    """A report that nobody reads."""


@pytest.fixture
def filled(
    store: AssetStore, mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings
) -> AssetStore:
    """A store with an asset whose settings were changed since it was built, with shapes."""
    store.put_asset(ID, mesh, graph, settings, EXTRA)
    store.put_overlay(ID, settings.with_r_max(0.3))
    store.put_shapes(ID, shapes(mesh, "jawOpen"))
    return store


def shapes(mesh: Mesh, name: str) -> Expressions:
    values = np.random.default_rng(1).normal(size=(1, len(mesh.positions), 3))
    return Expressions.checked(values, len(mesh.positions), [name])


@pytest.fixture
def other(tmp_path: Path) -> Iterator[AssetStore]:
    with AssetStore(tmp_path / "other") as opened:
        yield opened


def taken(store: AssetStore) -> bytes:
    with store.snapshots.of(ID) as made:
        return b"".join(made.pieces())


def fetch(store: AssetStore, place: str) -> bool:
    """Put the asset of a shared store into a local one; whether both have the same then."""
    mirror = StoreMirror(store, SharedStore.at(place))
    with mirror.fetched(ID, quiet) as unpacked:
        return mirror.take(unpacked)


def writer(folder: Path, place: str, what: str, number: int) -> subprocess.Popen[bytes]:
    script = shared_writer.__file__
    command = [sys.executable, script, str(folder), place, ID, what, str(number)]
    return subprocess.Popen(command)


def test_the_asset_is_the_same_on_another_machine(
    filled: AssetStore, other: AssetStore, place: str
) -> None:
    shared = SharedStore.at(place)
    mirror = StoreMirror(filled, shared)
    assert (shared.ids(), mirror.is_pushed(ID)) == ([], False)

    assert mirror.push(ID, quiet)

    assert (shared.ids(), mirror.is_pushed(ID)) == ([ID], True)
    assert not mirror.push(ID, quiet), "all of it is there"
    assert fetch(other, place)
    assert taken(other) == taken(filled)
    assert StoreMirror(other, shared).is_pushed(ID)


def test_what_one_shared_store_has_another_lacks(filled: AssetStore, tmp_path: Path) -> None:
    first, second = (SharedStore.at(str(new_folder(tmp_path / name))) for name in "ab")
    StoreMirror(filled, first).push(ID, quiet)

    assert StoreMirror(filled, first).is_pushed(ID)
    assert not StoreMirror(filled, second).is_pushed(ID)


def test_changes_come_along(
    filled: AssetStore, other: AssetStore, settings: AssetSettings, place: str
) -> None:
    mirror = StoreMirror(filled, SharedStore.at(place))
    mirror.push(ID, quiet)
    filled.put_overlay(ID, settings.with_r_max(0.4))
    assert not mirror.is_pushed(ID)

    assert mirror.push(ID, quiet)

    assert fetch(other, place)
    assert other.overlay(ID) == settings.with_r_max(0.4)


@BUCKET_IS_SLOW
def test_a_push_leaves_what_another_machine_has_changed(
    filled: AssetStore, other: AssetStore, settings: AssetSettings, place: str, tmp_path: Path
) -> None:
    """The one has changed nothing since both had the same: it has nothing to say."""
    mirror, changing = (StoreMirror(one, SharedStore.at(place)) for one in (filled, other))
    mirror.push(ID, quiet)
    fetch(other, place)
    other.put_overlay(ID, settings.with_r_max(0.4))
    assert changing.push(ID, quiet)

    assert not mirror.push(ID, quiet)

    assert mirror.shared.index(ID) == other.snapshots.index(ID)
    assert (mirror.is_held(ID), mirror.is_pushed(ID)) == (True, True)
    filled.put_overlay(ID, settings.with_r_max(0.2))
    assert not mirror.is_held(ID)
    assert mirror.push(ID, quiet), "now it was changed here, too: the last stays"
    assert mirror.shared.index(ID) == filled.snapshots.index(ID)


@BUCKET_IS_SLOW
def test_an_asset_is_brought_as_another_machine_has_changed_it(
    filled: AssetStore, other: AssetStore, mesh: Mesh, settings: AssetSettings, place: str
) -> None:
    mirror, changing = (StoreMirror(one, SharedStore.at(place)) for one in (filled, other))
    with pytest.raises(NotFoundError, match=f"no asset {ID} in the shared store"):
        changing.bring(ID, quiet)
    assert not mirror.bring(ID, quiet), "it is here alone"
    mirror.push(ID, quiet)
    assert not mirror.bring(ID, quiet)
    assert changing.bring(ID, quiet)
    other.put_overlay(ID, settings.with_r_max(0.4))
    other.put_shapes(ID, shapes(mesh, "smile"))
    changing.push(ID, quiet)

    assert mirror.bring(ID, quiet)

    assert taken(filled) == taken(other)
    assert mirror.is_pushed(ID)
    filled.put_overlay(ID, settings.with_r_max(0.2))
    assert not mirror.bring(ID, quiet), "what was changed here stays"
    assert filled.overlay(ID) == settings.with_r_max(0.2)
    mirror.shared.remove(ID)
    assert not changing.bring(ID, quiet), "it is here alone"


def test_a_push_reads_what_it_sends_alone(
    filled: AssetStore, settings: AssetSettings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mirror, read = StoreMirror(filled, SharedStore.at(str(new_folder(tmp_path)))), []
    check = Snapshot.check_file

    def checked(made: Snapshot, name: str) -> None:
        read.append(name)
        check(made, name)

    monkeypatch.setattr(Snapshot, "check_file", checked)
    mirror.push(ID, quiet)
    assert len(read) == STEPS - 2
    read.clear()
    filled.put_overlay(ID, settings.with_r_max(0.4))
    assert mirror.push(ID, quiet)
    assert read == []


@BUCKET_IS_SLOW
def test_shapes_that_were_sent_here_stay(
    filled: AssetStore, other: AssetStore, mesh: Mesh, settings: AssetSettings, place: str
) -> None:
    StoreMirror(filled, SharedStore.at(place)).push(ID, quiet)
    other.put_request(ID, StoredRequest(mesh, settings, None))
    other.put_shapes(ID, shapes(mesh, "smile"))

    assert not fetch(other, place)

    assert other.pending() == []
    assert other.shapes(ID).names == ("smile",)
    assert not StoreMirror(other, SharedStore.at(place)).is_pushed(ID)


@BUCKET_IS_SLOW
def test_an_asset_is_there_once_its_manifest_is(
    filled: AssetStore, other: AssetStore, place: str
) -> None:
    """A push that ends before each of its steps; the next one completes it."""
    shared = SharedStore.at(place)
    for steps in range(STEPS):
        with pytest.raises(CancelledError), filled.snapshots.of(ID) as made:
            shared.push(made, stops_after(steps))
        assert shared.ids() == []
        with pytest.raises(NotFoundError, match=f"no asset {ID} in the shared store"):
            fetch(other, place)

    assert StoreMirror(filled, shared).push(ID, quiet)
    assert fetch(other, place)
    assert taken(other) == taken(filled)


def test_a_server_that_draws_otherwise_is_told(
    place: str,
    filled: AssetStore,
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Both have the same version of the package, and one another kernel."""
    caplog.set_level("WARNING")
    monkeypatch.setattr(shared_store, "_LOOK", 0.0)
    first = SharedStore.at(place)
    first.check()
    StoreMirror(filled, first).push(ID, quiet)
    SharedStore.at(place).check()
    assert caplog.messages == []

    with monkeypatch.context() as patch:
        patch.setattr(shared_store, "drawing_version", lambda: "0.1.0+other")
        SharedStore.at(place).check()
    assert len(caplog.messages) == 1
    assert "this one draws as 0.1.0+other" in caplog.messages[0]
    caplog.clear()
    for _ in range(2):
        first.index(ID)
    assert len(caplog.messages) == 1, "the one that was there first, once"
    assert "a rhytid that draws as 0.1.0+other" in caplog.messages[0]


def test_how_others_draw_is_looked_at_now_and_then(place: str, filled: AssetStore) -> None:
    """Not with each manifest, which would take twice as long."""
    shared = SharedStore.at(place)
    StoreMirror(filled, shared).push(ID, quiet)
    read, names = shared._backend.read, list[str]()

    def noted(name: str, most: int) -> bytes | None:
        names.append(name)
        return read(name, most)

    shared._backend.read = noted  # type: ignore[method-assign]
    for _ in range(5):
        shared.index(ID)
    assert names.count("drawing") == 1


def stops_after(steps: int) -> Callable[[float, str], None]:
    left = [None] * steps

    def report(share: float, file: str) -> None:
        assert 0 <= share <= 1
        if not left:
            raise CancelledError
        left.pop()

    return report


@BUCKET_IS_SLOW
def test_a_fetch_that_ends_leaves_nothing(
    filled: AssetStore, other: AssetStore, place: str, tmp_path: Path
) -> None:
    shared = SharedStore.at(place)
    StoreMirror(filled, shared).push(ID, quiet)
    mirror = StoreMirror(other, shared)
    for steps in range(STEPS - 1):
        with pytest.raises(CancelledError), mirror.fetched(ID, stops_after(steps)):
            pass
        assert other.ids() == []
        assert not any((tmp_path / "other" / "partial").iterdir())


@pytest.mark.parametrize(("what", "number"), [("until", 3), ("until", STEPS - 1), ("within", 2)])
def test_a_writer_that_is_killed_leaves_no_half(
    what: str, number: int, filled: AssetStore, folder: Path, tmp_path: Path
) -> None:
    place, whole = str(new_folder(tmp_path)), taken(filled)
    filled.close()
    with writer(folder, place, what, number) as killed:
        assert killed.wait(LONG) == -9

    with AssetStore(folder) as again, AssetStore(tmp_path / "other") as other:
        with pytest.raises(NotFoundError):
            fetch(other, place)
        assert sum(1 for file in Path(place).rglob("*") if file.is_file()) >= number
        StoreMirror(again, SharedStore.at(place)).push(ID, quiet)
        assert fetch(other, place)
        assert taken(other) == whole


@pytest.mark.parametrize("times", [30, pytest.param(300, marks=pytest.mark.slow)])
def test_readers_beside_two_writers_never_see_half(
    times: int, filled: AssetStore, folder: Path, tmp_path: Path
) -> None:
    """Two processes replace the settings of the asset all the time; a reader fetches it."""
    check_readers(filled, folder, str(new_folder(tmp_path)), tmp_path, times)


@pytest.mark.slow
def test_readers_beside_two_writers_of_a_bucket_never_see_half(
    filled: AssetStore, folder: Path, tmp_path: Path, bucket: str
) -> None:
    check_readers(filled, folder, bucket, tmp_path, 15)


def check_readers(filled: AssetStore, folder: Path, place: str, tmp_path: Path, times: int) -> None:
    filled.close()
    shutil.copytree(folder, tmp_path / "twin")
    shared, seen = SharedStore.at(place), set()
    with (
        writer(folder, place, "times", 100_000) as one,
        writer(tmp_path / "twin", place, "times", 100_000) as two,
        AssetStore(tmp_path / "other") as other,
    ):
        try:
            until = time.monotonic() + LONG
            while not shared.ids():
                assert time.monotonic() < until
                time.sleep(0.01)
            mirror = StoreMirror(other, shared)
            for _ in range(times):
                with mirror.fetched(ID, quiet) as found:
                    seen.add(found.settings.bins.r_max)
            assert (one.poll(), two.poll()) == (None, None), "they write all the time"
        finally:
            one.kill()
            two.kill()
    assert seen == {0.1, 0.2}
