"""Programs that are built before they are asked for."""

from __future__ import annotations

import json
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rhytid.device import driver
from rhytid.device.ahead import ProgramsAhead
from rhytid.device.runtime import Device

HALVE: tuple[str, dict[str, object]] = ("level", {"UNUSED": 1})


@pytest.fixture
def fresh(device: Device) -> Device:
    """A device that has built nothing yet."""
    return Device(device.info, None)


@pytest.fixture
def built(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """The options of each program that is compiled."""
    options: list[list[str]] = []
    build = driver.compile_program

    def counted(context: Any, text: str, given: list[str]) -> Any:
        options.append(given)
        return build(context, text, given)

    monkeypatch.setattr(driver, "compile_program", counted)
    return options


def recalled(folder: Path, device: Device) -> Any:
    return json.loads((folder / "programs.json").read_text())[device.info.identity]


def halve(device: Device) -> None:
    fine, coarse = (device.full(n, np.float32(1.0)) for n in (16, 4))
    program, defines = HALVE
    device.launch(program, "halve", (2, 2), fine, np.int32(2), np.int32(0), coarse, defines=defines)
    device.finish()


def test_what_a_load_needed_is_built_at_the_next_start(
    device: Device, fresh: Device, tmp_path: Path, built: list[list[str]]
) -> None:
    first = ProgramsAhead(fresh, tmp_path)
    with first.noting():
        halve(fresh)
    first.close()
    assert len(built) == 1

    again = Device(device.info, None)
    ahead = ProgramsAhead(again, tmp_path)
    ahead.begin()
    ahead._thread.join()
    assert built[1:] == built[:1]
    halve(again)
    assert len(built) == 2
    ahead.close()


@pytest.mark.parametrize("known", ["{", "[]", '{"it": 3}', [["gone", {}], 3, ["level", []], HALVE]])
def test_a_record_that_does_not_hold_is_passed_over(
    fresh: Device, tmp_path: Path, built: list[list[str]], known: Any
) -> None:
    text = known if isinstance(known, str) else json.dumps({fresh.info.identity: known})
    (tmp_path / "programs.json").write_text(text, encoding="utf-8")
    ahead = ProgramsAhead(fresh, tmp_path)
    ahead.begin()
    ahead._thread.join()
    ahead.close()
    assert len(built) == (0 if isinstance(known, str) else 1)


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
