"""Spans of requests and of their stages."""

from __future__ import annotations

import logging
import sys
from typing import Any

import pytest
from opentelemetry import trace
from opentelemetry.sdk.trace import ReadableSpan, TracerProvider
from opentelemetry.sdk.trace.export import SimpleSpanProcessor
from opentelemetry.sdk.trace.export.in_memory_span_exporter import InMemorySpanExporter
from opentelemetry.trace import SpanKind, StatusCode

from api.asking import NPY, built, npy
from api.fake_engine import FakeEngine
from api.live import serving
from api.patch import smile, upload
from rhytid.api import tracing
from rhytid.device.figures import Span, keep_spans

PARENT = "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01"


@pytest.fixture
def spans(monkeypatch: pytest.MonkeyPatch) -> InMemorySpanExporter:
    exporter, provider = InMemorySpanExporter(), TracerProvider()
    provider.add_span_processor(SimpleSpanProcessor(exporter))
    # Of the process, as `send_spans` sets it: whatever else makes spans finds it, too.
    monkeypatch.setattr(trace, "_TRACER_PROVIDER", provider)
    return exporter


def test_each_request_is_one_span_and_its_stages(spans: InMemorySpanExporter) -> None:
    with serving(FakeEngine()) as client:
        frame = f"/v1/assets/{built(client, upload())}/frames/smile"
        client.put(frame, content=npy(smile()), headers=NPY).raise_for_status()
        for path in (f"{frame}/tiles/1001/0/0/0", "/v1/assets", "/nowhere"):
            client.get(path)
        sent = client.get("/metrics").text
    asked = sum(
        float(line.rpartition(" ")[2])
        for line in sent.splitlines()
        if line.startswith("rhytid_requests_total{")
    )
    found = spans.get_finished_spans()
    requests = {s.context.span_id: s for s in found if s.kind is SpanKind.SERVER and s.context}
    assert len(requests) == asked + 1  # that of the metrics had not ended
    assert all(request.parent is None for request in requests.values())
    stages = [s for s in found if s.kind is not SpanKind.SERVER]
    assert {"upload", "decode", "encode"} <= {stage.name for stage in stages}
    assert all(stage.parent and stage.parent.span_id in requests for stage in stages)


@pytest.mark.parametrize("each", [False, True])
def test_single_kernels_have_spans_where_they_are_asked_for(
    spans: InMemorySpanExporter, each: bool
) -> None:
    engine: Any = FakeEngine()
    drawn = engine.assets.all

    def pieces() -> Any:
        for wait in (1, 2, 3):
            keep_spans([Span("queue", 10 * wait, 2), Span("kernel", 10 * wait + 2, 5)])
        return drawn()

    engine.assets.all = pieces
    with serving(engine, trace_kernels=each) as client:
        client.get("/v1/assets").raise_for_status()
    *stages, _ = spans.get_finished_spans()
    found = [(s.name, s.start_time, s.end_time) for s in stages]
    if each:
        singly = [(("queue", n, n + 2), ("kernel", n + 2, n + 7)) for n in (10, 20, 30)]
        assert found == [span for pair in singly for span in pair]
    else:
        assert found == [("queue", 10, 32), ("kernel", 12, 37)]
        about = {"rhytid.times": 3, "rhytid.nanoseconds": 15}
        assert dict(stages[1].attributes or {}) == about


def test_a_request_is_part_of_its_clients_trace(spans: InMemorySpanExporter) -> None:
    with serving(FakeEngine()) as client:
        frame = f"/v1/assets/{built(client, upload())}/frames/smile"
        client.put(frame, content=npy(smile()), headers=NPY).raise_for_status()
        about = {"traceparent": PARENT, "X-Request-Id": "mine"}
        client.get(f"{frame}/tiles/1001/0/0/0", headers=about).raise_for_status()
    # A span ends after the client has its answer, when the next request may have begun.
    id = int(PARENT.split("-")[1], 16)
    found = spans.get_finished_spans()
    encode, request = (s for s in found if s.context and s.context.trace_id == id)
    assert request.parent is not None
    assert f"{request.parent.trace_id:032x}-{request.parent.span_id:016x}" == PARENT[3:-3]
    route = "/v1/assets/{asset}/frames/{frame}/tiles/{udim}/{level}/{row}/{column}"
    assert request.name == f"GET {route}"
    assert dict(request.attributes or {}) == {
        "http.request.method": "GET", "http.route": route, "http.response.status_code": 200,
        "rhytid.request_id": "mine",
    }  # fmt: skip
    assert encode.name == "encode"
    assert within(encode, request)


def within(stage: ReadableSpan, request: ReadableSpan) -> bool:
    assert stage.parent is not None
    assert request.context is not None
    assert stage.parent.span_id == request.context.span_id
    times = [request.start_time, stage.start_time, stage.end_time, request.end_time]
    return times == sorted(t for t in times if t is not None)


def test_a_failure_is_one(spans: InMemorySpanExporter, monkeypatch: pytest.MonkeyPatch) -> None:
    engine = FakeEngine()
    monkeypatch.setattr(engine.assets, "all", lambda: 1 / 0)
    with serving(engine) as client:
        assert client.get("/v1/assets").status_code == 500
        assert client.get("/v1/assets/none").status_code == 404
    failed, refused = spans.get_finished_spans()
    assert (failed.status.status_code, refused.status.status_code) == (
        StatusCode.ERROR,
        StatusCode.UNSET,
    )


def test_no_spans_are_made_where_nobody_takes_them() -> None:
    assert tracing.tracer() is None


def test_without_the_extra_a_warning_says_so(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setitem(sys.modules, "opentelemetry.sdk.trace", None)
    with caplog.at_level(logging.WARNING):
        tracing.send_spans()
    assert "extra otel is not installed" in caplog.text
    assert tracing.tracer() is None


def test_without_the_interface_there_are_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "opentelemetry", None)
    assert tracing.tracer() is None
