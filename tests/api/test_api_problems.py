"""Every error is a problem, the framework's own too, and the server goes on."""

from __future__ import annotations

import inspect
import json
import logging
import socket
from collections.abc import Iterator
from typing import Any

import httpx
import pytest

from api.asking import NPY, is_problem, npy
from api.fake_engine import FakeEngine
from api.live import serving
from api.patch import smile, upload
from rhytid import errors
from rhytid.api.problems import KINDS, LONGEST_DETAIL, kind_of, problem

TREE = [e for _, e in inspect.getmembers(errors, inspect.isclass)]
STATUSES = {
    "MeshError": 422,
    "QueryError": 422,
    "NotFoundError": 404,
    "NotReadyError": 409,
    "ReadOnlyError": 409,
    "LimitError": 413,
    "BusyError": 503,
    "DeviceMemoryError": 507,
    "KernelBuildError": 500,
    "StorageError": 500,
}


def test_every_deliberate_error_has_a_status_and_no_two_kinds_share_a_name() -> None:
    found = {error.__name__: kind_of(error("x")).status for error in TREE}
    assert STATUSES.items() <= found.items()
    assert len({kind.type for kind in KINDS.values()}) == len(KINDS)


def test_a_long_detail_is_cut() -> None:
    body = json.loads(bytes(problem(422, "x" * 10_000).body))
    assert len(body["detail"]) == LONGEST_DETAIL


def test_unknown_paths_are_404(client: httpx.Client) -> None:
    assert "/v2/assets" in is_problem(client.get("/v2/assets"), 404)
    assert "/v1/assets/" in is_problem(client.get("/v1/assets/"), 404)


@pytest.mark.parametrize(
    ("method", "path", "allowed"),
    [
        ("PUT", "/v1/assets", "GET, POST"),
        ("POST", "/v1/assets/a", "DELETE, GET, PATCH"),
        ("POST", "/v1/assets/a/frames/b", "DELETE, GET, PUT"),
        ("POST", "/v1/assets/a/frames/b/tiles/1001/0/0/0", "GET, HEAD"),
        ("GET", "/v1/assets/a/calibration", "PUT"),
        ("GET", "/v1/assets/a/tiles", "POST"),
        ("DELETE", "/healthz", "GET"),
    ],
)
def test_a_wrong_method_is_405_and_names_the_right_ones(
    client: httpx.Client, method: str, path: str, allowed: str
) -> None:
    response = client.request(method, path)
    assert allowed in is_problem(response, 405)
    assert response.headers["allow"] == allowed


@pytest.mark.parametrize(
    "path", ["/v1/assets", "/v1/devices", "/v1/assets/a", "/v1/assets/a/bins", "/v1/jobs/j"]
)
def test_unknown_query_parameters_are_refused_everywhere(client: httpx.Client, path: str) -> None:
    assert "'colour'" in is_problem(client.get(path, params={"colour": 1}), 422, "query")


class FailingEngine(FakeEngine):
    """Raises what it is told to, from every list of assets."""

    error: Exception

    def assets(self) -> Any:
        raise self.error


@pytest.fixture(scope="module")
def failing() -> Iterator[tuple[FailingEngine, httpx.Client]]:
    engine = FailingEngine()
    with serving(engine) as client:
        yield engine, client


def test_an_unexpected_error_tells_the_log_not_the_client(
    failing: tuple[FailingEngine, httpx.Client], caplog: pytest.LogCaptureFixture
) -> None:
    engine, client = failing
    engine.error = ZeroDivisionError("secret")
    response = client.get("/v1/assets")
    is_problem(response, 500)
    assert "secret" not in response.text
    assert "GET '/v1/assets' failed: ZeroDivisionError" in caplog.messages
    assert client.get("/healthz").status_code == 200


@pytest.mark.parametrize("error", [errors.StorageError, errors.KernelBuildError])
def test_a_failure_of_the_server_is_logged_with_its_reason(
    failing: tuple[FailingEngine, httpx.Client],
    caplog: pytest.LogCaptureFixture,
    error: type[errors.RhytidError],
) -> None:
    engine, client = failing
    engine.error = error("secret")
    response = client.get("/v1/assets")
    is_problem(response, 500, kind_of(engine.error).name)
    assert "secret" not in response.text
    assert "secret" in caplog.text
    assert [r.levelno for r in caplog.records if r.name == "rhytid.api.problems"] == [logging.ERROR]


def test_a_busy_device_is_503_and_says_when_to_ask_again(
    failing: tuple[FailingEngine, httpx.Client],
) -> None:
    engine, client = failing
    engine.error = errors.BusyError("256 requests wait: at most 256")
    response = client.get("/v1/assets")
    assert "256" in is_problem(response, 503, "busy")
    assert response.headers["retry-after"] == "1"


LIMIT = 1 << 20


@pytest.mark.parametrize("chunked", [False, True])
def test_a_body_above_the_limit_is_413(client: httpx.Client, asset: str, chunked: bool) -> None:
    piece = bytes(1 << 16)
    body = iter([piece] * 17) if chunked else piece * 17
    response = client.put(f"/v1/assets/{asset}/frames/big", content=body, headers=NPY)
    assert str(LIMIT) in is_problem(response, 413, "limit")


def test_an_upload_above_the_limit_is_413(client: httpx.Client) -> None:
    response = client.post("/v1/assets", files=upload(bytes(LIMIT)))
    detail = is_problem(response, 413, "limit")
    assert f"at most {LIMIT}" in detail
    assert response.request.headers["content-length"] in detail


def test_a_declared_length_is_refused_before_any_of_it_is_read(client: httpx.Client) -> None:
    head = f"PUT /v1/assets/a/frames/b HTTP/1.1\r\nHost: h\r\nContent-Length: {10**12}\r\n\r\n"
    address = (client.base_url.host, client.base_url.port or 0)
    with socket.create_connection(address, timeout=30) as raw:
        raw.sendall(head.encode())
        assert raw.recv(4096).startswith(b"HTTP/1.1 413 ")


def test_a_client_that_leaves_in_the_middle_is_no_error(caplog: pytest.LogCaptureFixture) -> None:
    with serving(FakeEngine()) as client:
        asset = client.post("/v1/assets", files=upload()).json()["id"]
        path = f"/v1/assets/{asset}/frames/cut"
        head = f"PUT {path} HTTP/1.1\r\nHost: h\r\nContent-Length: 1000\r\n\r\n"
        address = (client.base_url.host, client.base_url.port or 0)
        with socket.create_connection(address, timeout=30) as raw:
            raw.sendall(head.encode() + npy(smile())[:100])
        is_problem(client.get(path), 404, "not-found")
    ours = [r for r in caplog.records if r.name.startswith(("rhytid", "uvicorn"))]
    assert not [r for r in ours if r.levelno >= logging.WARNING]
