"""A bake goes on where it was, and only there."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rhytid.baking.baker
from baking.bakers import SQUARE, bake, baker, contents, maps
from baking.fake_engine import FakeEngine
from rhytid.baking.frame_names import FramePlace
from rhytid.baking.map_sources import Geometry
from rhytid.baking.output import BakeRecord
from rhytid.baking.run_warnings import RunWarnings
from rhytid.errors import StorageError, StrictError
from rhytid.exports.textures.profiles import profiles_of
from rhytid.formats.exr import read_exr
from rhytid.storage.manifest import StoredFile
from rhytid.support import atomic_files
from rhytid.support.build_identity import drawing_version
from rhytid.support.console import Verbosity, use_verbosity


@pytest.fixture
def engine() -> FakeEngine:
    return FakeEngine()


def test_every_frame_of_every_udim_is_written(engine: FakeEngine, tmp_path: Path) -> None:
    done = bake(engine, tmp_path, [0.5, 0.25])

    names = ["face.1001.0001", "face.1001.0002", "face.1002.0001", "face.1002.0002"]
    assert maps(tmp_path) == [f"{name}.exr" for name in names]
    assert (done.written, done.skipped) == (4, 0)
    texels, header = read_exr(tmp_path / "face.1002.0002.exr")
    assert texels.dtype == np.float32
    assert (texels == 0.25).all()
    assert (header["frame"], header["udim"], header["method"]) == ("0002", 1002, "redraw")


def test_no_frame_stays_in_the_engine(engine: FakeEngine, tmp_path: Path) -> None:
    bake(engine, tmp_path, [1.0, 2.0])

    assert engine.held == {}


def test_what_is_done_is_skipped(engine: FakeEngine, tmp_path: Path) -> None:
    bake(engine, tmp_path, [1.0, 2.0])
    engine.drawn.clear()

    again = bake(engine, tmp_path, [1.0, 2.0])

    assert (again.written, again.skipped, engine.drawn) == (0, 4, [])


def test_an_interrupted_bake_goes_on(engine: FakeEngine, tmp_path: Path) -> None:
    engine.failing_after = 3
    with pytest.raises(KeyboardInterrupt):
        bake(engine, tmp_path, [1.0, 2.0])
    done = maps(tmp_path)
    assert len(done) <= 3
    engine.failing_after = None
    engine.drawn.clear()

    rest = bake(engine, tmp_path, [1.0, 2.0])

    all_maps = [(frame, udim) for frame in ("0001", "0002") for udim in (1001, 1002)]
    assert engine.drawn == [
        (frame, udim) for frame, udim in all_maps if f"face.{udim}.{frame}.exr" not in done
    ]
    assert (rest.written, rest.skipped) == (4 - len(done), len(done))


def test_frames_have_no_digest_where_no_profile_is_made_of_positions(
    engine: FakeEngine, tmp_path: Path
) -> None:
    bake(engine, tmp_path, [1.0, 2.0])

    assert engine.digests == []
    assert [p.posed for p in profiles_of(["float", "normal-dx", "weights"])] == [False, True, True]


def test_another_frame_is_drawn_again(engine: FakeEngine, tmp_path: Path) -> None:
    bake(engine, tmp_path, [1.0, 2.0])
    engine.drawn.clear()

    bake(engine, tmp_path, [1.0, 3.0])

    assert engine.drawn == [("0002", 1001), ("0002", 1002)]


@pytest.mark.parametrize(
    "change",
    [{"method": "neutral"}, {"stretch": "uv"}, {"sampling": "smooth"}, {"profiles": ["half"]}],
)
def test_other_options_are_drawn_again(
    change: dict[str, Any], engine: FakeEngine, tmp_path: Path
) -> None:
    bake(engine, tmp_path, [1.0])

    assert bake(engine, tmp_path, [1.0], **change).written == 2


def test_files_that_will_be_replaced_are_told_before_one_is(
    engine: FakeEngine, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bake(engine, tmp_path, [0.5, 0.25])
    bake(engine, tmp_path, [0.5, 0.25])
    assert "replaced" not in capsys.readouterr().err
    before = {name: (tmp_path / name).read_bytes() for name in maps(tmp_path)}
    engine.failing_after = len(engine.drawn)
    with pytest.raises(KeyboardInterrupt), use_verbosity(Verbosity(quiet=True)):
        bake(engine, tmp_path, [0.5, 0.25], method="binned")
    told = capsys.readouterr().err
    first = tmp_path / "face.1001.0001.exr"
    assert f"warning: files-replaced: the bake: {first} is not what is asked for" in told
    assert "it was baked by another method" in told
    assert told.count("a bake replaces it and others like it") == 1
    assert {name: (tmp_path / name).read_bytes() for name in maps(tmp_path)} == before
    engine.failing_after = None
    strict = baker(engine, tmp_path, [0.5, 0.25], method="binned")
    strict.warnings = RunWarnings("bake", True)
    with pytest.raises(StrictError, match="--allow files-replaced"):
        strict.run()
    assert {name: (tmp_path / name).read_bytes() for name in maps(tmp_path)} == before


def test_files_that_no_record_has_are_told_so(
    engine: FakeEngine, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bake(engine, tmp_path, [0.5])
    (tmp_path / "face.bake.json").unlink()
    bake(engine, tmp_path, [0.5])
    told = capsys.readouterr().err
    assert "no record of a bake, NAME.bake.json or NAME.bake.FRAMES.json, beside it has it" in told
    assert "another method" not in told


@pytest.mark.parametrize("surfaces", [False, True])
def test_a_strict_bake_that_would_replace_files_of_later_frames_writes_none(
    surfaces: bool, engine: FakeEngine, tmp_path: Path
) -> None:
    values = [0.5, 0.25, 0.75, 1.0]
    bake(engine, tmp_path, values, part="3-4")
    if surfaces:  # and the maps of the frame are as they are asked for
        (tmp_path / "face.0004.glb").write_bytes(b"older")
    else:
        engine.revision += 1
    before = contents(tmp_path)
    strict = baker(engine, tmp_path, values)
    strict.geometry = Geometry(SQUARE, "glb", 1) if surfaces else None
    strict.warnings = RunWarnings("bake", True)

    with pytest.raises(StrictError, match=r"so nothing was done \(--allow files-repl"):
        strict.run()

    assert contents(tmp_path) == before
    assert strict.warnings.found[0].detail.startswith(
        str(tmp_path / ("face.0004.glb" if surfaces else "face.1001.0003.exr"))
    )


def test_a_strict_bake_says_where_files_were_written(engine: FakeEngine, tmp_path: Path) -> None:
    values = [0.5, 0.25, 0.75]
    bake(engine, tmp_path, values)
    engine.revision += 1
    strict = baker(engine, tmp_path, values, part="2")
    strict.warnings = RunWarnings("bake", True, ["files-replaced"])

    with pytest.raises(StrictError, match=r"1 warning, after files were written \(--allow devices"):
        strict.run()

    assert strict.written == 2


def test_a_strict_bake_takes_up_what_is_there(engine: FakeEngine, tmp_path: Path) -> None:
    bake(engine, tmp_path, [0.5, 0.25], part="2")
    strict = baker(engine, tmp_path, [0.5, 0.25])
    strict.warnings = RunWarnings("bake", True)

    strict.run()

    assert (strict.written, strict.skipped, strict.warnings.found) == (2, 2, [])


@pytest.mark.parametrize("surfaces", [False, True])
def test_a_strict_bake_takes_up_what_a_killed_one_left(
    surfaces: bool, engine: FakeEngine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    killed = baker(engine, tmp_path, [0.5, 0.25])
    killed.geometry = Geometry(SQUARE, "glb", 1) if surfaces else None
    last, install = ".glb" if surfaces else ".exr", atomic_files.install
    ended: list[str] = []

    def kill(source: Path, target: Path) -> None:
        """Nothing is written after the first such file has its name."""
        if ended:
            raise KeyboardInterrupt
        if target.suffix == last:
            ended.append(target.name)
        install(source, target)
        if ended:
            raise KeyboardInterrupt

    monkeypatch.setattr(atomic_files, "install", kill)
    with pytest.raises(KeyboardInterrupt):
        killed.run()
    monkeypatch.undo()
    there = [file.name for file in tmp_path.iterdir() if file.suffix in {".exr", ".glb"}]
    assert ended[0] in there
    strict = baker(engine, tmp_path, [0.5, 0.25])
    strict.geometry = killed.geometry
    strict.warnings = RunWarnings("bake", True)

    strict.run()

    assert (strict.skipped, strict.warnings.found) == (len(there), [])


@pytest.mark.parametrize("change", ["device", "version", "method", "bytes"])
@pytest.mark.parametrize("surfaces", [False, True])
def test_what_workers_of_other_devices_wrote_is_done(
    surfaces: bool, change: str, engine: FakeEngine, tmp_path: Path
) -> None:
    """The machine that begins a bake on a cluster may have none of the devices of its workers."""
    values = [0.5, 0.25]
    engine.version += "~" if change == "version" else ""
    for part in ("1", "2"):
        engine.revision += 1
        done = baker(engine, tmp_path, values, part=part)
        done.geometry = Geometry(SQUARE, "glb", 1) if surfaces else None
        done.run()
    engine.revision += 1
    engine.version = drawing_version()
    if change == "bytes":
        (tmp_path / "face.1002.0002.exr").write_bytes(b"older")
    method = "binned" if change == "method" else "redraw"
    client = baker(engine, tmp_path, values, method=method)
    client.geometry = Geometry(SQUARE, "glb", 1) if surfaces else None
    client.warnings = RunWarnings("bake", True)
    before = contents(tmp_path)

    with nullcontext() if change == "device" else pytest.raises(StrictError, match="files-repl"):
        client.refuse_replaced()

    assert contents(tmp_path) == before


def test_a_strict_bake_over_what_is_there_hashes_each_file_once(
    engine: FakeEngine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bake(engine, tmp_path, [0.5, 0.25])
    strict = baker(engine, tmp_path, [0.5, 0.25])
    strict.warnings = RunWarnings("bake", True)
    hashed: list[str] = []
    read = StoredFile.read

    def noted(path: Path) -> StoredFile:
        hashed.append(path.name)
        return read(path)

    monkeypatch.setattr(StoredFile, "read", noted)
    strict.run()

    assert (strict.written, strict.skipped) == (0, 4)
    assert sorted(hashed) == maps(tmp_path)


def test_frames_that_are_there_do_not_count_for_the_time_left(
    engine: FakeEngine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bake(engine, tmp_path, [0.5, 0.25, 0.75], part="1,3")
    found = []

    def counted(things: Sequence[FramePlace], *_: str, worked: Any) -> Iterator[FramePlace]:
        for thing in things:
            yield thing
            found.append(worked())

    monkeypatch.setattr(rhytid.baking.baker, "counted", counted)
    bake(engine, tmp_path, [0.5, 0.25, 0.75])
    assert found == [False, True, False]


def test_a_file_that_changes_after_it_was_looked_at_is_not_done(
    engine: FakeEngine, tmp_path: Path
) -> None:
    bake(engine, tmp_path, [0.5])
    first = tmp_path / maps(tmp_path)[0]
    entries = json.loads((tmp_path / "face.bake.json").read_bytes())["maps"]
    record = BakeRecord(tmp_path / "face.bake.json")
    assert record.done(first, entries[first.name]["key"])
    os.utime(first, ns=(0, 0))  # as a clock of coarse steps would have it
    assert record.done(first, entries[first.name]["key"])
    damaged = bytearray(first.read_bytes())
    damaged[-1] ^= 1
    first.write_bytes(damaged)
    assert not record.done(first, entries[first.name]["key"])


def test_another_asset_is_drawn_again(engine: FakeEngine, tmp_path: Path) -> None:
    bake(engine, tmp_path, [1.0])
    engine.revision += 1

    assert bake(engine, tmp_path, [1.0]).written == 2


@pytest.mark.parametrize("damage", ["removed", "cut", "changed"])
def test_a_damaged_file_is_drawn_again(damage: str, engine: FakeEngine, tmp_path: Path) -> None:
    bake(engine, tmp_path, [1.0, 2.0])
    file = tmp_path / "face.1001.0002.exr"
    whole = file.read_bytes()
    if damage == "removed":
        file.unlink()
    else:
        file.write_bytes(whole[:-1] if damage == "cut" else whole[:-1] + bytes([whole[-1] ^ 1]))
    engine.drawn.clear()

    bake(engine, tmp_path, [1.0, 2.0])

    assert engine.drawn == [("0002", 1001)]
    assert file.read_bytes() == whole


def test_half_floats(engine: FakeEngine, tmp_path: Path) -> None:
    bake(engine, tmp_path, [0.5], profiles=["half"])

    assert read_exr(tmp_path / "face.1001.0001.exr")[0].dtype == np.float16


def test_calibration_takes_the_frame_that_stretches_most(
    engine: FakeEngine, tmp_path: Path
) -> None:
    baker(engine, tmp_path, [0.1, 0.3, 0.2], method="binned").calibrate()

    assert engine.calibrated == [np.float32(0.3)]
    assert engine.held == {}


def test_files_are_known_without_being_read_again(
    engine: FakeEngine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read = StoredFile.read
    monkeypatch.setattr(StoredFile, "read", never)
    made = baker(engine, tmp_path, [0.5, 1.0], profiles=["half", "png16"])
    made.geometry = Geometry(SQUARE, "glb", 1)
    made.run()

    known = json.loads((tmp_path / "face.bake.json").read_bytes())["maps"]
    assert len(known) == 2 * (2 * 2 + 1)
    assert {name: one["sha256"] for name, one in known.items()} == {
        name: read(tmp_path / name).sha256 for name in known
    }


def test_the_text_of_a_record_is_that_of_all_its_entries(
    engine: FakeEngine, tmp_path: Path
) -> None:
    for values in ([0.5], [0.5, 1.0, 0.7]):  # the second bake reads the first entries
        baker(engine, tmp_path, values).run()
        text = (tmp_path / "face.bake.json").read_text()
        known = json.loads(text)
        assert len(known["maps"]) == 2 * len(values)
        assert text == json.dumps(known, indent=1, sort_keys=True) + "\n"


def never(file: Path) -> StoredFile:
    raise AssertionError(f"{file} is read again")


@pytest.mark.parametrize(
    "text",
    ["", "{", "[]", "{}", '{"maps": []}', '{"maps": {"a": {"key": "k"}}}', '{"maps": {"a": 1}}'],
)
def test_a_damaged_record_is_told(text: str, tmp_path: Path) -> None:
    file = tmp_path / "face.bake.json"
    file.write_text(text)

    with pytest.raises(StorageError, match=r"face\.bake\.json is damaged: remove it"):
        BakeRecord(file)


def test_nothing_else_is_left_behind(engine: FakeEngine, tmp_path: Path) -> None:
    bake(engine, tmp_path, [1.0])

    left = sorted(file.name for file in tmp_path.iterdir() if file.suffix != ".exr")
    assert len(left) == 2
    assert left[0] == "face.bake.json"
    assert re.fullmatch(r"face\.device\.[0-9a-f]{8}\.json", left[1])
