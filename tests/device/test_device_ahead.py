"""Programs that are built before they are asked for."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rhytid.device import ahead as module
from rhytid.device import driver
from rhytid.device.ahead import ProgramsAhead
from rhytid.device.runtime import Device

HALVE: tuple[str, dict[str, object]] = ("level", {"UNUSED": 1})


@pytest.fixture
def fresh(device: Device) -> Device:
    """A device that has built nothing yet."""
    return Device(device.info, None)


def recalled(folder: Path, device: Device) -> Any:
    return json.loads((folder / "programs.json").read_text())[device.info.identity]


def halve(device: Device) -> None:
    fine, coarse = (device.full(n, np.float32(1.0)) for n in (16, 4))
    program, defines = HALVE
    device.launch(program, "halve", (2, 2), fine, np.int32(2), np.int32(0), coarse, defines=defines)
    device.finish()


def test_what_a_load_needed_is_built_at_the_next_start(
    device: Device, fresh: Device, tmp_path: Path, compilations: list[list[str]]
) -> None:
    first = ProgramsAhead(fresh, tmp_path)
    with first.noting():
        halve(fresh)
    first.close()
    assert len(compilations) == 1

    again = Device(device.info, None)
    ahead = ProgramsAhead(again, tmp_path)
    ahead.begin()
    ahead._thread.join()
    assert compilations[1:] == compilations[:1]
    halve(again)
    assert len(compilations) == 2
    ahead.close()


def listed(device: Device) -> None:
    """Ask for another program than `halve` does."""
    device.programs.kernel("vectors", "count_triangles")


def names(folder: Path, device: Device) -> list[str]:
    return [name for name, *_ in recalled(folder, device)]


def test_what_drew_after_a_load_is_built_too(fresh: Device, tmp_path: Path) -> None:
    ahead = ProgramsAhead(fresh, tmp_path)
    with ahead.noting():
        halve(fresh)
    listed(fresh)
    fresh.programs.kernel("incidence", "count_pairs")  # skin grows meanwhile
    ahead.note_drawn()
    assert names(tmp_path, fresh) == ["level", "vectors"]
    again = ProgramsAhead(fresh, tmp_path)
    with again.noting():
        halve(fresh)
    assert names(tmp_path, fresh) == ["level", "vectors"], "the same load"
    with again.noting():
        listed(fresh)
    assert names(tmp_path, fresh) == ["vectors"], "another load"


def test_what_drew_after_a_load_is_built_after_what_a_load_needs(
    fresh: Device, tmp_path: Path, compilations: list[list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    drew = [["level", {"UNUSED": 2}, "drew"], ["level", {"UNUSED": 3}, "drew"]]
    text = json.dumps({fresh.info.identity: [HALVE, *drew]})
    (tmp_path / "programs.json").write_text(text, encoding="utf-8")
    ahead = ProgramsAhead(fresh, tmp_path)
    waits: list[tuple[float, int]] = []

    def wait(seconds: float) -> bool:
        waits.append((seconds, len(compilations)))
        return False

    monkeypatch.setattr(ahead._closed, "wait", wait)
    ahead.begin()
    ahead._thread.join()
    assert waits == [(module._LATER, 1)]
    assert [given[1:] for given in compilations] == [["-DUNUSED=1"], ["-DUNUSED=2"], ["-DUNUSED=3"]]
    ahead.close()


@pytest.fixture
def other(device: Device) -> Iterator[Callable[[], None]]:
    """Builds a program on a thread that is there before, as an engine that tests share does."""
    go, own = threading.Event(), Device(device.info, None)

    def build() -> None:
        assert go.wait(60)
        own.programs.prepare("level", {"UNUSED": 9})

    thread = threading.Thread(target=build)
    thread.start()
    yield lambda: (go.set(), thread.join())[1]
    go.set()
    thread.join()


def test_what_other_engines_build_meanwhile_does_not_count(
    other: Callable[[], None], compilations: list[list[str]]
) -> None:
    other()
    assert compilations == []


def test_who_closes_does_not_wait_for_what_is_built_later(fresh: Device, tmp_path: Path) -> None:
    drew = [["level", {"UNUSED": 2}, "drew"]]
    (tmp_path / "programs.json").write_text(json.dumps({fresh.info.identity: drew}))
    ahead = ProgramsAhead(fresh, tmp_path)
    ahead.begin()
    ahead.close()
    assert not ahead._thread.is_alive()
    assert recalled(tmp_path, fresh) == drew


def test_programs_without_end_are_not_remembered(
    fresh: Device, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_MOST", 3)
    ahead = ProgramsAhead(fresh, tmp_path)
    with ahead.noting():
        halve(fresh)
    for number in range(4):
        fresh.programs._noted["level", (("UNUSED", number + 2),)] = None
        ahead.note_drawn()
    assert len(recalled(tmp_path, fresh)) == 3


@pytest.mark.parametrize("known", ["{", "[]", '{"it": 3}', [["gone", {}], 3, ["level", []], HALVE]])
def test_a_record_that_does_not_hold_is_passed_over(
    fresh: Device, tmp_path: Path, compilations: list[list[str]], known: Any
) -> None:
    text = known if isinstance(known, str) else json.dumps({fresh.info.identity: known})
    (tmp_path / "programs.json").write_text(text, encoding="utf-8")
    ahead = ProgramsAhead(fresh, tmp_path)
    ahead.begin()
    ahead._thread.join()
    ahead.close()
    assert len(compilations) == (0 if isinstance(known, str) else 1)
    fresh.programs.begin_noting()
    listed(fresh)
    ahead.note_drawn()
    assert "vectors" in names(tmp_path, fresh)


def test_while_it_builds_nothing_is_remembered(
    fresh: Device, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A compiler that ends the process would end it at every start."""
    (tmp_path / "programs.json").write_text(json.dumps({fresh.info.identity: [HALVE]}))
    seen = []
    prepare = "rhytid.device.programs.Programs.prepare"
    monkeypatch.setattr(prepare, lambda *_: seen.append(recalled(tmp_path, fresh)))
    ahead = ProgramsAhead(fresh, tmp_path)
    ahead.begin()
    ahead._thread.join()
    ahead.close()
    assert seen == [[]]
    assert recalled(tmp_path, fresh) == [list(HALVE)]


def test_a_program_is_built_once_for_all_who_ask_at_a_time(
    fresh: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, go, calls = threading.Event(), threading.Event(), []

    def slow(context: Any, text: str, given: list[str]) -> Any:
        calls.append(given)
        begun.set()
        assert go.wait(60)
        return "built"

    monkeypatch.setattr(driver, "compile_program", slow)
    threads = [threading.Thread(target=fresh.programs.prepare, args=HALVE) for _ in range(2)]
    for thread in threads:
        thread.start()
        assert begun.wait(60)
    threads[1].join(0.2)
    assert threads[1].is_alive()
    go.set()
    for thread in threads:
        thread.join()
    assert len(calls) == 1
