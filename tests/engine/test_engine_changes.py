"""Counts of what changes: whoever keeps a tile sees that it is no longer what would be drawn."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from engine.engines import built, finish, new_asset, running
from meshes import deform
from pipeline.scenes import sheet
from rhytid.engine.changes import SIZE, Changes
from rhytid.engine.engine import Engine


def changes() -> Changes:
    return Changes(memoryview(bytearray(SIZE)))


def test_a_mark_stays_while_nothing_changes() -> None:
    counts = changes()
    assert counts.mark("a", "smile") == counts.mark("a", "smile")
    assert counts.mark("a", "smile").settled
    assert counts.mark("a", "smile") != changes().mark("a", "smile")


def test_a_change_is_seen_from_its_beginning_to_its_end() -> None:
    counts = changes()
    before = counts.mark("a", "smile")
    with counts.changing("a", "smile"):
        within = counts.mark("a", "smile")
        assert not within.settled
        assert counts.mark("a", "frown").settled
    after = counts.mark("a", "smile")
    assert after.settled
    assert len({before, within, after}) == 3


def test_a_change_of_an_asset_is_one_of_all_its_frames_alone() -> None:
    counts = changes()
    mine, other = counts.mark("a", "smile"), counts.mark("b", "smile")
    with counts.changing("a"):
        pass
    assert counts.mark("a", "smile") != mine
    assert counts.mark("b", "smile") == other


def test_a_change_that_fails_has_ended() -> None:
    counts = changes()
    with pytest.raises(ValueError, match="no"), counts.changing("a"):
        raise ValueError("no")
    assert counts.mark("a", "smile").settled


def test_another_process_counts_in_the_same_place() -> None:
    code = (
        "from rhytid.engine.changes import SIZE, Changes; memory = bytearray(SIZE); "
        "counts = Changes(memoryview(memory)); counts.changing('a', 'smile').__enter__(); "
        "print(next(at for at, byte in enumerate(memory) if byte))"
    )
    memory = bytearray(SIZE)
    with Changes(memoryview(memory)).changing("a", "smile"):
        mine = next(at for at, byte in enumerate(memory) if byte)
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert int(found.stdout) == mine


def put(engine: Engine, asset: str) -> None:
    engine.frames.put(asset, "smile", deform(sheet().positions, 5, 0.1))


def delete_frame(engine: Engine, asset: str) -> None:
    engine.frames.delete(asset, "smile")


def change(engine: Engine, asset: str) -> None:
    engine.assets.change(asset, {"depth": 0.5})


def calibrate(engine: Engine, asset: str) -> None:
    finish(engine, engine.assets.calibrate(asset, deform(sheet().positions, 1, 0.15)).id)


def delete(engine: Engine, asset: str) -> None:
    engine.assets.delete(asset)


CHANGES: list[Callable[[Engine, str], None]] = [put, delete_frame, change, calibrate, delete]


@pytest.mark.parametrize("does", CHANGES, ids=lambda does: does.__name__)
def test_what_changes_tiles_changes_the_mark(
    does: Callable[[Engine, str], None], tmp_path: Path
) -> None:
    with running(tmp_path) as engine:
        asset = built(engine, new_asset())
        engine.frames.put(asset, "smile", deform(sheet().positions, 1, 0.1))
        before = engine.mark(asset, "smile")
        assert before.settled
        engine.frames.put(asset, "frown", deform(sheet().positions, 2, 0.1))
        engine.frames.info(asset, "smile")
        assert engine.mark(asset, "smile") == before

        does(engine, asset)

        assert engine.mark(asset, "smile") != before
        assert engine.mark(asset, "smile").settled
