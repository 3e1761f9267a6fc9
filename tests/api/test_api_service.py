"""Health, figures, devices and the OpenAPI document."""

from __future__ import annotations

import logging
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import httpx
import pytest

from api.asking import is_problem
from api.fake_engine import FakeEngine
from api.live import serving
from rhytid import __version__
from rhytid.api.app import create_app
from rhytid.support.settings import ServiceSettings


def test_alive_and_ready(client: httpx.Client) -> None:
    assert client.get("/healthz").json() == {"status": "alive"}
    assert client.get("/readyz").json() == {"status": "ready"}


def test_a_device_that_does_not_compute_is_not_ready() -> None:
    engine = FakeEngine()
    engine.computes = False
    with serving(engine) as client:
        is_problem(client.get("/readyz"), 503, "no-device")
        assert client.get("/healthz").status_code == 200


def test_a_server_that_has_no_process_for_long_is_not_alive() -> None:
    engine = FakeEngine()
    engine.lives = False
    with serving(engine) as client:
        answer = client.get("/healthz")
        is_problem(answer, 503, "device-lost")
        assert int(answer.headers["Retry-After"]) > 0


def test_who_asks_whether_it_is_ready_while_another_does_gets_the_same_answer() -> None:
    class Slow(FakeEngine):
        def __init__(self) -> None:
            super().__init__()
            self.asked, self.go = threading.Semaphore(0), threading.Event()

        def ready(self) -> bool:
            self.asked.release()
            assert self.go.wait(60)
            return True

    engine, probes = Slow(), 50
    with serving(engine) as client, ThreadPoolExecutor(probes) as pool:
        url = str(client.base_url.join("/readyz"))
        asking = [pool.submit(httpx.get, url, timeout=60) for _ in range(probes)]
        try:
            assert engine.asked.acquire(timeout=60)
            # Threads that answer others are left, however many probes wait.
            assert client.get("/v1/assets", timeout=60).status_code == 200
            assert not engine.asked.acquire(blocking=False)
        finally:
            engine.go.set()
        assert {probe.result(60).status_code for probe in asking} == {200}
        assert client.get("/readyz").status_code == 200


def test_refusals_are_counted_by_kind() -> None:
    engine = FakeEngine()
    engine.computes = False
    with serving(engine) as client:
        client.get("/readyz")
        client.get("/v1/assets/a")
        found = figures(client)
    refused = {name: value for name, value in found.items() if "refused_total" in name}
    assert refused == {'rhytid_refused_total{problem="no-device"}': 1}


def test_devices_say_their_memory(client: httpx.Client) -> None:
    devices = client.get("/v1/devices").json()
    (selected,) = [d for d in devices if d["selected"]]
    assert 0 <= selected["used"] <= selected["budget"]
    assert selected["memory"] > 0


def figures(client: httpx.Client) -> dict[str, float]:
    response = client.get("/metrics")
    assert response.headers["content-type"].startswith("text/plain; version=0.0.4")
    lines = [line for line in response.text.splitlines() if not line.startswith("#")]
    return {name: float(value) for name, value in (line.rsplit(" ", 1) for line in lines)}


def test_metrics_count_by_route_and_status() -> None:
    with serving(FakeEngine()) as client:
        for path in ("/v1/assets/a", "/v1/assets/b", "/v1/assets", "/nowhere", "/elsewhere"):
            client.get(path)
        client.request("BREW", "/v1/assets")
        found = figures(client)
    requests = {k: v for k, v in found.items() if k.startswith("rhytid_requests_total")}
    assert requests == {
        'rhytid_requests_total{method="GET",route="/v1/assets/{asset}",status="404"}': 2,
        'rhytid_requests_total{method="GET",route="/v1/assets",status="200"}': 1,
        'rhytid_requests_total{method="GET",route="none",status="404"}': 2,
        'rhytid_requests_total{method="other",route="/v1/assets",status="405"}': 1,
    }
    assert found['rhytid_request_seconds_count{route="/v1/assets/{asset}"}'] == 2
    assert found["rhytid_device_queue"] == 3


def test_metrics_count_tiles_that_were_drawn(client: httpx.Client, frame: str) -> None:
    name = 'rhytid_tiles_total{method="redraw"}'
    before = figures(client).get(name, 0)
    tag = client.get(f"{frame}/tiles/1001/0/0/0").headers["etag"]
    client.get(f"{frame}/tiles/1001/0/0/0", headers={"If-None-Match": tag})
    client.get(f"{frame}/tiles/1001/99/0/0")
    assert figures(client)[name] == before + 1


def test_requests_are_logged_on_one_line(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, "rhytid.api.metrics")
    with serving(FakeEngine()) as client:
        client.get("/v1/assets/a%0Ab")
    lines = [r.getMessage() for r in caplog.records if r.name == "rhytid.api.metrics"]
    (line,) = [line for line in lines if "/v1/assets" in line]
    assert line.startswith("GET /v1/assets/a\\nb 404 ")


def test_probes_are_logged_where_they_are_refused_alone(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    caplog.set_level(logging.DEBUG, "rhytid.api.metrics")
    engine = FakeEngine()
    with serving(engine) as client:
        for path in ("/healthz", "/readyz", "/metrics"):
            assert client.get(path).status_code == 200
        monkeypatch.setattr(engine, "ready", lambda: False)
        assert client.get("/readyz").status_code == 503
    records = [r for r in caplog.records if r.name == "rhytid.api.metrics"]
    assert {(" ".join(r.getMessage().split()[:3]), r.levelname) for r in records} == {
        ("GET /healthz 200", "DEBUG"),
        ("GET /readyz 200", "DEBUG"),
        ("GET /metrics 200", "DEBUG"),
        ("GET /readyz 503", "INFO"),
    }


@pytest.fixture(scope="module")
def document() -> dict[str, Any]:
    engine: Any = FakeEngine()
    return create_app(engine, ServiceSettings()).openapi()


CALLS = {
    "/": {"get"},
    "/healthz": {"get"},
    "/readyz": {"get"},
    "/metrics": {"get"},
    "/v1/devices": {"get"},
    "/v1/assets": {"get", "post"},
    "/v1/assets/{asset}": {"get", "patch", "delete"},
    "/v1/assets/{asset}/graph": {"get"},
    "/v1/assets/{asset}/mesh": {"get"},
    "/v1/jobs/{job}": {"get", "delete"},
    "/v1/jobs/{job}/events": {"get"},
    "/v1/assets/{asset}/frames": {"get"},
    "/v1/assets/{asset}/frames/{frame}": {"get", "put", "delete"},
    "/v1/assets/{asset}/calibration": {"put"},
    "/v1/assets/{asset}/frames/{frame}/tiles/{udim}/{level}/{row}/{column}": {"get"},
    "/v1/assets/{asset}/frames/{frame}/maps/{udim}": {"get"},
    "/v1/assets/{asset}/frames/{frame}/stretch": {"get"},
    "/v1/assets/{asset}/bins": {"get"},
    "/v1/assets/{asset}/bins/{udim}/{level}/{row}/{column}": {"get"},
    "/v1/assets/{asset}/tiles": {"post"},
    "/v1/memory": {"get"},
    "/v1/assets/{asset}/snapshot": {"get"},
    "/v1/assets/{asset}/package": {"get"},
    "/v1/assets/{asset}/package/{path}": {"get"},
    "/v1/snapshots": {"post"},
}


def test_the_document_has_every_call(document: dict[str, Any]) -> None:
    assert {path: set(calls) for path, calls in document["paths"].items()} == CALLS
    assert document["info"]["version"] == __version__


def test_every_error_is_documented_as_a_problem(document: dict[str, Any]) -> None:
    calls = [call for path in document["paths"].values() for call in path.values()]
    wanted = {"application/problem+json": {"schema": {"$ref": "#/components/schemas/Problem"}}}
    for call in calls:
        assert call["tags"]
        assert call["summary"]
        failures = {s: r for s, r in call["responses"].items() if int(s) >= 400}
        assert "500" in failures
        assert all(response["content"] == wanted for response in failures.values())
    assert "HTTPValidationError" not in str(document)
    assert document["components"]["schemas"]["Problem"]["required"]


def test_query_parameters_are_documented(document: dict[str, Any]) -> None:
    call = document["paths"]["/v1/assets/{asset}/frames/{frame}/maps/{udim}"]["get"]
    query = {p["name"]: p["schema"] for p in call["parameters"] if p["in"] == "query"}
    assert query.keys() == {"method", "stretch", "sampling", "layer", "format", "level"}
    assert "redraw" in query["method"]["enum"]
    assert call["responses"]["200"]["content"].keys() >= {"application/x-npy", "image/png"}


@pytest.mark.slow
def test_importing_the_transport_loads_no_opencl() -> None:
    code = "import sys, rhytid.api.app; sys.exit('pyopencl' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
