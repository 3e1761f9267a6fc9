"""Warnings in the SDK: on results, as Python's warnings, and as an error where strict."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import httpx
import numpy as np
import pytest

from clients.shells import Script, Shell
from rhytid_client import InputWarning, RequestError, RhytidWarning
from rhytid_client.npy import decode
from rhytid_client.warned import silent

WARNED = [{"code": "frame-scaled", "detail": "100 times", "where": "frame a", "later": 1}]
FOUND = (InputWarning("frame-scaled", "100 times", "frame a"),)
POSITIONS = np.arange(12, dtype=np.float64).reshape(4, 3) / 7
MIXED = (
    b"--b\r\nX-Rhytid-Tile: 1001/0/0/0\r\nContent-Length: 2\r\n\r\n\x00\x3c\r\n--b--\r\n"
)  # fmt: skip


def answer(call: str) -> httpx.Response:
    if call == "tiles":
        headers = {
            "content-type": "multipart/mixed; boundary=b",
            "x-rhytid-warnings": json.dumps(WARNED),
        }
        return httpx.Response(200, headers=headers, content=MIXED)
    return httpx.Response(200, json={"id": "a", "name": "a", "state": "x", "warnings": WARNED})


CALLS: dict[str, Callable[..., Any]] = {
    "create_asset": lambda c, **s: c.create_asset(b"o", name="a.obj", **s),
    "put_frame": lambda c, **s: c.put_frame("a", "f", POSITIONS, **s),
    "calibrate": lambda c, **s: c.calibrate("a", POSITIONS, **s),
    "tiles": lambda c, **s: c.tiles("a", POSITIONS, [(1001, 0, 0, 0)], format="f16", **s)[0],
}


@pytest.mark.parametrize("call", CALLS)
def test_warnings_are_on_the_result_and_python_s(shell: Callable[..., Shell], call: str) -> None:
    with pytest.warns(RhytidWarning, match="frame-scaled: frame a: 100 times") as told:
        found = CALLS[call](shell(Script(answer(call))))
    assert found.warnings == FOUND
    assert len(told) == 1
    assert "rhytid_client" not in told[0].filename


def test_the_line_that_called_is_named() -> None:
    with pytest.warns(RhytidWarning) as told:
        Shell("sync", Script(answer("put_frame"))).put_frame("a", "f", POSITIONS)
    assert told[0].filename == __file__


def test_one_thread_is_silent_and_others_are_not() -> None:
    """Python's own filters are shared: a host that set them would set those of its user."""
    with silent(), ThreadPoolExecutor(1) as pool:
        Shell("sync", Script(answer("put_frame"))).put_frame("a", "f", POSITIONS)
        other = Shell("sync", Script(answer("put_frame")))
        with pytest.warns(RhytidWarning):
            pool.submit(other.put_frame, "a", "f", POSITIONS).result()
    with pytest.warns(RhytidWarning):
        Shell("sync", Script(answer("put_frame"))).put_frame("a", "f", POSITIONS)


@pytest.mark.parametrize("call", ["asset", "frame"])
def test_asking_again_does_not_warn_again(shell: Callable[..., Shell], call: str) -> None:
    client = shell(Script(answer(call)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = client.asset("a") if call == "asset" else client.frame("a", "f")
    assert found.warnings == FOUND


@pytest.mark.parametrize("call", CALLS)
def test_strict_is_asked_for_and_raises(shell: Callable[..., Shell], call: str) -> None:
    body = {"title": "No", "status": 422, "detail": "because", "warnings": WARNED}
    script = Script(httpx.Response(422, json=body))
    with pytest.raises(RequestError) as refused:
        CALLS[call](shell(script), strict=True)
    assert refused.value.warnings == FOUND
    assert script.seen[0].url.params["strict"] == "true"
    plain = Script(answer(call))
    with pytest.warns(RhytidWarning):
        CALLS[call](shell(plain))
    assert "strict" not in plain.seen[0].url.params


@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize("allow", [["frame-scaled", "mesh-size"], "frame-scaled"])
def test_what_is_allowed_is_sent(shell: Callable[..., Shell], call: str, allow: Any) -> None:
    script = Script(answer(call))
    with pytest.warns(RhytidWarning):
        CALLS[call](shell(script), strict=True, allow=allow)
    codes = [allow] if isinstance(allow, str) else allow
    assert script.seen[0].url.params.get_list("allow") == codes


@pytest.mark.parametrize(("where", "dtype"), [(1.0, "<f4"), (1e4, "<f8")])
def test_doubles_far_away_stay_doubles(
    shell: Callable[..., Shell], where: float, dtype: str
) -> None:
    script = Script(httpx.Response(200, json={"name": "f"}))
    client = shell(script)
    client.put_frame("a", "f", POSITIONS + where)
    client.put_frame("a", "f", np.float32(POSITIONS + where))
    client.put_frame("a", "f", POSITIONS + where, raw=True)
    sent = decode(script.bodies[0])
    assert sent.dtype == dtype
    np.testing.assert_array_equal(sent, (POSITIONS + where).astype(dtype))
    assert decode(script.bodies[1]).dtype == np.float32
    assert len(script.bodies[2]) == 12 * 4
