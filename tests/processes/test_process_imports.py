"""What a server and the process of its device import before they can answer, and which is begun
first."""

from __future__ import annotations

import subprocess
import sys

import pytest

from rhytid.processes import interpreter
from rhytid.processes.interpreter import interpreter_ahead, next_interpreter, possible

pytestmark = pytest.mark.skipif(not possible(), reason="a device has no process of its own here")

LATER = {
    "rhytid.cli.serve": {"numpy", "rhytid.engine", "rhytid.api"},
    "rhytid.processes.remote_engine": {"pyopencl", "rhytid.engine.engine"},
    "rhytid.processes.child": {
        "pydantic",
        "PIL",
        "asyncio",
        "rhytid.synthesis.generate",
        "rhytid.tracing.trace",
        "rhytid.exports.skin_package",
    },
}


@pytest.mark.parametrize("module", LATER)
def test_what_is_imported_later(module: str) -> None:
    code = f"import sys, {module}; print(*{sorted(LATER[module])!r} & sys.modules.keys())"
    code = code.replace("[", "{").replace("]", "}")
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout.split() == []


def test_the_process_that_was_begun_is_taken_once() -> None:
    with interpreter_ahead():
        first = next_interpreter()
        second = next_interpreter()
        assert first.process.pid != second.process.pid
        for one in (first, second):
            assert one.process.poll() is None
            one.end()


def test_a_process_that_nobody_took_ends_with_the_block() -> None:
    with interpreter_ahead():
        (one,) = interpreter._begun
        assert one.process.poll() is None
    assert one.process.poll() is not None
    assert one.control.closed


def test_a_process_that_cannot_be_begun_is_missed_by_who_takes_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fail(control: int) -> None:
        raise BlockingIOError(11, "Resource temporarily unavailable")

    monkeypatch.setattr(interpreter, "_spawned", fail)
    with interpreter_ahead(), pytest.raises(BlockingIOError):
        next_interpreter()
