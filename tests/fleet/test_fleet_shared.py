"""The folder that replicas share, and the frames that one brings itself."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from engine.engines import built, new_asset, running
from rhytid.engine.messages import Package
from rhytid.errors import DeviceLostError, FrameMemoryError, NotFoundError
from rhytid.fleet import frame_sync
from rhytid.fleet.frame_sync import FrameSync
from rhytid.fleet.shared_folder import SharedFolder

ASSET = "0123456789abcdef"
POSITIONS = np.ones((4, 3), np.float32)


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


class OneBoard:
    """A board in this process, which may not answer."""

    def __init__(self) -> None:
        self.frames: dict[str, tuple[int, Any]] = {}
        self.asked, self.answers, self.room = 0, True, True

    def versions(self, asset: str) -> dict[str, int]:
        self.asked += 1
        if not self.answers:
            raise DeviceLostError("away")
        return {name: version for name, (version, _) in self.frames.items()}

    def frame(self, asset: str, name: str) -> tuple[int, Any]:
        return self.frames[name]

    def keep(self, asset: str, name: str, positions: Any) -> int:
        if not self.room:
            return 0
        self.frames[name] = (self.asked + 1, positions)
        return self.frames[name][0]


class OneEngine:
    def __init__(self) -> None:
        self.has: dict[str, Any] = {}

    def put(self, asset: str, name: str, positions: Any) -> None:
        self.has[name] = positions

    def delete(self, asset: str, name: str) -> None:
        if self.has.pop(name, None) is None:
            raise NotFoundError(name)


@pytest.fixture
def board() -> Any:
    return OneBoard()


@pytest.fixture
def engine() -> Any:
    return OneEngine()


def test_a_frame_is_fetched_once_and_when_it_is_newer(
    board: Any, engine: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    sync = FrameSync(engine, board)
    board.frames["a"] = (5, POSITIONS)
    sync.bring(ASSET, "a", 0)
    sync.bring(ASSET, "a", 5)
    assert (engine.has["a"] is POSITIONS, board.asked) == (True, 1)
    board.frames["a"] = (6, 2 * POSITIONS)
    sync.bring(ASSET, "a", 5)
    assert engine.has["a"] is POSITIONS, "what was found is taken for a second"
    sync.bring(ASSET, "a", 6)
    assert engine.has["a"][0, 0] == 2
    board.frames["a"] = (7, None)
    monkeypatch.setattr(frame_sync, "FRESH", 0.0)
    sync.bring(ASSET, "a", 0)
    assert engine.has == {}
    board.frames["b"] = (8, POSITIONS)
    sync.bring_all(ASSET)
    assert set(engine.has) == {"b"}


def test_without_a_board_frames_are_as_they_are_here(
    board: Any, engine: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    sync = FrameSync(engine, board)
    sync.note(ASSET, "a", 5)
    board.answers = False
    sync.bring(ASSET, "a", 5)
    with pytest.raises(DeviceLostError):
        sync.bring(ASSET, "a", 6)
    with pytest.raises(DeviceLostError):
        sync.bring_all(ASSET)
    sync.bring(ASSET, "neutral", 0)
    assert board.asked == 1, "the others need not wait for it"
    monkeypatch.setattr(frame_sync, "AWAY", 0.0)
    board.answers, board.frames["a"] = True, (6, POSITIONS)
    sync.bring(ASSET, "a", 6)
    assert engine.has["a"] is POSITIONS


def test_calls_for_one_frame_ask_the_board_once(board: Any, engine: Any) -> None:
    sync = FrameSync(engine, board)
    board.frames["a"] = (5, POSITIONS)
    with ThreadPoolExecutor(4) as pool:
        with sync.changing(ASSET):
            bringing = [pool.submit(sync.bring, ASSET, "a", 5) for _ in range(4)]
            time.sleep(0.1)
        for one in bringing:
            one.result(10)
    assert board.asked == 1


def test_a_frame_without_room_on_the_board_is_refused(board: Any, engine: Any) -> None:
    sync = FrameSync(engine, board)
    engine.put(ASSET, "a", POSITIONS)
    sync.keep(ASSET, "a", POSITIONS)
    engine.put(ASSET, "a", 2 * POSITIONS)
    board.room = False
    with pytest.raises(FrameMemoryError, match=r"frame a of .* does not fit"):
        sync.keep(ASSET, "a", 2 * POSITIONS)
    sync.bring(ASSET, "a", 0)
    assert engine.has["a"] is POSITIONS


def test_frames_of_assets_that_nobody_uses_make_room(
    board: Any, engine: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    sync, other, third = FrameSync(engine, board), "1" * 16, "2" * 16

    def put(asset: str, name: str, positions: Any) -> None:
        if len(engine.has) == 2:
            raise FrameMemoryError("full")
        engine.has[name] = positions

    monkeypatch.setattr(engine, "put", put)
    board.frames = dict.fromkeys(("a", "b", "c"), (5, POSITIONS))
    sync.bring(ASSET, "a", 0)
    sync.note(other, "local", 5)
    engine.has["local"] = POSITIONS
    with pytest.raises(FrameMemoryError, match="full"):
        sync.bring(third, "c", 0)
    monkeypatch.setattr(frame_sync, "IDLE", -1.0)
    sync.bring(third, "c", 0)
    assert set(engine.has) == {"local", "c"}, "the board has no other copy of this one"
    sync.bring(ASSET, "a", 5)
    assert set(engine.has) == {"local", "a"}, "what went comes again"
