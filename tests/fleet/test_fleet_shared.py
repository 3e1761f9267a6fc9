"""The folder that replicas share."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from engine.engines import built, new_asset, running
from rhytid.engine.messages import Package
from rhytid.fleet.shared_folder import SharedFolder

ASSET = "0123456789abcdef"


def test_an_asset_is_there_from_its_upload_to_its_removal(tmp_path: Path) -> None:
    shared = SharedFolder(tmp_path)
    with running(tmp_path / "store") as engine:
        asset = built(engine, new_asset())
        assert (shared.ids(), shared.owner(asset), shared.revision(asset)) == ([], None, None)
        shared.put_upload(asset, "one", [b"a", b"b"])
        assert (shared.ids(), shared.owner(asset)) == ([asset], "one")
        assert shared.upload(asset) == b"ab"
        shared.own(asset, "two")
        assert shared.owner(asset) == "two"
        with engine.snapshots.of(asset) as made:
            wanted = b"".join(made.pieces())
            shared.put_snapshot(asset, made)
            before = shared.revision(asset)
            shared.put_snapshot(asset, made)
    assert shared.owner(asset) is None
    assert before is not None
    assert shared.revision(asset) not in (None, before)
    with shared.open_snapshot(asset) as file:
        assert file.read() == wanted
    shared.put_settings(asset, {"depth": 1.0})
    assert shared.settings(asset) == {"depth": 1.0}
    shared.remove(asset)
    assert (shared.ids(), shared.revision(asset), shared.settings(asset)) == ([], None, {})


def test_few_packages_of_an_asset_stay(tmp_path: Path) -> None:
    shared, source = SharedFolder(tmp_path), tmp_path / "made.zip"
    source.write_bytes(b"zip")
    for number in range(6):
        found = shared.share_package(ASSET, Package(f"key{number}", source, 3, {}))
        assert found.file.read_bytes() == b"zip"
    names = {path.name for path in (tmp_path / "packages").iterdir()}
    assert f"{ASSET}-key5.zip" in names
    assert len(names) == 4


WRITER = """
import os, signal, sys
from pathlib import Path
from rhytid.fleet.shared_folder import SharedFolder
def pieces():
    yield b"half"
    os.kill(os.getpid(), signal.SIGKILL)
shared = SharedFolder(Path(sys.argv[1]))
shared.give(pieces()) if sys.argv[2] == "given" else shared.put_upload("0" * 16, "me", pieces())
"""


def age(*paths: Path) -> None:
    day = time.time() - 90_000
    for path in paths:
        os.utime(path, (day, day))


@pytest.mark.parametrize("place", ["uploads", "given"])
def test_what_a_killed_writer_left_is_removed_a_day_later(tmp_path: Path, place: str) -> None:
    shared = SharedFolder(tmp_path)
    shared.put_upload(ASSET, "other", [b"whole"])
    kept = set((tmp_path / place).iterdir())
    ended = subprocess.run([sys.executable, "-c", WRITER, str(tmp_path), place])
    assert ended.returncode == -signal.SIGKILL
    [left] = {*(tmp_path / place).iterdir()} - kept - {tmp_path / place / f"{'0' * 16}.owner"}
    shared.sweep()
    assert left.exists(), "its writer may be at work"
    age(left, *kept)
    shared.sweep()
    assert not left.exists()
    assert all(path.exists() for path in kept)
