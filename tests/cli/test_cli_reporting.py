"""Tables, figures and times."""

from __future__ import annotations

import io
import json
import re
import sys
import time
from contextlib import nullcontext
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
import tqdm  # type: ignore[import-untyped]

from rhytid.baking import assets
from rhytid.domain.wording import plural, waiting_requests
from rhytid.engine.messages import JobInfo
from rhytid.support import console
from rhytid.support.console import (
    Stopwatch,
    Verbosity,
    counted,
    detail,
    note,
    openjd_line,
    report,
    share_bar,
    table,
    use_verbosity,
    working,
)
from rhytid_client import Job
from rhytid_lab.commands.demo_session import StepClock, key_frames


def test_columns_of_numbers_are_right_aligned() -> None:
    text = table(("step", "ms", "note"), [("a", "5", "x"), ("bcd", "1234.5", "yz")])

    assert text.splitlines() == [
        "step      ms  note",
        "----  ------  ----",
        "a          5  x",
        "bcd   1234.5  yz",
    ]


def test_figures_go_where_they_are_wanted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    report({"a": 1}, "words", None)
    assert capsys.readouterr().out == "words\n"
    report({"a": 1}, "words", tmp_path / "f.json")
    assert capsys.readouterr().out == "words\n"
    assert json.loads((tmp_path / "f.json").read_text()) == {"a": 1}
    report({"a": 1}, "words", Path("-"))
    assert json.loads(capsys.readouterr().out) == {"a": 1}


def test_bars_are_silent_without_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    with share_bar("work") as show:
        show(0.5, "half")
    assert list(counted([1, 2], "things", "thing")) == [1, 2]
    assert capsys.readouterr() == ("", "")


def test_a_note_is_printed_while_another_thread_imports_bars(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "tqdm", ModuleType("tqdm"))  # nothing is in it yet
    note("a note")
    assert capsys.readouterr() == ("", "a note\n")


def test_without_a_terminal_long_work_tells_lines(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """One step that takes long is told, too."""
    monkeypatch.setattr(console, "_EVERY", 0.05)
    with share_bar("work") as show:
        show(0.5, "half")
        time.sleep(0.3)
    for _ in counted([1, 2], "baking", "frame"):
        time.sleep(0.3)
    told = capsys.readouterr().err
    time.sleep(0.2)
    assert capsys.readouterr().err == ""
    assert set(re.sub(r"[0-9]+ s\b", "N s", told).splitlines()) == {
        "rhytid: work: 50 %, half, N s",
        "rhytid: baking: frame 1 of 2, N s",
        "rhytid: baking: frame 2 of 2, N s",
    }


def test_what_comes_before_the_first_step_is_told_in_its_place(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with use_verbosity(Verbosity(for_job=True)):
        for _ in counted("ab", "baking", "frame", "workers start"):
            pass
    told = [line for line in capsys.readouterr().out.splitlines() if "status" in line]
    first, second = "openjd_status: baking: workers start", "openjd_status: baking: frame 2 of 2"
    assert told == [first, second]


@pytest.mark.parametrize(("seconds", "share"), [(10.0, 0.01), (1.0, 0.5), (10.0, 0.0)])
def test_an_estimate_is_not_told_before_it_says_anything(
    monkeypatch: pytest.MonkeyPatch, seconds: float, share: float
) -> None:
    clock = iter([0.0, seconds, 20.0])
    monkeypatch.setattr(console.time, "monotonic", lambda: next(clock))
    pace = console._Pace()
    pace.reached(share)
    assert pace.left(seconds) == ""
    pace.reached(0.5)
    assert pace.left(20.0) == ", 20 s left"


def test_an_estimate_that_ran_out_is_told_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter([0.0, 10.0])
    monkeypatch.setattr(console.time, "monotonic", lambda: next(clock))
    pace = console._Pace()
    pace.reached(0.5)
    assert [pace.left(seconds) for seconds in (12.0, 19.8, 40.0)] == [", 8 s left", "", ""]


def test_a_slow_first_step_and_skipped_ones_do_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ten steps: the first takes 30 s, the others 2; then a hundred of which most are there."""
    clock = iter([0.0, 30.0, 32.0, 34.0, 35.0])
    monkeypatch.setattr(console.time, "monotonic", lambda: next(clock))
    steps = console._Steps(10)
    assert steps.left() == ""
    for _ in range(3):
        steps.ended()
    assert steps.left() == ", 13 s left"

    times = [0.0] * 81 + [float(second) for second in range(10, 110, 10)]
    clock = iter(times)
    steps = console._Steps(100)
    for _ in range(89):
        steps.ended()
    assert steps.left() == ", 2 min left"


def test_the_time_left_is_that_of_steps_that_had_anything_to_do(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Ten steps, of which six are done before: the others take 5 s each."""
    clock = iter([0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 5.6, 5.6])
    monkeypatch.setattr(console.time, "monotonic", lambda: next(clock))
    steps = console._Steps(10)
    for _ in range(6):
        steps.ended(worked=False)
        assert steps.left() == ""
    steps.ended()
    assert steps.left() == ", 15 s left"


@pytest.mark.parametrize(
    ("voice", "told"),
    [
        (Verbosity(), ["a note", "rhytid: work: 0 %, half, 0 s"]),
        (Verbosity(quiet=True), []),
        (Verbosity(verbose=True), ["a note", "rhytid: work: half, after 0.0 s", "rhytid: detail"]),
    ],
)
def test_how_much_is_said(
    voice: Verbosity,
    told: list[str],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(console, "_EVERY", 0.1)
    with use_verbosity(voice):
        note("a note")
        with share_bar("work") as show:
            show(0.0, "half")
            time.sleep(0.15)
        detail("detail")
    said = capsys.readouterr().err.splitlines()
    assert set(told) <= set(said)
    assert bool(said) == bool(told)
    assert ("rhytid: detail" in said) == voice.verbose


def test_a_step_of_unknown_length_is_told_too(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(console, "_EVERY", 0.05)
    with working("reading face.obj"):
        time.sleep(0.12)
    assert set(capsys.readouterr().err.splitlines()) == {"rhytid: reading face.obj, 0 s"}


def test_a_terminal_shows_a_bar_with_the_time_left(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    now = 1000.0
    monkeypatch.setattr(console, "time", SimpleNamespace(monotonic=lambda: now))
    monkeypatch.setattr(tqdm.std, "time", lambda: now)
    for _ in counted([1, 2, 3], "baking", "frame"):
        now += 0.7
    shown = terminal.getvalue()
    assert re.search(r"baking:  33%.* 1/3 \[00:00, 1 s left\]", shown)
    assert "rhytid: " not in shown


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_plurals() -> None:
    assert [plural(n, "map") for n in (0, 1, 2)] == ["0 maps", "1 map", "2 maps"]
    assert plural(2, "entry", "entries") == "2 entries"
    assert waiting_requests(1) == "1 request waits for the device"
    assert waiting_requests(64) == "64 requests wait for the device"


def test_a_stopwatch_counts_calls() -> None:
    watch = Stopwatch()
    watch.add("draw", 0.5)
    watch.add("draw", 1.5)

    assert watch.figures() == {"draw": {"calls": 2, "seconds": 2.0}}
    assert watch.table().splitlines()[-1].split() == ["draw", "2", "2.00", "1000"]


def test_a_step_that_fails_is_not_counted() -> None:
    watch = Stopwatch()
    with pytest.raises(KeyError), watch.step("draw"):
        raise KeyError

    assert watch.figures() == {}


def test_what_a_job_waits_for_is_shown_until_it_moves(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str] = []
    bar = nullcontext(lambda share, stage: told.append(stage))
    monkeypatch.setattr(assets, "share_bar", lambda what: bar)
    ways = [("tile 1 of 2, compiling kernels", 0.0), ("tile 2 of 2", 0.5)]
    infos = [JobInfo("j", "a", "bins", "done", at, "making bins", way) for way, at in ways]
    job = SimpleNamespace(info=infos[0], reason="")

    def wait(seconds: float) -> bool:
        job.info = infos[min(len(told), 1)]
        return len(told) == 2

    job.wait = wait
    engine: Any = SimpleNamespace(jobs=SimpleNamespace(get=lambda name: job))
    assets.finish(engine, infos[0], "bins")

    assert told == ["making bins (tile 1 of 2, compiling kernels)", "making bins"]


def test_a_build_is_divided_at_its_stages() -> None:
    watch, told = Stopwatch(), []
    clock = StepClock(watch, lambda share, stage: told.append((share, stage)))

    for stage in ("pores", "trails", "placing pores and wrinkles", "storing", "making bins"):
        clock.follow(Job("j", "running", 0.5, stage))
    clock.stop()

    assert list(watch.seconds) == ["synthesis", "placing", "bins"]
    assert told[0] == (0.5, "pores")


@pytest.mark.parametrize(
    ("sizes", "frames"),
    [
        ([0.0, 1.0, 0.0], [1]),
        ([0.5], [0]),
        ([0.0, 0.0], [0]),
        ([0.1, 0.0, 0.9, 0.0, 0.1], [2]),
        ([0.3, 0.1, 0.2, 0.4], [3, 0, 2, 1]),
        ([0.3, 0.05, 0.2, 0.4], [3, 0, 2]),
        ([0, 1, 2, 1, 0, 1, 4, 1, 0, 1, 3, 1, 0, 1, 1, 1, 0], [6, 10, 2, 13]),
    ],
)
def test_key_frames_are_large_and_apart(sizes: list[float], frames: list[int]) -> None:
    assert key_frames(sizes) == frames


def test_key_frames_are_few() -> None:
    assert len(key_frames([1.0] * 100)) == 4


def test_a_job_is_told_in_its_own_lines(capsys: pytest.CaptureFixture[str]) -> None:
    with use_verbosity(Verbosity(for_job=True)):
        for _ in counted("ab", "baking", "frame"):
            pass
        with share_bar("work") as show:
            show(0.5, "half")
        openjd_line("fail", "two\nlines")
    told = [
        "openjd_status: baking: frame 1 of 2",
        "openjd_progress: 50.0",
        "openjd_status: baking: frame 2 of 2",
        "openjd_progress: 100.0",
        "openjd_status: work: half",
        "openjd_fail: two lines",
    ]
    assert capsys.readouterr() == ("\n".join(told) + "\n", "")
