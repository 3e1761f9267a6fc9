"""What goes with a call to the process of the device, and back with its answer."""

from __future__ import annotations

from contextvars import Context
from typing import Any, cast

import pytest

from rhytid.device.figures import Figures, spans_of_request
from rhytid.engine.worker import drawn_live, is_live
from rhytid.engine_process.child import _Process
from rhytid.engine_process.packing import unpack
from rhytid.engine_process.requests import Call, Request
from rhytid.engine_process.wire import Message
from rhytid.errors import NotFoundError
from rhytid.support.logs import request_id

FIGURES = Figures()


class Told:
    """Calls that tell the id of their request."""

    def perform(self, call: Call) -> str:
        FIGURES.took("kernel", 7)
        if call.name == "fails":
            raise NotFoundError("no")
        return "live" if is_live() else request_id.get()


def performed(name: str) -> tuple[bool, Any, Any]:
    process = _Process(cast(Any, None))
    process._calls = cast(Any, Told())
    request = Request(name)
    packed = request.packed
    # As in another process, where nothing of this context is known.
    message = Message(packed.body, packed.sizes)
    answer = Context().run(process._performed, message, None)
    found: tuple[bool, Any, Any] = unpack(answer.body, answer.sizes, None)
    return found


@pytest.fixture
def named() -> Any:
    token = request_id.set("farm-7")
    yield
    request_id.reset(token)


@pytest.mark.usefixtures("named")
def test_the_id_of_the_request_comes_to_the_process() -> None:
    assert performed("tile") == (True, "farm-7", ())


@pytest.mark.usefixtures("named")
def test_that_it_is_for_a_live_connection_comes_to_the_process() -> None:
    one = Request("tile", ("a",))
    with drawn_live():
        assert performed("tile")[1] == "live"
        other = Request("tile", ("a",))
        assert one.digest == other.digest
    assert performed("tile")[1] == "farm-7"


def test_stages_come_back_where_they_are_wanted() -> None:
    with spans_of_request():
        good, _, spans = performed("tile")
        failed, error, others = performed("fails")
    assert (good, failed, str(error)) == (True, False, "no")
    for found in (spans, others):
        assert [(span.stage, span.nanoseconds) for span in found] == [("kernel", 7)]


def test_the_id_of_the_request_does_not_make_another_call() -> None:
    one = Request("tile", ("a",))
    token = request_id.set("other")
    other = Request("tile", ("a",))
    assert one.packed.body != other.packed.body
    request_id.reset(token)
    assert one.digest == other.digest
