"""What devices and the server have done, as Prometheus asks for it: stages, memory, jobs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from itertools import product

from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    HistogramMetricFamily,
    Metric,
)

from rhytid.device.figures import (
    BOUNDS,
    DROPPED,
    JOB_ENDS,
    JOB_KINDS,
    JOB_STATES,
    STAGES,
    WORK,
    Figures,
)

# In place of the number of a device: the server itself.
SERVER = "server"


class FigureMetrics:
    """A collector.  devices: the figures of each device by its number.  server: of the server."""

    def __init__(self, devices: Callable[[], Mapping[str, Figures]], server: Figures) -> None:
        self._devices, self._server = devices, server

    def describe(self) -> list[Metric]:
        """The names and no numbers: there may be no device yet."""
        return [*_stages({}), *_memory({}), *_jobs({})]

    def collect(self) -> Iterator[Metric]:
        """The numbers now."""
        devices = dict(self._devices())
        yield from _stages({SERVER: self._server, **devices})
        yield from _memory(devices)
        yield from _jobs(devices)


def _stages(figures: Mapping[str, Figures]) -> Iterator[Metric]:
    """Histograms, of what has happened alone: most stages never meet most kinds of work."""
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
