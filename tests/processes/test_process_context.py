"""What goes with a call to the process of the device, and back with its answer."""

from __future__ import annotations

import threading
from contextvars import Context
from multiprocessing import Pipe
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from rhytid.device.figures import Figures, spans_of_request
from rhytid.domain.tiles import TileAddress
from rhytid.engine.call_context import drawn_live, is_live
from rhytid.engine.frames import Frame
from rhytid.engine.messages import MapQuery
from rhytid.engine.operations import OPERATIONS
from rhytid.errors import NotFoundError
from rhytid.processes import lines
from rhytid.processes.child import _Process
from rhytid.processes.envelope import Answer, Envelope, Request, answered
from rhytid.processes.lines import Line
from rhytid.processes.packing import shared_file, unpack
from rhytid.processes.wire import Message
from rhytid.support.logs import request_id

FIGURES = Figures()


def perform(envelope: Envelope) -> str:
    """Tells the id of the request."""
    FIGURES.took("kernel", 7)
    if envelope.name == "jobs.info":
        raise NotFoundError("no")
    return "live" if is_live() else request_id.get()


def performed(name: str) -> Answer:
    packed = Request(OPERATIONS[name], ("a",)).packed
    # As in another process, where nothing of this context is known.
    envelope = unpack(packed.body, packed.places, None)
    return Context().run(answered, envelope, perform, lambda: False)


@pytest.fixture
def named() -> Any:
    token = request_id.set("farm-7")
    yield
    request_id.reset(token)


@pytest.mark.usefixtures("named")
def test_the_id_of_the_request_comes_to_the_process() -> None:
    found = performed("assets.info")
    assert (found.good, found.value, found.spans) == (True, "farm-7", ())


@pytest.mark.usefixtures("named")
def test_that_it_is_for_a_live_connection_comes_to_the_process() -> None:
    one = Request(OPERATIONS["assets.info"], ("a",))
    with drawn_live():
        assert performed("assets.info").value == "live"
        other = Request(OPERATIONS["assets.info"], ("a",))
        assert one.digest == other.digest
    assert performed("assets.info").value == "farm-7"


def test_stages_come_back_where_they_are_wanted() -> None:
    with spans_of_request():
        good, failed = performed("assets.info"), performed("jobs.info")
    assert (good.good, failed.good, str(failed.value)) == (True, False, "no")
    for found in (good.spans, failed.spans):
        assert [(span.stage, span.nanoseconds) for span in found] == [("kernel", 7)]


def test_the_id_of_the_request_does_not_make_another_call() -> None:
    one = Request(OPERATIONS["assets.info"], ("a",))
    token = request_id.set("other")
    other = Request(OPERATIONS["assets.info"], ("a",))
    assert one.packed.body != other.packed.body
    request_id.reset(token)
    assert one.digest == other.digest


def test_an_error_of_the_system_is_logged_where_it_was_raised(
    caplog: pytest.LogCaptureFixture,
) -> None:
    def fail(envelope: Envelope) -> None:
        raise PermissionError(13, "no")

    answer = answered(Request(OPERATIONS["assets.info"], ("a",)).envelope, fail, lambda: False)
    assert isinstance(answer.value, PermissionError)
    (record,) = caplog.records
    assert record.getMessage() == "assets.info failed"
    assert record.exc_info is not None


def test_an_answer_that_cannot_be_sent_is_an_error() -> None:
    """Else the line would end, and its user wait for the end of the process."""
    process = _Process(cast(Any, None))
    process._engine = cast(Any, SimpleNamespace(jobs=SimpleNamespace(info=lambda id: lambda: id)))
    packed = Request(OPERATIONS["jobs.info"], ("a",)).packed
    near, far = Pipe()
    with near, far:
        found = process._answered(Message(packed.body, packed.places), near, None)
    answer: Answer = unpack(found.body, found.places, None)
    assert not answer.good
    assert isinstance(answer.value, RuntimeError)


def test_arrays_of_a_call_lie_in_the_memory_of_its_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """Once there is any; and stay as they were sent where the engine keeps them."""
    kept: list[Any] = []

    def draw(asset: str, frame: Frame, *others: Any) -> Any:
        kept.append(frame.positions)
        return frame.positions + 1.0

    process, made = _Process(cast(Any, None)), []
    process._engine = cast(Any, SimpleNamespace(tiles=SimpleNamespace(draw=draw)))
    monkeypatch.setattr(lines, "shared_file", lambda size: made.append(size) or shared_file(size))
    near, far = Pipe()
    line, thread = Line(near), threading.Thread(target=process._answer, args=(far,))
    thread.start()
    frames = [np.full((vertices, 3), n, np.float32) for n, vertices in enumerate((1024, 960, 3008))]
    for positions in frames:
        place = (MapQuery(), TileAddress(1001, 0, 0, 0))
        request = Request(OPERATIONS["tiles.draw"], ("a", Frame.of(positions), *place))
        answer, holds = line.ask(request.packed, None)
        assert answer.value.tobytes() == (positions + 1.0).tobytes()
        # The answer lies there by now, and what is sent next will.
        sent = request.packed.shared().positional[1].positions
        assert sent.tobytes() == positions.tobytes()
        del answer, holds
    line.close()
    thread.join()
    sizes = [positions.nbytes for positions in frames]
    assert made == [sizes[i] for i in (0, 0, 2, 2)]
    assert [array.tobytes() for array in kept] == [array.tobytes() for array in frames]
