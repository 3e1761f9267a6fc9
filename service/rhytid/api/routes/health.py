"""Liveness, readiness, metrics, devices and memory."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

import anyio.to_thread
from anyio import CapacityLimiter
from fastapi import APIRouter, Request, Response

from rhytid.api.dependencies import EngineDep, MetricsDep, NoQuery
from rhytid.api.documentation import binary, problems
from rhytid.api.schemas import Device, HostMemory, Status
from rhytid.errors import DeviceLostError, NoDeviceError

PROMETHEUS = "text/plain; version=0.0.4; charset=utf-8"
router = APIRouter(tags=["service"])


class Readiness:
    """Asks whether the device computes, once at a time and on a thread of its own, so that requests
    that wait for the device do not hold it up. Requests that come meanwhile get the same answer."""

    def __init__(self, ready: Callable[[], bool]) -> None:
        self._ready = ready
        self._limiter: CapacityLimiter | None = None
        self._asking: asyncio.Future[bool] | None = None

    async def now(self) -> bool:
        """Whether the device computes."""
        if self._asking is None:
            self._asking = asyncio.ensure_future(self._ask())
        return await asyncio.shield(self._asking)

    async def _ask(self) -> bool:
        self._limiter = self._limiter or CapacityLimiter(1)
        try:
            return await anyio.to_thread.run_sync(self._ready, limiter=self._limiter)
        finally:
            self._asking = None


@router.get("/healthz", operation_id="getHealth", response_model=Status, responses=problems(503))
async def healthz(engine: EngineDep) -> Any:
    """The server answers, and a process of the device does or did within two minutes; 503
    otherwise: then only a new start of the server helps."""
    if not engine.well():
        raise DeviceLostError("no process of the device could be started for two minutes")
    return {"status": "alive"}


@router.get("/readyz", operation_id="getReadiness", response_model=Status, responses=problems(503))
async def readyz(request: Request) -> Any:
    """A small kernel computes on the device, however many requests wait for it; 503 while its
    process restarts or nothing comes back from its driver."""
    readiness: Readiness = request.app.state.readiness
    if not await readiness.now():
        raise NoDeviceError("the device does not compute")
    return {"status": "ready"}


@router.get(
    "/metrics",
    operation_id="getMetrics",
    response_class=Response,
    responses={**binary("text/plain"), **problems()},
)
async def metrics(metrics: MetricsDep) -> Response:
    """Requests, latencies and computed tiles as Prometheus text."""
    return Response(metrics.text(), headers={"Content-Type": PROMETHEUS})


@router.get(
    "/v1/devices",
    operation_id="listDevices",
    response_model=list[Device],
    responses=problems(422, 503),
    dependencies=[NoQuery],
)
def devices(engine: EngineDep) -> Any:
    """The OpenCL devices, with memory budget and use."""
    return engine.devices()


@router.get(
    "/v1/memory",
    operation_id="getMemory",
    response_model=HostMemory,
    responses=problems(422),
    dependencies=[NoQuery],
)
async def memory(metrics: MetricsDep) -> Any:
    """What requests and jobs hold of the host's memory, and uploads of its disk."""
    return metrics.bytes_held()
