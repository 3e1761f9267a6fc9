"""What a fleet keeps in its shared store beside the assets, in a folder and in a bucket."""

from __future__ import annotations

import errno
import os
import pickle
import shutil
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from engine.engines import new_asset
from rhytid.domain.asset_settings import AssetSettings
from rhytid.engine.messages import AssetInfo, Package
from rhytid.errors import NotFoundError, SharedDamageError, SharedStoreError, StorageError
from rhytid.fleet.shared_files import SharedFiles, read_upload, written_upload
from rhytid.storage.shared import backend_of

ASSET = "0123456789abcdef"
STRANGE = ["\0", "a" * 300, "..", "../assets/0123456789abcdef", "0123456789ABCDEF", " ", "é" * 16]


@pytest.fixture
def files(place: str) -> SharedFiles:
    return SharedFiles(backend_of(place))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "here"
    made.mkdir()
    return made


def test_an_upload_is_there_until_it_is_removed(files: SharedFiles) -> None:
    assert (files.uploads(), files.owner(ASSET), files.upload(ASSET)) == ([], None, None)
    files.put_upload(ASSET, "one", [b"a", b"b"])
    assert (files.uploads(), files.owner(ASSET), files.upload(ASSET)) == ([ASSET], "one", b"ab")
    files.own(ASSET, "two")
    assert files.owner(ASSET) == "two"
    for _ in range(2):
        files.remove(ASSET)
        assert (files.uploads(), files.owner(ASSET)) == ([], None)


def test_an_upload_that_cannot_be_kept_is_not_there(files: SharedFiles) -> None:
    def cut() -> Any:
        yield b"half"
        raise OSError(errno.ENOSPC, "No space left on device")

    with pytest.raises(StorageError, match="No space left"):
        files.put_upload(ASSET, "one", cut())
    assert (files.uploads(), files.owner(ASSET)) == ([], None)


def test_a_given_file_is_there_until_it_was_taken(files: SharedFiles) -> None:
    name = files.give([b"snap", b"shot"])
    with files.given(name) as file:
        assert file.read() == b"snapshot"
    files.remove_given(name)
    with pytest.raises(SharedStoreError, match="is gone"), files.given(name):
        pass


def test_a_given_file_of_a_folder_is_read_where_it_is(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A snapshot has gigabytes: no second copy of it has to fit into the temporary folder."""
    monkeypatch.setattr("rhytid.fleet.shared_files.temporary_folder", None)
    files = SharedFiles(backend_of(str(folder)))
    name = files.give([b"snap", b"shot"])
    with files.given(name) as file:
        files.remove_given(name)
        assert file.read() == b"snapshot"
    (folder / "given").mkdir(exist_ok=True)
    (folder / name).symlink_to("/dev/zero")
    with pytest.raises(SharedDamageError, match="no plain file"), files.given(name):
        pass
    shutil.rmtree(folder)
    with pytest.raises(SharedStoreError, match="is it mounted"), files.given(name):
        pass


def test_few_packages_of_an_asset_stay(files: SharedFiles, tmp_path: Path) -> None:
    source = tmp_path / "made.zip"
    for number in range(6):
        source.write_bytes(b"zip %d" % number)
        shared = files.share_package(ASSET, Package(f"key{number}", source, 5, {}))
        found = files.package(shared)
        assert found.file.read_bytes() == b"zip %d" % number
        assert files.package(shared).file == found.file
    assert len(files._packages(ASSET)) == 4
    files.remove(ASSET)
    assert files._packages(ASSET) == {}


def test_a_package_is_copied_once_however_many_ask(tmp_path: Path) -> None:
    """A page asks for all files of a package at once."""
    fetched: list[Path] = []

    class Bucket:
        def local(self, name: str) -> None:
            return None

        def fetch(self, name: str, to: Path) -> bool:
            fetched.append(to)
            time.sleep(0.1)
            to.write_bytes(b"a zip")
            return True

    files = SharedFiles(cast(Any, Bucket()))
    shared = Package("key", Path(f"packages/{ASSET}-key.zip"), 5, {})
    with ThreadPoolExecutor(4) as pool:
        found = {one.file for one in pool.map(files.package, [shared] * 4)}
    assert found == set(fetched)
    assert len(fetched) == 1


def test_what_callers_see_is_said_of_one_manifest(files: SharedFiles) -> None:
    settings = AssetSettings().as_json()
    info = AssetInfo(ASSET, "ready", None, None, settings, (1001,), 9, 4, 2, 0, 0)
    assert files.info(ASSET, "a digest") is None
    files.put_info(info, "a digest")
    assert files.info(ASSET, "a digest") == info
    assert files.info(ASSET, "another") is None
    assert files.info(ASSET, "") is None


WRITER = """
import os, signal, sys
from pathlib import Path
from rhytid.fleet.shared_files import SharedFiles
from rhytid.storage.shared import backend_of
def pieces():
    yield b"half"
    os.kill(os.getpid(), signal.SIGKILL)
files = SharedFiles(backend_of(sys.argv[1]))
files.give(pieces()) if sys.argv[2] == "given" else files.put_upload("0" * 16, "me", pieces())
"""


@pytest.mark.parametrize("place", ["uploads", "given"])
def test_a_writer_that_is_killed_leaves_nothing_that_is_seen(folder: Path, place: str) -> None:
    backend = backend_of(str(folder))
    files = SharedFiles(backend)
    files.put_upload(ASSET, "other", [b"whole"])
    ended = subprocess.run([sys.executable, "-c", WRITER, str(folder), place])
    assert ended.returncode == -signal.SIGKILL
    assert files.uploads() == [ASSET]
    assert {path.name for path in folder.rglob("*") if path.is_file()} >= {ASSET, f"{ASSET}.owner"}
    assert not list(folder.glob("given/*"))
    [left] = (folder / "partial").iterdir()
    backend.check()
    assert left.exists(), "its writer may be at work"
    day = time.time() - 90_000
    os.utime(left, (day, day))
    backend.check()
    assert not left.exists()
    assert files.upload(ASSET) == b"whole"


def test_what_was_given_and_never_taken_goes_a_day_later(folder: Path) -> None:
    files = SharedFiles(backend_of(str(folder)))
    old, new = (folder / files.give([b"a"]) for _ in range(2))
    strange = folder / "given" / "notes"
    strange.write_text("mine")
    day = time.time() - 90_000
    for path in (old, strange):
        os.utime(path, (day, day))
    files.sweep()
    assert [path.exists() for path in (old, new, strange)] == [False, True, True]


def test_what_was_given_goes_from_a_bucket_too(
    bucket: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    backend = backend_of(bucket)
    files = SharedFiles(backend)
    files.give([b"a"])
    backend.write("given/notes", b"mine")
    files.sweep()
    assert len(backend.names("given")) == 2
    monkeypatch.setattr("rhytid.fleet.shared_files._ABANDONED", -60.0)
    files.sweep()
    assert backend.names("given") == ["notes"]


@pytest.mark.parametrize("strange", STRANGE)
def test_what_is_no_id_becomes_no_name_of_an_object(folder: Path, strange: str) -> None:
    files = SharedFiles(backend_of(str(folder)))
    asks: Any = (files.owner, files.upload, files.remove, lambda id: files.info(id, "a digest"))
    for ask in asks:
        with pytest.raises(NotFoundError, match="no asset"):
            ask(strange)


def test_an_upload_that_is_kept_comes_back() -> None:
    new = replace(new_asset(), frames=np.zeros((2, 9, 3), np.float32))
    data = b"".join(written_upload(new))
    found = read_upload(data)
    assert np.array_equal(found.mesh.positions, new.mesh.positions)
    assert found.settings == new.settings
    assert found.frames is not None
    assert found.frames.shape == (2, 9, 3)
    for wrong in (b"", data[:40], data[:-1000], b"\x00" * len(data)):
        with pytest.raises(StorageError, match="damaged"):
            read_upload(wrong)


class Harm:
    def __reduce__(self) -> Any:
        return print, ("harm",)


def test_an_upload_runs_no_code() -> None:
    body = pickle.dumps(Harm())
    data = len(body).to_bytes(8, "little") + bytes(8) + body
    with pytest.raises(StorageError, match="not expected here"):
        read_upload(data)


def test_all_who_start_at_once_have_one_key(place: str, monkeypatch: pytest.MonkeyPatch) -> None:
    # One for all: eight that connect in one process keep each other waiting for seconds.
    backend, all_looked = backend_of(place), threading.Barrier(8)
    find = backend.find

    def found_by_none(name: str) -> Any:
        found = find(name)
        all_looked.wait(30)
        return found

    monkeypatch.setattr(backend, "find", found_by_none)
    with ThreadPoolExecutor(8) as pool:
        asked = [pool.submit(SharedFiles(backend).job_key) for _ in range(8)]
        keys = {one.result() for one in asked}
    assert len(keys) == 1
    if not place.startswith("s3:"):
        assert (Path(place) / "jobs.key").stat().st_mode & 0o777 == 0o600


def test_a_key_that_is_cut_off_is_named(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rhytid.fleet.shared_files._KEY_SECONDS", 0.05)
    (folder / "jobs.key").write_bytes(b"half")
    with pytest.raises(SharedDamageError, match=r"jobs\.key is damaged: remove it"):
        SharedFiles(backend_of(str(folder))).job_key()


def test_a_key_that_cannot_be_written_is_made_later(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = SharedFiles(backend_of(str(folder)))
    files.give([b""])

    class Full:
        def __init__(self, file: Any) -> None:
            self._file = file

        def __enter__(self) -> Any:
            return self

        def __exit__(self, *exc: object) -> None:
            self._file.close()

        def write(self, data: bytes) -> None:
            raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(
            "rhytid.storage.shared.folder_backend.open",
            lambda *arguments: Full(open(*arguments)),  # noqa: SIM115
            raising=False,
        )
        with pytest.raises(StorageError, match="No space left"):
            files.job_key()
    assert len(files.job_key()) == 32
