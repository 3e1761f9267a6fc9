"""Temporary folders of processes that were killed are removed by the next, and no others."""

from __future__ import annotations

import fcntl
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from rhytid.support import temporary_folders
from rhytid.support.temporary_folders import temporary_folder

HOLDING = """
import sys
from rhytid.support.temporary_folders import temporary_folder
with temporary_folder("rhytid-bench-") as folder:
    (folder / "map.exr").write_bytes(bytes(1000))
    print(folder, flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of temporary files, in which this process has not looked."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", None)
    monkeypatch.setattr(temporary_folders, "_swept", set())
    return tmp_path


def left_behind() -> Path:
    """What a process that was killed left, with the marker."""
    process, left = holder()
    with process:
        process.kill()
    return left.parent


def holder() -> tuple[subprocess.Popen[str], Path]:
    """A process that has a folder, and the folder in it for files."""
    command = [sys.executable, "-c", HOLDING]
    pipe = subprocess.PIPE
    process = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True)
    assert process.stdout is not None
    return process, Path(process.stdout.readline().strip())


def test_a_folder_goes_with_its_block(place: Path) -> None:
    with temporary_folder("rhytid-") as folder:
        assert list(folder.iterdir()) == []
        assert folder.is_relative_to(place)
    assert list(place.iterdir()) == []


def test_what_a_killed_process_left_is_removed_and_nothing_else(place: Path) -> None:
    killed, left = holder()
    running, kept = holder()
    with killed, running:
        killed.kill()
        killed.wait()
        assert left.exists()
        others = [place / name for name in ("rhytid-abcdefgh", "rhytid-store", "other-abcdefgh")]
        for other in others:
            (other / "in-use.new").mkdir(parents=True)
        (place / "rhytid-link1234").symlink_to(left.parent)
        (others[1] / "in-use").touch()  # a name that no such folder has

        with temporary_folder("rhytid-"):
            assert not left.parent.exists()
            assert (kept / "map.exr").exists()
        assert all(other.is_dir() for other in others)
        assert (place / "rhytid-link1234").is_symlink()

        assert running.stdin is not None
        running.stdin.close()
        running.wait()
    assert not kept.parent.exists()
    assert left.parent not in place.iterdir()


def test_folders_that_are_named_a_place_have_no_lock(tmp_path: Path) -> None:
    with temporary_folder("x", tmp_path) as folder:
        assert folder.parent == tmp_path
        assert list(folder.iterdir()) == []


def test_another_machine_that_shares_the_files_and_no_locks_removes_nothing(
    place: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    boot = tmp_path_factory.mktemp("system") / "boot_id"
    boot.write_text("another\n")
    running, kept = holder()
    with running:
        left = left_behind()
        with monkeypatch.context() as other:
            other.setattr(temporary_folders, "_BOOT", boot)
            other.setattr(fcntl, "flock", lambda *_: None)
            with temporary_folder("rhytid-"):
                assert (kept / "map.exr").exists()
                assert left.exists()

        temporary_folders._swept.clear()
        with temporary_folder("rhytid-"):  # back on the machine of both
            assert (kept / "map.exr").exists()
            assert not left.exists()
        assert running.stdin is not None
        running.stdin.close()


def test_a_lock_that_we_did_not_write_there_marks_nothing(place: Path) -> None:
    left = left_behind()
    copy = Path(shutil.copytree(left, place / "rhytid-copy1234"))
    texts = {"empty123": b"", "other123": b"1234", "named123": b'{"format": 1}'}
    others = [place / f"rhytid-{name}" for name in texts]
    for other, text in zip(others, texts.values(), strict=True):
        other.mkdir()
        (other / "in-use").write_bytes(text)
    with temporary_folder("rhytid-"):
        assert not left.exists()
        assert all(other.exists() for other in (copy, *others))


def test_where_the_system_has_no_name_nothing_is_removed(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    left = left_behind()
    monkeypatch.setattr(temporary_folders, "_BOOT", place / "missing")
    with temporary_folder("rhytid-") as folder:
        assert not (folder.parent / "in-use").exists()
        assert left.exists()
