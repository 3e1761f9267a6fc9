"""A shared store that fails while servers use it: what is here goes on, nothing is lost."""

from __future__ import annotations

import errno
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from engine.engines import built, new_asset, rest, running
from engine.test_engine_shared import LONG, jobs, patiently
from rhytid.errors import FetchingError, NotFoundError, SharedStoreError, StoreFormatError
from rhytid.storage.shared.bucket_backend import BucketBackend
from rhytid.storage.shared.folder_backend import FolderBackend
from rhytid.storage.shared.shared_store import SharedStore
from storage.backends import new_folder


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return new_folder(tmp_path)


@pytest.fixture
def full(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[], None]]:
    """The disk of the shared folder is full, until this is called."""

    def fails(*arguments: Any, **named: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    mkdir, partial = Path.mkdir, folder / "partial"
    with monkeypatch.context() as patch:
        patch.setattr(FolderBackend, "_install", _reached(fails))
        patch.setattr(
            Path, "mkdir", lambda at, *a, **n: fails() if at == partial else mkdir(at, *a, **n)
        )
        yield patch.undo


def _reached(call: Callable[..., None]) -> Callable[..., None]:
    from rhytid.storage.shared.backend import reached

    def within(*arguments: Any) -> None:
        with reached("it cannot be written"):
            call()

    return within


def test_a_full_disk_stops_no_server_and_loses_no_push(
    folder: Path, tmp_path: Path, full: Callable[[], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rhytid.engine.shared_assets.PAUSE", 0.2)
    with running(tmp_path / "a") as engine:
        first = built(engine, new_asset())
    with running(tmp_path / "a", shared_store=str(folder)) as engine:
        second = built(engine, new_asset(seed=2))
        assert "failed" in jobs(engine, "push")
        full()
        shared, until = SharedStore.at(str(folder)), time.monotonic() + LONG
        while len(shared.ids()) < 2 and time.monotonic() < until:
            time.sleep(0.05)
        assert shared.ids() == sorted([first, second])


def test_while_the_store_is_away_one_asset_is_tried(
    folder: Path, tmp_path: Path, full: Callable[[], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    with running(tmp_path / "a") as engine:
        for seed in (1, 2, 3):
            built(engine, new_asset(seed=seed))
    with running(tmp_path / "a", shared_store=str(folder)) as engine:
        assert jobs(engine, "push") == []
        engine.shared._retries._again()
        assert jobs(engine, "push") == ["failed"]
        full()
        engine.shared._retries._again()
        rest(engine)  # the others begin before it ends
        assert jobs(engine, "push") == ["failed", "done", "done", "done"]


def test_an_asset_that_is_removed_here_before_its_push_is_found_there(
    folder: Path, tmp_path: Path
) -> None:
    with running(tmp_path / "a", shared_store=str(folder)) as engine:
        asset = built(engine, new_asset())
        engine.assets.delete(asset)
        engine.shared.push(asset)
        assert jobs(engine, "push") == ["done", "cancelled"]
        assert patiently(lambda: engine.assets.info(asset)).state == "ready"


def test_removals_from_a_silent_store_keep_few_callers(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rhytid.engine.shared_calls.TURN", 0.05)
    with running(tmp_path / "a", shared_store=str(folder)) as engine:
        for _ in range(4):
            engine.shared._calls._removing.acquire()
        with pytest.raises(FetchingError, match="is asked for other assets"):
            engine.assets.delete("0" * 16, shared=True)
        engine.shared._calls._removing.release(4)
        folder.rename(tmp_path / "unmounted")
        with pytest.raises(SharedStoreError):
            engine.assets.delete("0" * 16, shared=True)
        (tmp_path / "unmounted").rename(folder)
        with pytest.raises(SharedStoreError):
            engine.assets.delete("0" * 16, shared=True)


def test_what_is_no_id_is_not_found(folder: Path, tmp_path: Path) -> None:
    (folder / "notes.txt").write_text("of somebody else")
    with (
        running(tmp_path / "a", shared_store=str(folder)) as engine,
        pytest.raises(NotFoundError),
    ):
        engine.assets.delete("..", shared=True)
    assert (folder / "notes.txt").exists()


def test_a_bucket_of_a_newer_release_lets_no_server_start_and_is_left_alone(
    bucket: str, tmp_path: Path
) -> None:
    place, marker = BucketBackend(bucket), b'{"format": 2, "kind": "rhytid shared store"}'
    place.write("format.json", marker)
    text = r"was made by a newer release of rhytid \(format 2, this one reads up to 1\)"
    for _ in range(2):  # the local store is free again
        with (
            pytest.raises(StoreFormatError, match=f"{bucket} {text}"),
            running(tmp_path, shared_store=bucket),
        ):
            pass
    assert place.read("format.json", 100) == marker
