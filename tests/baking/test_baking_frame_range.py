"""Ranges of frames, and parts of an animation that are baked apart."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from baking.bakers import bake, baker, maps
from baking.fake_engine import FakeEngine
from rhytid.baking.frame_names import FramePlace, FrameRange, frame_numbers
from rhytid.baking.output import Output
from rhytid.errors import InputError

VALUES = [0.5, 0.25, 0.75, 0.125]


def places(*labels: str) -> list[FramePlace]:
    return [FramePlace(label, None, index) for index, label in enumerate(labels)]


@pytest.mark.parametrize(
    ("text", "numbers"),
    [
        ("7", [7]),
        ("1-4", [1, 2, 3, 4]),
        ("1-10:3", [1, 4, 7, 10]),
        ("5, 1-3,2-4", [1, 2, 3, 4, 5]),
        ("-2-1", [-2, -1, 0, 1]),
        ("-5--4", [-5, -4]),
    ],
)
def test_a_range_names_its_frames(text: str, numbers: list[int]) -> None:
    assert FrameRange.parse(text).numbers == tuple(numbers)


@pytest.mark.parametrize("text", ["", "a", "1-", "1,,2", "4-1", "1-9:0", "1:2", "1-99999999"])
def test_what_is_no_range_is_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"range|frames"):
        FrameRange.parse(text)


@pytest.mark.parametrize(
    "text", ["1", "1-4", "1-3,7,9-12", "-3--1,5", "1-9:2", "1-7:3,8", "2,5,20-60:20", "1-2,9"]
)
def test_the_text_of_a_range_is_read_back(text: str) -> None:
    assert FrameRange.parse(text).text() == text


def test_the_name_of_a_file_has_a_bounded_length() -> None:
    odd, even = (FrameRange.of(n * n + first for n in range(40)) for first in (1, 2))
    assert len(odd.file_text()) == 17
    assert FrameRange.of_file_text(odd.file_text()) is None
    assert FrameRange.of_file_text("1-9x2") == FrameRange.parse("1-9:2")
    assert odd.file_text() != even.file_text()
    assert FrameRange.parse("1-9:2").file_text() == "1-9x2"
    assert FrameRange.parse("1-30").file_text() == "1-30"


@given(st.sets(st.integers(-50, 50), min_size=1))
def test_any_range_is_read_back(numbers: set[int]) -> None:
    assert FrameRange.parse(FrameRange.of(numbers).text()) == FrameRange.of(numbers)


def test_chunks_hold_every_frame_once() -> None:
    chunks = FrameRange.parse("1-5,9,10").chunks(3)
    assert [chunk.text() for chunk in chunks] == ["1-3", "4-5,9", "10"]


def test_frames_are_numbered_by_their_names() -> None:
    assert frame_numbers(places("0101", "-0003", "0005")) == [101, -3, 5]
    assert frame_numbers(places("0101", "smile", "0005")) == [1, 2, 3]


def test_frames_are_selected_by_number() -> None:
    found = FrameRange.parse("102,100").select(places("0102", "0101", "0100"))
    assert [place.label for place in found] == ["0100", "0102"]


def test_a_frame_that_is_missing_is_named() -> None:
    with pytest.raises(InputError, match=r"no frame 4-5,9; there are 1-3"):
        FrameRange.parse("2-5,9").select(places("0001", "0002", "0003"))


def test_parts_write_the_same_files_as_one_bake(tmp_path: Path) -> None:
    bake(FakeEngine(), tmp_path / "one", VALUES)
    for part in ("1-2", "3-4"):
        done = bake(FakeEngine(), tmp_path / "parts", VALUES, part=part)
        assert (done.written, done.skipped) == (4, 0)

    assert maps(tmp_path / "one") == maps(tmp_path / "parts")
    for name in maps(tmp_path / "one"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "parts" / name).read_bytes()


def test_each_part_has_a_record_and_all_are_read(tmp_path: Path) -> None:
    for part in ("1-2", "3-4"):
        bake(FakeEngine(), tmp_path, VALUES, part=part)
    records = sorted(file.name for file in tmp_path.glob("face.bake.*.json"))
    assert records == ["face.bake.1-2.json", "face.bake.3-4.json"]
    assert len(json.loads((tmp_path / records[0]).read_text())["maps"]) == 4

    engine = FakeEngine()
    again = bake(engine, tmp_path, VALUES)
    assert (again.written, again.skipped, engine.drawn) == (0, 8, [])
    other = bake(engine, tmp_path, VALUES, part="2-3")
    assert (other.written, other.skipped) == (0, 4)


def test_an_older_record_of_another_part_does_not_hide_a_newer_one(tmp_path: Path) -> None:
    bake(FakeEngine(), tmp_path, VALUES, part="1-2")
    changed = FakeEngine()
    changed.revision = 1
    assert bake(changed, tmp_path, VALUES).written == 8

    assert bake(changed, tmp_path, VALUES, part="2").skipped == 2


def test_a_part_is_calibrated_with_all_frames(tmp_path: Path) -> None:
    engine = FakeEngine()
    baker(engine, tmp_path, VALUES, method="binned", part="1-2").calibrate()
    assert engine.calibrated == [0.75]


def test_a_part_reads_the_records_that_concern_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for text in ("1-10", "11-20", "5-15", "40", "h0123456789abcdef"):
        (tmp_path / f"face.bake.{text}.json").write_text('{"maps": {}}')
    read: list[str] = []

    def load(path: Path) -> dict[str, dict[str, str]]:
        read.append(path.name)
        return {}

    monkeypatch.setattr("rhytid.baking.output._load", load)
    Output(tmp_path, "face", part=FrameRange.parse("11-20")).record("device")
    wanted = ["", ".11-20", ".5-15", ".h0123456789abcdef"]
    assert sorted(set(read)) == sorted(f"face.bake{text}.json" for text in wanted)
    read.clear()
    Output(tmp_path, "face").record("device")
    assert len(set(read)) == 6
