"""Every error is a problem, the framework's own too, and the server goes on."""

from __future__ import annotations

import inspect
import json
import logging
import socket
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import httpx
import pytest

from api.asking import NPY, is_problem
from api.fake_assets import FakeAssets
from api.fake_engine import FakeEngine
from api.live import serving
from api.patch import smile, upload
from rhytid import errors
from rhytid.api.problems import KINDS, LONGEST_DETAIL, kind_of, problem

TREE = [e for _, e in inspect.getmembers(errors, inspect.isclass)]
STATUSES = {
    "MeshError": 422,
    "QueryError": 422,
    "ApiKeyError": 401,
    "ScopeError": 403,
    "QuotaError": 429,
    "NotFoundError": 404,
    "NotReadyError": 409,
    "ChangingError": 409,
    "ReadOnlyError": 409,
    "LimitError": 413,
    "FrameMemoryError": 507,
    "BusyError": 503,
    "DeviceMemoryError": 507,
    "KernelBuildError": 500,
    "StorageError": 500,
}


def test_every_deliberate_error_has_a_status_and_no_two_kinds_share_a_name() -> None:
    found = {error.__name__: kind_of(error("x")).status for error in TREE}
    assert STATUSES.items() <= found.items()
    assert len({kind.type for kind in KINDS.values()}) == len(KINDS)


def test_what_is_kept_to_the_log_is_what_500_is_answered_for() -> None:
    secret = {e for e in TREE if errors.public_message(e("/srv/secret")) != "/srv/secret"}
    # These have a reason that callers may know, in words of their own.
    told = {errors.DiskFullError, errors.StoreFormatError, errors.TooManyFilesError}
    told |= {errors.SharedStoreError, errors.SharedDamageError}
    failed = {e for e in TREE if kind_of(e("x")).status == 500}
    assert secret | {errors.RhytidError} == failed | told
    assert not failed & told


@pytest.mark.parametrize(
    "kind",
    [
        errors.DiskFullError,
        errors.StoreFormatError,
        errors.SharedStoreError,
        errors.SharedDamageError,
    ],
)
def test_reasons_in_other_words_name_no_path(
    kind: type[errors.StorageError], caplog: pytest.LogCaptureFixture
) -> None:
    engine = FakeEngine()

    def fails(asset: str) -> None:
        raise kind("/srv/secret")

    engine.snapshots.of = fails  # type: ignore[method-assign]
    with serving(engine) as client:
        answer = client.get("/v1/assets/a/snapshot")
    assert "secret" not in answer.text
    assert answer.json()["detail"] == kind.public
    assert "/srv/secret" in caplog.text


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

    def __init__(self) -> None:
        super().__init__()
        self.assets = FailingAssets(self.state, self)


@dataclass
class FailingAssets(FakeAssets):
    """Raises the error of its engine from every list."""

    engine: FailingEngine

    def all(self) -> Any:
        raise self.engine.error


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
@pytest.mark.parametrize(
    ("method", "call"), [("PUT", "frames/big"), ("PUT", "calibration"), ("POST", "tiles?tile=a")]
)
def test_a_body_above_what_a_frame_takes_is_413(
    client: httpx.Client, asset: str, method: str, call: str, chunked: bool
) -> None:
    largest = 24 * len(smile()) + (1 << 16)
    pieces = [bytes(largest), b"x"]
    body = iter(pieces) if chunked else b"".join(pieces)
    response = client.request(method, f"/v1/assets/{asset}/{call}", content=body, headers=NPY)
    assert f"at most {largest}" in is_problem(response, 413, "limit")


def test_no_frame_is_above_the_limit_of_all_uploads() -> None:
    with serving(FakeEngine(), upload_limit=10_000) as client:
        asset = client.post("/v1/assets", files=upload()).raise_for_status().json()["id"]
        path = f"/v1/assets/{asset}/frames/big"
        response = client.put(path, content=bytes(10_001), headers=NPY)
        assert "at most 10000" in is_problem(response, 413, "limit")


def test_an_upload_above_the_limit_is_413(client: httpx.Client) -> None:
    response = client.post("/v1/assets", files=upload(bytes(LIMIT)))
    detail = is_problem(response, 413, "limit")
    assert f"at most {LIMIT}" in detail
    assert response.request.headers["content-length"] in detail


def begun(client: httpx.Client, call: str, length: int, *headers: str) -> socket.socket:
    """A connection on which only the head of a request was sent."""
    address = (client.base_url.host, client.base_url.port or 0)
    lines = [f"{call} HTTP/1.1", f"Host: {address[0]}", f"Content-Length: {length}", *headers]
    lines += ["", ""]
    raw = socket.create_connection(address, timeout=30)
    raw.sendall("\r\n".join(lines).encode())
    return raw


@pytest.mark.parametrize(("known", "status"), [(True, 413), (False, 404)])
def test_a_length_or_an_asset_is_refused_before_any_of_the_body_is_read(
    client: httpx.Client, asset: str, known: bool, status: int
) -> None:
    name, length = (asset, 10**12) if known else ("nobody", 1000)
    call, of_type = f"PUT /v1/assets/{name}/frames/b", f"Content-Type: {NPY['Content-Type']}"
    with begun(client, call, length, of_type) as raw:
        assert raw.recv(4096).startswith(f"HTTP/1.1 {status} ".encode())


UPLOADS = [
    ("PUT /v1/assets/{}/frames/cut", NPY["Content-Type"]),
    ("POST /v1/assets/{}/tiles?tile=1001/0/0/0", NPY["Content-Type"]),
    ("POST /v1/assets", "multipart/form-data; boundary=xyz"),
    ("PATCH /v1/assets/{}", "application/json"),
]


@pytest.mark.parametrize(("call", "media_type"), UPLOADS)
def test_a_client_that_leaves_in_the_middle_is_no_error(
    call: str, media_type: str, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, "rhytid.api.metrics")
    with serving(FakeEngine()) as client:
        asset = client.post("/v1/assets", files=upload()).json()["id"]
        with begun(client, call.format(asset), 1000, f"Content-Type: {media_type}") as raw:
            raw.sendall(b"--xyz\r\n")
        # The server hears of it when the client is gone.
        end = time.monotonic() + 10
        while not any(" 400 " in message for message in caplog.messages):
            assert time.monotonic() < end, caplog.messages
            time.sleep(0.01)
    ours = [r for r in caplog.records if r.name.startswith(("rhytid", "uvicorn"))]
    assert not [r for r in ours if r.levelno >= logging.WARNING]
