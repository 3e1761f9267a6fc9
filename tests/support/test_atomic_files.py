"""Files that are whole, and what is left where their writer is killed."""

from __future__ import annotations

import errno
import hashlib
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from rhytid.errors import DiskFullError, StorageError
from rhytid.storage.shared.folder_backend import FolderBackend
from rhytid.support import atomic_files
from rhytid.support.atomic_files import (
    UNFINISHED,
    atomic_write,
    prepared_in,
    shared_working_folder,
    storage_errors,
    sweep,
    write_hashed,
)
from storage.leftovers import left_by_a_killed_writer

WRITER = """
import os, signal, sys
from pathlib import Path
from rhytid.support.atomic_files import atomic_write
with atomic_write(Path(sys.argv[1])) as aside:
    aside.write_text("half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_the_digest_of_a_file_is_of_its_bytes(tmp_path: Path) -> None:
    digest = write_hashed(tmp_path / "map", iter([b"some", memoryview(b"more")]))

    assert (tmp_path / "map").read_bytes() == b"somemore"
    assert digest == hashlib.sha256(b"somemore").hexdigest()


def test_a_file_is_hashed_while_it_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    both = threading.Barrier(2, timeout=20)

    class Hash:
        def update(self, piece: bytes) -> None:
            both.wait()

        def hexdigest(self) -> str:
            return "of it"

    def write(path: Path, pieces: list[bytes]) -> None:
        both.wait()
        raise OSError("the disk is full")

    monkeypatch.setattr("hashlib.sha256", Hash)
    monkeypatch.setattr(atomic_files, "write_pieces", write)
    threads = threading.active_count()
    with pytest.raises(OSError, match="full"):
        write_hashed(tmp_path / "map", [b"some"])
    assert threading.active_count() == threads


def test_a_killed_writer_leaves_no_half_file_and_what_is_left_is_swept(tmp_path: Path) -> None:
    ended = subprocess.run([sys.executable, "-c", WRITER, str(tmp_path / "map.exr")])
    assert ended.returncode == -signal.SIGKILL
    [left] = tmp_path.iterdir()
    assert left.name.startswith(".unfinished-")

    sweep(tmp_path)
    assert left.exists()  # its writer may be another machine, at work
    days = left.stat().st_mtime - 25 * 3600
    os.utime(left, (days, days))
    (tmp_path / "kept").mkdir()
    os.utime(tmp_path / "kept", (days, days))
    sweep(tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == ["kept"]


class FullFile:
    """A file on a full disk, which takes some bytes of what is written."""

    def __init__(self, taken: int, *arguments: Any, **options: Any) -> None:
        self._file, self._taken = open(*arguments, **options), taken  # noqa: SIM115

    def __enter__(self) -> FullFile:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def write(self, data: bytes) -> int:
        if not self._taken:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return self._file.write(data[: self._taken])


@pytest.mark.parametrize("taken", [0, 3])
def test_a_full_disk_is_told_of_the_file_and_keeps_nothing(
    taken: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(atomic_files, "open", partial(FullFile, taken), raising=False)
    with pytest.raises(OSError, match="No space left") as told, atomic_write(tmp_path / "map.exr"):
        pass
    assert told.value.filename == str(tmp_path / "map.exr")
    assert not [*tmp_path.iterdir()]


def test_what_finds_no_room_in_the_block_is_told_of_the_file(tmp_path: Path) -> None:
    file = tmp_path / "map.exr"
    told = pytest.raises(DiskFullError, match=r"map\.exr is not there: No space left on device$")
    with told, storage_errors(f"{file} is not there"), atomic_write(file):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_another_file_that_finds_no_room_is_told(tmp_path: Path) -> None:
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "/scratch/room")
    told = pytest.raises(DiskFullError, match=r"not there: .*No space left on device: '/scratch")
    with told, storage_errors("map.exr is not there"), atomic_write(tmp_path / "map.exr"):
        raise full


def test_a_name_that_only_begins_a_message_is_told() -> None:
    told = pytest.raises(StorageError, match=r"denied: '/data/maps'$")
    with told, storage_errors("/data/maps.exr cannot be written"):
        raise OSError(errno.EACCES, "denied", "/data/maps")


@pytest.mark.parametrize("marker", [b"", UNFINISHED.text()[:7]])
def test_a_folder_whose_marker_found_no_room_is_swept(marker: bytes, tmp_path: Path) -> None:
    left, of_another = (tmp_path / f".unfinished-{letter * 32}" for letter in "ab")
    for folder, text in ((left, marker), (of_another, b"mine")):
        folder.mkdir()
        (folder / UNFINISHED.marker).write_bytes(text)
        days = folder.stat().st_mtime - 25 * 3600
        os.utime(folder, (days, days))
    sweep(tmp_path)
    assert [*tmp_path.iterdir()] == [of_another]


def test_what_a_killed_writer_left_goes_with_the_place_where_it_was_prepared(
    tmp_path: Path,
) -> None:
    file = tmp_path / "map.exr"
    with shared_working_folder(tmp_path) as place, prepared_in(place, tmp_path):
        with atomic_write(file) as aside:
            assert aside.parent.parent == place
            aside.write_text("all")
        left_by_a_killed_writer(place, "0" * 32, "map.exr")
    assert [*tmp_path.iterdir()] == [file]


def test_a_file_is_prepared_beside_it_where_the_other_place_is_gone(tmp_path: Path) -> None:
    with prepared_in(tmp_path / "gone", tmp_path), atomic_write(tmp_path / "map.exr") as aside:
        assert aside.parent.parent == tmp_path
        aside.write_text("all")
    assert (tmp_path / "map.exr").read_text() == "all"


def test_a_place_goes_while_others_write_in_it(tmp_path: Path) -> None:
    ended = threading.Event()
    written = []

    def write() -> None:
        while not ended.is_set():
            with suppress(OSError), atomic_write(tmp_path / "map.exr") as aside:
                aside.write_text("all")
                written.append(aside)

    with shared_working_folder(tmp_path) as place, prepared_in(place, tmp_path):
        (place / "snapshot").write_text("large")
        writer = threading.Thread(target=write)
        writer.start()
        while not written:
            time.sleep(0.001)
    ended.set()
    writer.join()
    assert not (place / "snapshot").exists()
    assert [one for one in tmp_path.iterdir() if one != tmp_path / "map.exr"] == []


def test_a_shared_place_keeps_the_group_of_its_folder(tmp_path: Path) -> None:
    tmp_path.chmod(0o2755)
    with shared_working_folder(tmp_path) as place:
        assert place.stat().st_mode & 0o7777 == 0o2755


def test_a_file_is_there_when_its_block_ends_well(tmp_path: Path) -> None:
    file = tmp_path / "map.exr"
    with pytest.raises(FileNotFoundError), atomic_write(file):
        (tmp_path / "no such folder" / "map.exr").write_text("half")
    assert [*tmp_path.iterdir()] == []
    with atomic_write(file) as aside:
        aside.write_text("all")
        assert not file.exists()
    assert [*tmp_path.iterdir()] == [file]


def test_what_nobody_writes_any_more_is_removed_at_once(tmp_path: Path) -> None:
    for name, files in {"a": ["mine"], "b": ["other"], "c": [], "d": ["mine", "other"]}.items():
        left_by_a_killed_writer(tmp_path, name * 32, *files)
    (tmp_path / "mine").touch()

    sweep(tmp_path, lambda name: name == "mine")

    left = sorted(path.name for path in tmp_path.iterdir())
    assert left == [*(f".unfinished-{name * 32}" for name in "bcd"), "mine"]


PLACER = """
import os, signal, sys
from pathlib import Path
from rhytid.storage.shared import folder_backend
folder_backend.write_file = lambda aside, data: os.kill(os.getpid(), signal.SIGKILL)
folder_backend.FolderBackend(Path(sys.argv[1])).write("objects/a", b"a")
"""


def test_what_a_killed_writer_left_in_a_shared_store_is_swept(tmp_path: Path) -> None:
    ended = subprocess.run([sys.executable, "-c", PLACER, str(tmp_path)])
    assert ended.returncode == -signal.SIGKILL
    [left] = (tmp_path / "partial").iterdir()
    FolderBackend(tmp_path).check()
    assert left.exists()
    days = left.stat().st_mtime - 25 * 3600
    os.utime(left, (days, days))
    FolderBackend(tmp_path).check()
    assert not left.exists()
