"""Folders whose maps several devices or methods drew, and the records of their parts."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from baking.bakers import bake, baker, contents, interrupted_after_one
from baking.fake_engine import FakeEngine
from rhytid.baking.baker import Baker
from rhytid.baking.frame_names import FramePlace, FrameRange
from rhytid.baking.run_warnings import RunWarnings
from rhytid.errors import StrictError


@pytest.fixture
def engine() -> FakeEngine:
    return FakeEngine()


def mixed(done: Baker) -> list[str]:
    """The warnings of a bake, but for that of files which it draws anew."""
    return [one.code for one in done.warnings.found if one.code != "files-replaced"]


@pytest.mark.parametrize("written", ["", "2", "2-3"])
@pytest.mark.parametrize("cluster", [False, True])
def test_a_strict_bake_beside_maps_by_another_method_writes_none(
    written: str,
    cluster: bool,
    engine: FakeEngine,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    values = [0.5, 0.25, 0.75]
    bake(engine, tmp_path, values, part="1")
    if written:
        bake(engine, tmp_path, values, method="binned", part=written)
    before = contents(tmp_path)
    strict = baker(engine, tmp_path, values, method="binned", part="2-3")
    strict.warnings = RunWarnings("bake", True)

    with pytest.raises(StrictError, match=r"so nothing was done \(--allow methods-mixed"):
        strict.refuse_replaced() if cluster else strict.run()

    assert contents(tmp_path) == before
    assert "maps would be by binned (frames 2-3) and redraw (frames 1)" in capsys.readouterr().err
    all_anew = baker(engine, tmp_path, values, method="binned")
    all_anew.warnings = RunWarnings("bake", True, ["files-replaced"])
    all_anew.run()
    assert mixed(all_anew) == []


def test_records_whose_maps_were_all_replaced_are_removed(
    engine: FakeEngine, tmp_path: Path
) -> None:
    values = [0.5, 0.25, 0.75, 1.0]
    for part in ("1-2", "2-3", "4"):
        bake(engine, tmp_path, values, part=part)
    bake(engine, tmp_path, values, method="binned", part="4")
    bake(engine, tmp_path, values, method="binned", part="1-2")
    assert len([*tmp_path.glob("face.bake*.json")]) == 3

    bake(engine, tmp_path, values, method="binned")
    left = {file.name for file in tmp_path.glob("face.bake*.json")}
    assert left == {"face.bake.json", "face.bake.1-2.json", "face.bake.4.json"}

    def shown(places: Sequence[FramePlace]) -> Iterator[FramePlace]:
        yield from places
        os.utime(tmp_path / "face.bake.4.json")  # as a bake of that part does

    anew = baker(engine, tmp_path, values)
    anew.write(anew.frames.places, shown(anew.frames.places))
    left = {file.name for file in tmp_path.glob("face.bake*.json")}
    assert left == {"face.bake.json", "face.bake.4.json"}


def test_records_of_others_are_removed_where_parts_replaced_all_their_maps(
    engine: FakeEngine, tmp_path: Path
) -> None:
    """As workers of a cluster bake parts, after which the client removes records."""
    values, parts = [0.5, 0.25, 0.75, 1.0], [FrameRange.parse(part) for part in ("1-2", "3")]
    output = baker(engine, tmp_path, values).output

    def left() -> set[str]:
        return {file.name.removeprefix("face.bake.") for file in output.records()}

    def written(method: str, changing: str | None = None) -> int:
        before = output.records()
        done = [bake(engine, tmp_path, values, method=method, part=one.text()) for one in parts]
        if changing is not None:
            os.utime(tmp_path / f"face.bake.{changing}")  # as a bake of that part does
        output.drop_replaced(before, parts)
        return sum(one.written for one in done)

    bake(engine, tmp_path, values, part="1-3")
    bake(engine, tmp_path, values, part="2-4")
    assert written("binned", changing="1-3.json") == 6
    assert left() == {"1-2.json", "3.json", "1-3.json", "2-4.json"}
    assert written("redraw") == 6
    assert left() == {"1-2.json", "3.json", "2-4.json"}

    # That of 1-2 has an older map of frame 2 then, which is not baked anew.
    bake(engine, tmp_path, values, method="binned", part="2")
    assert written("binned") == 4
    assert left() == {"1-2.json", "2.json", "3.json", "2-4.json"}
    assert written("binned") == 0


def test_a_bake_that_writes_nothing_tells_of_two_methods(
    engine: FakeEngine, tmp_path: Path
) -> None:
    values = [0.5, 0.25, 0.75]
    bake(engine, tmp_path, values, part="1")
    for written in (4, 0):
        again = bake(engine, tmp_path, values, method="binned", part="2-3")
        assert (again.written, mixed(again)) == (written, ["methods-mixed"])
    for file in tmp_path.glob("face.*.0001.exr"):
        file.unlink()
    assert mixed(bake(engine, tmp_path, values, method="binned", part="2-3")) == []


def test_parts_that_two_devices_draw_are_told(engine: FakeEngine, tmp_path: Path) -> None:
    values = [0.5, 0.25]
    assert mixed(bake(engine, tmp_path, values, part="1")) == []
    engine.revision = 1
    assert mixed(bake(engine, tmp_path, values, part="2")) == ["devices-mixed"]


@pytest.mark.parametrize("profiles", [["float"], ["half", "png16"]])
def test_a_map_is_found_in_its_frame_by_its_name(
    profiles: list[str], engine: FakeEngine, tmp_path: Path
) -> None:
    values = [0.5, 0.25, 0.75]
    bake(engine, tmp_path, values, profiles=profiles)
    part = bake(engine, tmp_path, values, profiles=profiles, method="binned", part="2-3")
    entry = {"key": "", "sha256": "", "method": "convolved"}
    others = dict.fromkeys(("face.0001.glb", "face.normal-dx.0003.1001.png"), entry)
    for name in others:
        (tmp_path / name).touch()
    (tmp_path / "face.bake.9.json").write_text(json.dumps({"maps": others}))
    found = part.output.by_method(part.frames.places)
    assert {name: frames and frames.text() for name, frames in found.items()} == {
        "binned": "2-3", "convolved": "1,3", "redraw": "1",
    }  # fmt: skip


def test_a_method_of_another_animation_is_named_without_frames(
    engine: FakeEngine, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bake(engine, tmp_path, [0.5, 0.25, 0.75])
    (tmp_path / "face.bake.json").rename(tmp_path / "face.bake.3.json")
    bake(engine, tmp_path, [0.5, 0.25], method="binned")
    told = "maps are by binned (frames 1-2) and redraw (other frames), as --frame-range takes them"
    assert told in capsys.readouterr().err


def test_frames_by_two_methods_are_told(
    engine: FakeEngine, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    values = [0.5, 0.25, 0.75]

    def told(method: str, **part: str) -> list[str]:
        return mixed(bake(engine, tmp_path, values, method=method, **part))

    assert told("redraw") == []
    capsys.readouterr()
    assert told("binned", part="2") == ["methods-mixed"]
    which = "maps are by binned (frames 2) and redraw (frames 1,3), as --frame-range takes them"
    assert which in capsys.readouterr().err
    by = {
        name: one["method"]
        for record in ("face.bake.json", "face.bake.2.json")
        for name, one in json.loads((tmp_path / record).read_bytes())["maps"].items()
    }
    assert {name.split(".")[2]: by[name] for name in by if name.startswith("face.1001")} == {
        "0001": "redraw", "0002": "binned", "0003": "redraw",
    }  # fmt: skip
    assert told("redraw") == []
    assert len([*tmp_path.glob("face.device.*.json")]) == 1


def test_what_is_drawn_anew_by_one_device_is_not_mixed(engine: FakeEngine, tmp_path: Path) -> None:
    values = [0.5, 0.25]
    bake(engine, tmp_path, values)
    engine.revision = 1
    assert mixed(bake(engine, tmp_path, values, part="1")) == ["devices-mixed"]
    assert mixed(bake(engine, tmp_path, values, part="2")) == []
    assert mixed(bake(engine, tmp_path, values)) == []
    assert len([*tmp_path.glob("face.device.*.json")]) == 1


def test_a_bake_that_was_ended_counts_as_a_device(engine: FakeEngine, tmp_path: Path) -> None:
    ended, values = baker(engine, tmp_path, [0.5, 0.25]), [0.5, 0.25]
    with pytest.raises(KeyboardInterrupt):
        ended.write(ended.frames.places, interrupted_after_one(ended.frames.places))
    assert (tmp_path / "face.bake.json").is_file()
    engine.revision = 1
    assert mixed(bake(engine, tmp_path, values, part="2")) == ["devices-mixed"]


def test_a_mark_that_another_part_took_away_comes_back(engine: FakeEngine, tmp_path: Path) -> None:
    values = [0.0625 * k for k in range(1, 13)]
    ended = baker(engine, tmp_path, values, part="1-11")

    def shown(places: Sequence[FramePlace]) -> Iterator[FramePlace]:
        yield places[0]
        [mark] = tmp_path.glob("face.device.*.json")
        mark.unlink()  # as a part does that ends before a record names the device
        yield from places[1:-1]
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        ended.write(ended.frames.places[:11], shown(ended.frames.places[:11]))
    engine.revision = 1
    assert mixed(bake(engine, tmp_path, values, part="12")) == ["devices-mixed"]


def test_mixed_devices_are_an_error_where_strict(engine: FakeEngine, tmp_path: Path) -> None:
    bake(engine, tmp_path, [0.5, 0.25], part="1")
    engine.revision = 1
    second = baker(engine, tmp_path, [0.5, 0.25], part="2")
    second.warnings = RunWarnings("bake", True)
    with pytest.raises(StrictError, match="devices-mixed"):
        second.run()
