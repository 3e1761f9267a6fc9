"""Spans of requests and of their stages, by OpenTelemetry; none where it is not installed, or has
no place to send them to."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from starlette.types import Scope

from rhytid import __version__
from rhytid.device.figures import Span, spans_of_request
from rhytid.support.logs import request_id

if TYPE_CHECKING:
    from opentelemetry.trace import Tracer

_log = logging.getLogger(__name__)
_FAILED = 500


def send_spans() -> None:
    """Send spans to the place that OpenTelemetry's variables name; log a warning where the extra
    `otel` is not installed."""
    try:
        from opentelemetry import trace
        from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter
        from opentelemetry.sdk.resources import SERVICE_NAME, Resource
        from opentelemetry.sdk.trace import TracerProvider
        from opentelemetry.sdk.trace.export import BatchSpanProcessor
    except ImportError as error:
        _log.warning("spans are asked for, but the extra otel is not installed: %s", error)
        return
    about = Resource.create().merge(Resource({"service.version": __version__}))
    if str(about.attributes.get(SERVICE_NAME, "")).startswith("unknown_service"):
        about = about.merge(Resource({SERVICE_NAME: "rhytid"}))
    provider = TracerProvider(resource=about)
    provider.add_span_processor(BatchSpanProcessor(OTLPSpanExporter()))
    trace.set_tracer_provider(provider)


def tracer() -> Tracer | None:
    """The maker of spans; None where no spans would be kept."""
    try:
        from opentelemetry import trace
    except ImportError:
        return None
    # Of the interface alone: no spans go anywhere, and each would cost.
    if isinstance(
        trace.get_tracer_provider(), trace.ProxyTracerProvider | trace.NoOpTracerProvider
    ):
        return None
    return trace.get_tracer("rhytid", __version__)


@contextmanager
def traced(tracer: Tracer, scope: Scope, *, each: bool) -> Iterator[Any]:
    """Make a span around a request, as part of its client's trace, with spans of its stages in it.
    The block calls the yielded function with the status and the route at its end.

    each: True = a span each time that the request goes through a stage, such as a kernel; False =
    one span for all times of a stage, from the first to the last.
    """
    from opentelemetry import trace
    from opentelemetry.propagate import extract

    headers = {name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]}
    with (
        tracer.start_as_current_span(
            scope["method"], extract(headers), trace.SpanKind.SERVER, record_exception=False
        ) as span,
        spans_of_request() as stages,
    ):

        def end(status: int, route: str) -> None:
            span.update_name(f"{scope['method']} {route}")
            span.set_attribute("http.request.method", scope["method"])
            span.set_attribute("http.route", route)
            span.set_attribute("http.response.status_code", status)
            span.set_attribute("rhytid.request_id", request_id.get())
            if status >= _FAILED:
                span.set_status(trace.StatusCode.ERROR)
            for times in [[stage] for stage in stages] if each else _by_stage(stages):
                _note(tracer, times)

        yield end


def _by_stage(stages: Iterable[Span]) -> list[list[Span]]:
    found: dict[str, list[Span]] = {}
    for stage in stages:
        found.setdefault(stage.stage, []).append(stage)
    return list(found.values())


def _note(tracer: Tracer, times: list[Span]) -> None:
    """Make one span for the times that a request went through a stage."""
    name, busy = times[0].stage, sum(one.nanoseconds for one in times)
    about = {"rhytid.times": len(times), "rhytid.nanoseconds": busy}
    span = tracer.start_span(name, attributes=about, start_time=min(one.start for one in times))
    span.end(max(one.start + one.nanoseconds for one in times))
