"""How a command ends: status and words."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from collections.abc import Callable

import pytest

from rhytid.cli import devices, main
from rhytid.cli.termination import Terminated, interruptible
from rhytid.errors import MeshError, RhytidError


@pytest.fixture
def ending(monkeypatch: pytest.MonkeyPatch) -> Callable[[BaseException | None], int]:
    """Run `rhytid devices` so that it ends with an exception; answers the exit status."""

    def run(error: BaseException | None) -> int:
        def fail(arguments: argparse.Namespace) -> None:
            if error is not None:
                raise error

        monkeypatch.setattr(devices, "run", fail)
        return main(["devices"])

    return run


Ending = Callable[[BaseException | None], int]


def test_all_done_is_0(ending: Ending, capsys: pytest.CaptureFixture[str]) -> None:
    assert ending(None) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (MeshError("face 3 has no uv"), "face 3 has no uv"),
        (RhytidError("anything of ours"), "anything of ours"),
        (FileNotFoundError(2, "No such file or directory", "a.obj"), "a.obj: No such file"),
        (OSError(28, "No space left on device"), "No space left on device"),
    ],
)
def test_errors_are_1_and_one_line(
    error: Exception, told: str, ending: Ending, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ending(error) == 1
    line = capsys.readouterr().err
    assert line.startswith(f"rhytid devices: {told}")
    assert line.count("\n") == 1


def test_a_reader_that_has_ended_is_141_and_no_error() -> None:
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer) as output:
        done = subprocess.run(
            [sys.executable, "-m", "rhytid", "warnings"],
            stdout=output, stderr=subprocess.PIPE, timeout=60, check=False,
        )  # fmt: skip
    assert (done.returncode, done.stderr) == (141, b"")


def test_interrupted_is_130(ending: Ending, capsys: pytest.CaptureFixture[str]) -> None:
    assert ending(KeyboardInterrupt()) == 130
    assert capsys.readouterr().err == "rhytid devices: interrupted\n"


def test_faults_of_ours_are_not_hidden(ending: Ending) -> None:
    with pytest.raises(ZeroDivisionError):
        ending(ZeroDivisionError())


def test_sigterm_unwinds() -> None:
    import signal

    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(Terminated) as end, interruptible():
        signal.raise_signal(signal.SIGTERM)
    assert end.value.code == 143
    assert signal.getsignal(signal.SIGTERM) is before


@pytest.mark.parametrize("later", [None, OSError(39, "Directory not empty", "folder")])
def test_a_command_that_sigterm_ends_says_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], later: Exception | None
) -> None:
    """Whatever comes of it while it unwinds."""
    import signal

    def terminated(*_: object) -> None:
        try:
            signal.raise_signal(signal.SIGTERM)
        except Terminated:
            if later is not None:
                raise later from None
            raise

    monkeypatch.setattr(devices, "run", terminated)
    with pytest.raises(Terminated) as end:
        main(["devices"])
    assert end.value.code == 143
    assert capsys.readouterr().err == "rhytid devices: cancelled by SIGTERM\n"


def test_sigint_after_sigterm_ends_with_the_status_of_sigterm(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import signal

    def both(*_: object) -> None:
        try:
            signal.raise_signal(signal.SIGTERM)
        finally:
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(devices, "run", both)
    assert main(["devices"]) == 143
    assert capsys.readouterr().err == "rhytid devices: cancelled by SIGTERM\n"
