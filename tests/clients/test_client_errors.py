"""Every refusal, broken connection and unreadable answer is an exception of our own."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable

import httpx
import numpy as np
import pytest

from clients.shells import Script, Shell, problem
from rhytid_client import errors

TILE = ("a", "smile", 1001, 0, 2, 3)
LATER = {"Retry_After": "2"}


@pytest.mark.parametrize(
    ("status", "headers", "error"),
    [
        (400, {}, errors.RequestError),
        (401, {}, errors.NotAllowed),
        (403, {}, errors.NotAllowed),
        (404, {}, errors.NotFound),
        (409, {}, errors.Conflict),
        (409, LATER, errors.NotReady),
        (413, {}, errors.TooLarge),
        (415, {}, errors.RequestError),
        (422, {}, errors.RequestError),
        (429, LATER, errors.TooMany),
        (500, {}, errors.ServerError),
        (503, {}, errors.ServerError),
        (503, LATER, errors.ServerBusy),
        (507, {}, errors.ServerError),
    ],
)
def test_refusal(
    shell: Callable[..., Shell],
    status: int,
    headers: dict[str, str],
    error: type[errors.ProblemError],
) -> None:
    script = Script(problem(status, "kind", **headers))
    with pytest.raises(errors.ProblemError) as refused:
        shell(script, max_wait=0).asset("a")
    exc = refused.value
    assert type(exc) is error
    assert isinstance(exc, errors.RequestError if status < 500 else errors.ServerError)
    assert (exc.status, exc.title, exc.detail, exc.type) == (status, "No", "because", "urn:kind")
    assert exc.retry_after == (2.0 if headers else None)
    assert exc.request_id == "shot-7"
    assert str(exc) == f"{status} No: because [GET /v1/assets/a]"


def test_page_of_a_proxy_is_quoted(shell: Callable[..., Shell]) -> None:
    script = Script(httpx.Response(502, content=b"<html>\xff bad gateway"))
    with pytest.raises(errors.ServerError, match=r"502 Error: <html>. bad gateway"):
        shell(script).devices()


@pytest.mark.parametrize("status", [302, 304])
def test_status_that_nobody_asked_for(shell: Callable[..., Shell], status: int) -> None:
    script = Script(httpx.Response(status, headers={"Location": "http://elsewhere.test/"}))
    with pytest.raises(errors.BadAnswer, match=f"status {status}"):
        shell(script).tile(*TILE)
    assert len(script.seen) == 1


@pytest.mark.parametrize("cause", [httpx.ConnectError, httpx.ReadTimeout, httpx.ReadError])
def test_no_answer_is_never_asked_again(
    shell: Callable[..., Shell], cause: type[httpx.TransportError]
) -> None:
    script = Script(cause("gone"))
    client = shell(script)
    for call in (client.devices, lambda: client.tiles("a", np.zeros((1, 3)), [(1001, 0, 0, 0)])):
        before = len(script.seen)
        with pytest.raises(errors.ConnectionFailed, match=f"{cause.__name__}: gone") as failed:
            call()
        assert isinstance(failed.value.__cause__, cause)
        assert len(script.seen) == before + 1


def npy_of(array: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


WHOLE = npy_of(np.zeros((2, 2), np.float32))
UNREADABLE = {
    "empty": b"",
    "magic": b"\x93NUMPX" + WHOLE[6:],
    "version": WHOLE[:6] + b"\x09" + WHOLE[7:],
    "cut": WHOLE[:-1],
    "more": WHOLE + b"\0",
    "header": WHOLE[:30],
    "negative": WHOLE.replace(b"(2, 2)", b"(-2,2)"),
    "pickle": npy_of(np.array([None])),
}


@pytest.mark.parametrize("name", UNREADABLE)
def test_npy_that_cannot_be_read(shell: Callable[..., Shell], name: str) -> None:
    script = Script(httpx.Response(200, content=UNREADABLE[name]))
    with pytest.raises(errors.BadAnswer, match=r"not a \.npy file"):
        shell(script).tile(*TILE)


@pytest.mark.parametrize("count", [1, 4, 17])
def test_half_that_is_no_square(shell: Callable[..., Shell], count: int) -> None:
    script = Script(httpx.Response(200, content=bytes(count)))
    with pytest.raises(errors.BadAnswer, match=f"{count} bytes are not a square"):
        shell(script).tile(*TILE, format="f16")


def test_scale_that_is_no_number(shell: Callable[..., Shell]) -> None:
    script = Script(httpx.Response(200, content=b"png", headers={"X-Rhytid-Scale": "wide"}))
    with pytest.raises(errors.BadAnswer, match="'wide'"):
        shell(script).tile(*TILE, format="png")


def zipped(**members: bytes) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for name, data in members.items():
            archive.writestr(name + ".npy", data)
    return file.getvalue()


@pytest.mark.parametrize(
    "body",
    [b"", b"PK", zipped(axes=WHOLE), zipped(axes=WHOLE, ratios=WHOLE[:20], folds=WHOLE), WHOLE],
    ids=["empty", "no zip", "missing", "cut", "npy"],
)
def test_npz_that_cannot_be_read(shell: Callable[..., Shell], body: bytes) -> None:
    with pytest.raises(errors.BadAnswer, match=r"not a \.npz file with axes, ratios"):
        shell(Script(httpx.Response(200, content=body))).stretch("a", "s")


@pytest.mark.parametrize("body", [b"", b"<html>", b"[" * 100_000, b"[]", b"null", b'{"id": "x"}'])
def test_json_that_is_no_asset(shell: Callable[..., Shell], body: bytes) -> None:
    with pytest.raises(errors.BadAnswer):
        shell(Script(httpx.Response(200, content=body))).asset("a")


def test_missing_key_is_named(shell: Callable[..., Shell]) -> None:
    with pytest.raises(errors.BadAnswer, match="Job: the answer has no 'state'"):
        shell(Script(httpx.Response(200, json={"id": "j"}))).job("j")


def test_object_in_place_of_a_list(shell: Callable[..., Shell]) -> None:
    with pytest.raises(errors.BadAnswer, match="not a list"):
        shell(Script(httpx.Response(200, json={}))).assets()


@pytest.mark.parametrize("kind", ["", "text/plain", "multipart/mixed", "image/png; boundary=b"])
def test_tiles_that_are_not_mixed(shell: Callable[..., Shell], kind: str) -> None:
    script = Script(httpx.Response(200, headers={"Content-Type": kind}, content=b"--b--\r\n"))
    with pytest.raises(errors.BadAnswer, match="expected multipart/mixed"):
        shell(script).tiles("a", np.zeros((1, 3)), [(1001, 0, 0, 0)])


def test_other_tiles_than_asked(shell: Callable[..., Shell]) -> None:
    body = b"--b\r\nX-Rhytid-Tile: 1001/0/0/1\r\n\r\n\r\n--b--\r\n"
    kind = {"Content-Type": "multipart/mixed; boundary=b"}
    script = Script(httpx.Response(200, headers=kind, content=body))
    with pytest.raises(errors.BadAnswer, match=r"1001/0/0/0.*1001/0/0/1"):
        shell(script).tiles("a", np.zeros((1, 3)), [(1001, 0, 0, 0)], format="png")


def test_server_without_a_device_is_not_ready(shell: Callable[..., Shell]) -> None:
    assert shell(Script(problem(503))).ready() is False


def test_image_has_no_array(shell: Callable[..., Shell]) -> None:
    tile = shell(Script(httpx.Response(200, content=b"v/1"))).tile(*TILE, format="exr16")
    with pytest.raises(ValueError, match="exr16 has no array"):
        _ = tile.array
