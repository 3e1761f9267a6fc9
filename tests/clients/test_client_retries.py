"""Asking again: where the server says when, within a bound, and never otherwise."""

from __future__ import annotations

from collections.abc import Callable
from email.utils import format_datetime, parsedate_to_datetime
from pathlib import Path

import httpx
import numpy as np
import pytest

from clients.shells import Clock, Script, Shell, problem
from rhytid_client import Conflict, NotReady, ProblemError, ServerBusy, ServerError, TooMany

ASSET = {"id": "a", "state": "building", "job": "j"}


@pytest.mark.parametrize("status", [409, 429, 503])
def test_asks_again_when_told(shell: Callable[..., Shell], clock: Clock, status: int) -> None:
    first, second = problem(status, Retry_After="1"), problem(status, Retry_After="3")
    script = Script(first, second, httpx.Response(200, json=ASSET))
    assert shell(script).asset("a").id == "a"
    assert clock.pauses == [1.0, 3.0]
    assert len(script.seen) == 3


@pytest.mark.parametrize(("status", "error"), [(409, NotReady), (429, TooMany), (503, ServerBusy)])
def test_waiting_is_bounded(
    shell: Callable[..., Shell], clock: Clock, status: int, error: type[ProblemError]
) -> None:
    script = Script(problem(status, Retry_After="4"))
    with pytest.raises(error) as late:
        shell(script, max_wait=10).asset("a")
    assert clock.pauses == [4.0, 4.0]
    assert len(script.seen) == 3
    assert late.value.retry_after == 4.0


def test_every_request_has_its_own_bound(shell: Callable[..., Shell], clock: Clock) -> None:
    busy, good = problem(503, Retry_After="4"), httpx.Response(200, json=ASSET)
    client = shell(Script(busy, good, busy, good), max_wait=5)
    client.asset("a")
    client.asset("a")
    assert clock.pauses == [4.0, 4.0]


def test_zero_is_no_tight_loop(shell: Callable[..., Shell], clock: Clock) -> None:
    with pytest.raises(ServerBusy):
        shell(Script(problem(503, Retry_After="0")), max_wait=1).asset("a")
    assert 5 <= len(clock.pauses) <= 10
    assert min(clock.pauses) > 0


@pytest.mark.parametrize(("status", "error"), [(409, Conflict), (503, ServerError)])
@pytest.mark.parametrize("headers", [{}, {"Retry_After": "soon"}])
def test_not_told_not_asked_again(
    shell: Callable[..., Shell],
    clock: Clock,
    status: int,
    error: type[ProblemError],
    headers: dict[str, str],
) -> None:
    script = Script(problem(status, **headers))
    with pytest.raises(error):
        shell(script).tiles("a", np.zeros((1, 3)), [(1001, 0, 0, 0)])
    assert len(script.seen) == 1
    assert clock.pauses == []


@pytest.mark.parametrize("status", [401, 404, 500])
def test_other_refusals_stand_even_with_a_time(
    shell: Callable[..., Shell], clock: Clock, status: int
) -> None:
    script = Script(problem(status, Retry_After="1"))
    with pytest.raises(ProblemError, match=str(status)):
        shell(script).asset("a")
    assert len(script.seen) == 1


def test_time_may_be_a_date(
    shell: Callable[..., Shell], clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    date = parsedate_to_datetime("Wed, 21 Oct 2015 07:28:00 GMT")
    monkeypatch.setattr("rhytid_client.parse.time", lambda: date.timestamp() - 7)
    later = problem(503, Retry_After=format_datetime(date, usegmt=True))
    shell(Script(later, httpx.Response(200, json=ASSET))).asset("a")
    assert clock.pauses == [7.0]


def test_upload_is_sent_whole_again(
    shell: Callable[..., Shell], clock: Clock, tmp_path: Path
) -> None:
    mesh = tmp_path / "face.obj"
    mesh.write_bytes(bytes(range(256)) * 3000)
    script = Script(problem(503, Retry_After="1"), httpx.Response(202, json=ASSET))
    shell(script).create_asset(mesh, settings={"depth": 1.5})
    assert len(script.bodies) == 2
    assert script.bodies[0] == script.bodies[1]
    assert mesh.read_bytes() in script.bodies[1]
