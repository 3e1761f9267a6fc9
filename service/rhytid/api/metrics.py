"""Prometheus metrics of one app and its devices, and the middleware that counts and logs
requests."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator, Mapping, Sized
from contextlib import nullcontext
from typing import TYPE_CHECKING, Any

from prometheus_client import (
    CollectorRegistry,
    Counter,
    Gauge,
    Histogram,
    ProcessCollector,
    generate_latest,
)
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from rhytid import __version__
from rhytid.api.access import CALLER
from rhytid.api.draining import Drain
from rhytid.api.tracing import traced
from rhytid.device.figures import Figures
from rhytid.engine.byte_budget import ByteBudget
from rhytid.support import build_identity

if TYPE_CHECKING:
    from opentelemetry.trace import Tracer

    from rhytid.engine.operations import Engine

from itertools import product

from prometheus_client.core import (
    HistogramMetricFamily,
)

from rhytid.device.figures import (
    BOUNDS,
    DROPPED,
    JOB_ENDS,
    JOB_KINDS,
    JOB_STATES,
    STAGES,
    WORK,
)

logger = logging.getLogger(__name__)
# The purposes for which bytes of each budget are held.
PURPOSES = {
    "host": ("answers", "uploads", "jobs"),
    "small": ("answers", "uploads", "encoded"),
    "spool": ("uploads", "answers"),
}
# Causes of a restart of the device's process: a fault of its own, a call of the driver that takes
# too long, a kill from outside, or a failed start.
CAUSES = ("fault", "late", "killed", "start")
# Routes that watchers ask many times a minute; only their refusals are logged.
PROBES = frozenset({"/healthz", "/readyz", "/metrics"})
_REFUSED = 400
METHODS = frozenset({"GET", "HEAD", "PUT", "POST", "PATCH", "DELETE", "OPTIONS"})
# In place of the number of a device: the server itself.
SERVER = "server"


class Metrics:
    """The metrics of one app, in a registry of its own.

    engine: has the number of waiting requests, the restarts, and the figures of its devices.
    budgets: budgets of bytes by name.  drain: has the number of running requests.  live: its
    length is the number of open live connections.  figures: the stages that the server itself goes
    through.
    """

    def __init__(
        self,
        engine: Engine,
        budgets: Mapping[str, Callable[[], ByteBudget]],
        drain: Drain,
        live: Sized,
    ) -> None:
        self.registry = CollectorRegistry()
        self.figures = Figures()
        self.requests = Counter(
            "rhytid_requests",
            "HTTP requests by method, route and status",
            ("method", "route", "status"),
            registry=self.registry,
        )
        self.refused = Counter(
            "rhytid_refused",
            "Requests answered with 429, 503 or 507, by the kind of problem",
            ("problem",),
            registry=self.registry,
        )
        self.seconds = Histogram(
            "rhytid_request_seconds",
            "Time to the end of the response, by route",
            ("route",),
            registry=self.registry,
        )
        self.tiles = Counter(
            "rhytid_tiles",
            "Displacement tiles and maps computed, by method",
            ("method",),
            registry=self.registry,
        )
        self._gauge("device_queue", "Waiting device requests", lambda: engine.waiting)
        self._gauge("requests_running", "Requests that are answered now", lambda: drain.running)
        self.live_dropped = Counter(
            "rhytid_live_frames_dropped",
            "Frames of live connections that newer ones replaced",
            registry=self.registry,
        )
        self._gauge("live_connections", "Live connections that are open", lambda: len(live))
        self._gauge("draining", "1 while the server shuts down", lambda: drain.begun)
        labels = ("version", "drawing", "revision")
        about = Gauge("rhytid_build_info", "1", labels, registry=self.registry)
        drawing, revision = build_identity.drawing_version(), build_identity.revision()
        about.labels(__version__, drawing, revision).set(1)
        self._engine, self._budgets = engine, budgets
        self.registry.register(self)
        self.registry.register(FigureMetrics(lambda: engine.figures, self.figures))
        ProcessCollector(registry=self.registry)

    def _gauge(self, name: str, about: str, find: Callable[[], float]) -> None:
        Gauge(f"rhytid_{name}", about, registry=self.registry).set_function(find)

    def bytes_held(self) -> dict[str, dict[str, object]]:
        """Return the bytes that are held of each budget, by its name."""
        return {
            name: {
                "limit": budget.limit,
                "used": budget.used,
                "waiting": budget.waiting,
                "purposes": {purpose: budget.used_for(purpose) for purpose in PURPOSES[name]},
            }
            for name, budget in ((name, find()) for name, find in self._budgets.items())
        }

    def collect(self) -> Iterator[Metric]:
        """Yield restarts and held bytes, when Prometheus asks."""
        restarts = CounterMetricFamily(
            "rhytid_device_restarts",
            "Starts of the device's process after the first, by what had ended it",
            labels=("cause",),
        )
        for cause in CAUSES:
            restarts.add_metric((cause,), self._engine.restarts.get(cause, 0))
        yield restarts
        used = GaugeMetricFamily("rhytid_bytes", "Bytes held", labels=("budget", "purpose"))
        limit = GaugeMetricFamily("rhytid_bytes_limit", "Most bytes held", labels=("budget",))
        waiting = GaugeMetricFamily(
            "rhytid_bytes_waiting", "Requests that wait for bytes", labels=("budget",)
        )
        for name, find in self._budgets.items():
            budget = find()
            for purpose in PURPOSES[name]:
                used.add_metric((name, purpose), budget.used_for(purpose))
            limit.add_metric((name,), budget.limit)
            waiting.add_metric((name,), budget.waiting)
        yield from (used, limit, waiting)

    def describe(self) -> list[Metric]:
        """Describe nothing: the budgets are read by `collect`."""
        return []

    def tiles_of(self, method: str) -> Counter:
        """The counter of the tiles and maps of a method."""
        return self.tiles.labels(method)

    def text(self) -> bytes:
        """The metrics in the text format of Prometheus."""
        return generate_latest(self.registry)


class Observe:
    """ASGI middleware: counts, times and logs each request, and makes its span where there is a
    tracer. Of a WebSocket it logs the handshake.

    trace_kernels: see `each` of `traced`.
    """

    def __init__(
        self,
        app: ASGIApp,
        metrics: Metrics,
        tracer: Tracer | None = None,
        *,
        trace_kernels: bool = False,
    ) -> None:
        self.app = app
        self.metrics, self._tracer, self._each = metrics, tracer, trace_kernels

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on and note its status, 500 where it raised."""
        if scope["type"] == "websocket":
            await self.app(scope, receive, _logging_handshake(scope, send))
            return
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        status = 500
        start = time.perf_counter()

        async def noting(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
            await send(message)

        tracer = self._tracer
        with nullcontext() if tracer is None else traced(tracer, scope, each=self._each) as span:
            try:
                await self.app(scope, receive, noting)
            finally:
                self._note(scope, status, time.perf_counter() - start, span)

    def _note(self, scope: Scope, status: int, seconds: float, span: Any) -> None:
        # Labels come from the program, never from the client: their number stays bounded.
        method = scope["method"] if scope["method"] in METHODS else "other"
        route = getattr(scope.get("route"), "path", "none")
        self.metrics.requests.labels(method, route, status).inc()
        self.metrics.seconds.labels(route).observe(seconds)
        path = _printable(scope["path"])
        who = caller.name if (caller := scope.get(CALLER)) else ""
        fields = {"method": method, "path": path, "route": route, "status": status}
        fields |= {"milliseconds": round(1000 * seconds, 3), "caller": who}
        text = f"%s %s %d %.1f ms{' %s' if who else '%s'}"
        extra = {"fields": fields}
        level = logging.DEBUG if route in PROBES and status < _REFUSED else logging.INFO
        logger.log(level, text, method, path, status, 1000 * seconds, who, extra=extra)
        if span is not None:
            span(status, route)


def _printable(path: str) -> str:
    return path.encode("unicode_escape").decode("ascii")


def _logging_handshake(scope: Scope, send: Send) -> Send:
    """Log the answer to the handshake of a WebSocket, without its query, which may hold a key."""
    answers = {"websocket.accept": 101, "websocket.close": 403}
    told = False

    async def noting(message: Message) -> None:
        nonlocal told
        status = message.get("status", answers.get(message["type"]))
        if not told and status is not None:
            told = True
            path = _printable(scope["path"])
            fields = {"method": "WebSocket", "path": path, "status": status}
            logger.info("WebSocket %s %d", path, status, extra={"fields": fields})
        await send(message)

    return noting


class FigureMetrics:
    """Collects the figures of stages, device memory and jobs.

    devices: the figures of each device by its number.  server: those of the server itself.
    """

    def __init__(self, devices: Callable[[], Mapping[str, Figures]], server: Figures) -> None:
        self._devices, self._server = devices, server

    def describe(self) -> list[Metric]:
        """Describe the metrics without numbers: there may be no device yet."""
        return [*_stages({}), *_memory({}), *_jobs({})]

    def collect(self) -> Iterator[Metric]:
        """Yield the present numbers."""
        devices = dict(self._devices())
        yield from _stages({SERVER: self._server, **devices})
        yield from _memory(devices)
        yield from _jobs(devices)


def _stages(figures: Mapping[str, Figures]) -> Iterator[Metric]:
    """Histograms of the stages that have happened: most stages never meet most kinds of work."""
    family = HistogramMetricFamily(
        "rhytid_stage_seconds",
        "Time of the stages of requests and jobs",
        labels=("stage", "method", "device"),
    )
    bounds = [*map(str, BOUNDS), "+Inf"]
    for device, found in figures.items():
        for stage, work in product(STAGES, WORK):
            counts, seconds = found.histogram(stage, work)
            if counts[-1]:
                buckets = list(zip(bounds, counts, strict=True))
                family.add_metric((stage, work, device), buckets, seconds)
    yield family


def _memory(figures: Mapping[str, Figures]) -> Iterator[Metric]:
    gauges = {
        "used": ("rhytid_device_bytes", "Bytes in use on the device"),
        "spare": ("rhytid_device_spare_bytes", "Bytes on the device kept for the next buffers"),
        "limit": ("rhytid_device_bytes_limit", "Most bytes in use and spare on the device"),
    }
    for name, (metric, text) in gauges.items():
        gauge = GaugeMetricFamily(metric, text, labels=("device",))
        for device, found in figures.items():
            gauge.add_metric((device,), found.value(name))
        yield gauge
    dropped = CounterMetricFamily(
        "rhytid_device_evictions",
        "What was dropped from the device because memory was short",
        labels=("what", "device"),
    )
    for (device, found), what in product(figures.items(), DROPPED):
        dropped.add_metric((what, device), found.value("dropped", what))
    yield dropped


def _jobs(figures: Mapping[str, Figures]) -> Iterator[Metric]:
    there = GaugeMetricFamily(
        "rhytid_jobs", "Jobs that wait or run", labels=("kind", "state", "device")
    )
    ended = CounterMetricFamily(
        "rhytid_jobs_ended", "Jobs that have ended", labels=("kind", "state", "device")
    )
    for (device, found), kind in product(figures.items(), JOB_KINDS):
        for state in JOB_STATES:
            there.add_metric((kind, state, device), found.value("jobs", kind, state))
        for state in JOB_ENDS:
            ended.add_metric((kind, state, device), found.value("ended", kind, state))
    yield from (there, ended)
