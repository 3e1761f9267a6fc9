"""A process of the device that cannot be started is tried again, and said to be missing."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from api.asking import is_problem
from processes.served import LONG, await_value, serving
from rhytid.device.watch import Purpose
from rhytid.engine.frames import Frame, UnknownFrameError
from rhytid.engine.operations import OPERATIONS
from rhytid.errors import DeviceError, DeviceLostError, FatalRequestError
from rhytid.processes import device_process, interpreter, supervisor
from rhytid.processes.device_process import DeviceProcess, Ending
from rhytid.processes.envelope import Answer, Request
from rhytid.processes.supervisor import Supervisor
from rhytid.processes.wire import Start
from rhytid.support.settings import ServiceSettings

KILLED = Ending("killed", "it ended by SIGKILL", Purpose())
SEGV = Ending("fault", "it ended by SIGSEGV", Purpose())
NO_ROOM = BlockingIOError(11, "Resource temporarily unavailable")


class Starts:
    """Stands in for `DeviceProcess`.  failing: what the next starts raise, in order; a process that
    is in `mute` never answers and ends at once."""

    def __init__(self) -> None:
        self.failing: list[BaseException | str] = []
        self.made: list[Started] = []
        self.tried = 0

    def __call__(self, start: Any, on_message: Any, on_ready: Any, memory: int) -> Any:
        self.tried += 1
        wrong = self.failing.pop(0) if self.failing else None
        if isinstance(wrong, BaseException):
            raise type(wrong)(*wrong.args)
        made = Started(on_ready, mute=wrong is not None)
        self.made.append(made)
        return made


class Started:
    pid = 4711

    def __init__(self, on_ready: Callable[[Any], None], *, mute: bool) -> None:
        self.started: Future[None] = Future()
        self.ending: Future[Ending] = Future()
        self.lines = SimpleNamespace(ask=lambda *_: Answer(True, "answer"))
        self._on_ready, self._mute, self._over = on_ready, mute, threading.Event()

    def watch(self) -> Ending:
        if not self._mute:
            self.started.set_result(None)
            self._on_ready(self)
            assert self._over.wait(LONG)
        return KILLED

    def close(self) -> None:
        self._over.set()


@pytest.fixture
def starts(monkeypatch: pytest.MonkeyPatch) -> Starts:
    made = Starts()
    monkeypatch.setattr(supervisor, "DeviceProcess", made)
    monkeypatch.setattr(supervisor, "_FIRST_PAUSE", 0.001)
    return made


@contextmanager
def supervised(on_end: Callable[[Any], None] = lambda process: None) -> Iterator[Supervisor]:
    made = Supervisor(ServiceSettings(), lambda message: None, on_end)
    try:
        yield made
    finally:
        made.close()


@pytest.mark.parametrize(
    ("wrong", "said"),
    [(NO_ROOM, "Resource temporarily unavailable"), (MemoryError(), "MemoryError"),
     ("mute", "it ended by SIGKILL")],
)  # fmt: skip
def test_a_first_process_that_does_not_start_is_an_error(
    starts: Starts, wrong: Any, said: str
) -> None:
    starts.failing = [wrong] * 9
    with supervised() as running, pytest.raises(DeviceError, match=said):
        running.start()
    assert starts.tried == 1


def test_a_process_that_cannot_be_started_is_tried_again(starts: Starts) -> None:
    with supervised() as running:
        running.start()
        starts.failing = [NO_ROOM, MemoryError(), "mute", subprocess.SubprocessError("no"), NO_ROOM]
        starts.made[0].close()
        await_value(lambda: len(starts.made) == 3 and running.ready is starts.made[2])
        assert running.restarts == {"killed": 1, "start": 5}
        assert running.call(Request(OPERATIONS["ready"])) == "answer"
        assert (running.runs, running.well) == (True, True)


def test_pauses_between_starts_grow_and_end(
    starts: Starts, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(supervisor, "_FIRST_PAUSE", 0.5)
    pauses: list[float] = []
    wait = threading.Condition.wait_for

    def note(self: Any, predicate: Any, timeout: float | None = None) -> Any:
        if threading.current_thread().name != "rhytid-supervisor":
            return wait(self, predicate, timeout)
        pauses.append(cast(float, timeout))
        return wait(self, predicate, 0)

    monkeypatch.setattr(threading.Condition, "wait_for", note)
    with supervised() as running:
        running.start()
        starts.failing = [NO_ROOM] * 50
        starts.made[0].close()
        await_value(lambda: len(starts.made) == 2)
    assert pauses[:9] == [0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 30.0, 30.0]
    assert len(pauses) >= 50
    assert max(pauses) == 30.0


def test_who_asks_meanwhile_is_told_at_once(
    starts: Starts, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(supervisor, "PATIENCE", 10 * LONG)
    with supervised() as running:
        running.start()
        starts.failing = [NO_ROOM] * 1000
        starts.made[0].close()
        await_value(lambda: running.ready is None)
        with pytest.raises(DeviceLostError) as refused:
            running.call(Request(OPERATIONS["ready"]))
        assert refused.value.retry_after > 0
        starts.failing = []
        await_value(lambda: running.ready)


def test_a_process_that_lacks_the_positions_absolves_nothing(starts: Starts) -> None:
    """What ended a process is asked of the next by the digest of its frame alone, and then sent
    whole: that counts as the same call."""
    positions = np.zeros((3, 3), np.float32)
    drawing = Request(OPERATIONS["tiles.draw"], ("a", Frame.of(positions), "query", "place"))
    with supervised() as running:
        running.start()
        running._refusals.strike(drawing, SEGV)
        unknown = Answer(False, UnknownFrameError("it is not here"))
        starts.made[0].lines = SimpleNamespace(ask=lambda *_: unknown)
        with pytest.raises(UnknownFrameError):
            running.call(drawing.bare)
        running._refusals.strike(drawing, SEGV)
        with pytest.raises(FatalRequestError):
            running.call(drawing)


def test_the_server_is_not_well_without_a_process_for_long(
    starts: Starts, monkeypatch: pytest.MonkeyPatch
) -> None:
    with supervised() as running:
        running.start()
        monkeypatch.setattr(supervisor, "UNWELL", -1.0)
        assert running.well, "a process answers"
        starts.failing = [NO_ROOM] * 1000
        starts.made[0].close()
        await_value(lambda: running.ready is None)
        assert not running.well
        monkeypatch.setattr(supervisor, "UNWELL", LONG)
        assert running.well, "not yet for long"
        starts.failing = []
        await_value(lambda: running.ready)


def test_an_error_at_an_end_does_not_end_the_supervisor(starts: Starts) -> None:
    def fail(process: Any) -> None:
        raise ZeroDivisionError

    with supervised(fail) as running:
        running.start()
        starts.made[0].close()
        assert starts.made[0].ending.result(LONG) is KILLED
        await_value(lambda: len(starts.made) == 2 and running.ready is starts.made[1])


def test_a_start_that_fails_keeps_no_descriptors(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: int) -> Any:
        raise NO_ROOM

    monkeypatch.setattr(interpreter, "_spawned", fail)
    start = Start(ServiceSettings(), {}, 0)
    before = len(list(Path("/proc/self/fd").iterdir()))
    for _ in range(20):
        with pytest.raises(BlockingIOError):
            DeviceProcess(start, lambda message: None, lambda process: None, -1)
    assert len(list(Path("/proc/self/fd").iterdir())) <= before


def test_a_process_that_never_answers_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    def sleeper(control: int, *_: int) -> Any:
        command = [sys.executable, "-c", f"import time; time.sleep({LONG})"]
        return subprocess.Popen(command, pass_fds=(control,))

    monkeypatch.setattr(interpreter, "_spawned", sleeper)
    monkeypatch.setattr(device_process, "STARTING", 0.0)
    start = Start(ServiceSettings(), {}, 0)
    ending = DeviceProcess(start, lambda message: None, lambda process: None, -1).watch()
    assert (ending.kind, ending.blames) == ("killed", False)
    assert "did not answer within" in ending.reason


RUN = "import sys; sys.executable = sys.argv.pop(1); from rhytid.cli.program import run; "
RUN += "from rhytid.cli.termination import Interruption; sys.exit(run(None, Interruption()))"


@pytest.mark.slow
def test_a_server_whose_first_process_cannot_be_started_ends(tmp_path: Path) -> None:
    command = [sys.executable, "-c", RUN, str(tmp_path / "absent"), "serve", "--port", "0"]
    ended = subprocess.run(
        [*command, "--store", str(tmp_path / "store")],
        capture_output=True, text=True, timeout=LONG, check=False,
    )  # fmt: skip
    assert ended.returncode == 1
    assert "rhytid serve: the process of the device cannot be started" in ended.stderr
    assert "absent" in ended.stderr


@pytest.mark.slow
def test_a_server_goes_on_once_a_process_can_be_started(tmp_path: Path, faults: Path) -> None:
    python = tmp_path / "python"
    python.symlink_to(sys.executable)
    with serving(tmp_path, faults, run=("-c", RUN, str(python))) as served:
        served.make()
        before = served.tile().content
        child = served.child
        python.unlink()
        os.kill(child, signal.SIGKILL)
        await_value(lambda: served.restarts().get("start", 0) >= 3)
        answer = served.tile()
        is_problem(answer, 503, "device-lost")
        assert int(answer.headers["Retry-After"]) > 0
        assert served.client.get("/readyz").status_code == 503
        assert served.client.get("/healthz").status_code == 200
        python.symlink_to(sys.executable)
        await_value(served.ready)
        assert served.tile().content == before
