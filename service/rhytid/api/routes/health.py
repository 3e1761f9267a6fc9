"""Liveness, readiness, metrics, devices and memory."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Response

from rhytid.api.dependencies import EngineDep, MetricsDep, NoQuery, Slot
from rhytid.api.documentation import binary, problems
from rhytid.api.schemas import Device, HostMemory, Status
from rhytid.errors import NoDeviceError

PROMETHEUS = "text/plain; version=0.0.4; charset=utf-8"
router = APIRouter(tags=["service"])


@router.get("/healthz", operation_id="getHealth", response_model=Status, responses=problems())
async def healthz() -> Any:
    """The process answers."""
    return {"status": "alive"}


@router.get("/readyz", operation_id="getReadiness", response_model=Status, responses=problems(503))
def readyz(engine: EngineDep, slot: Slot) -> Any:
    """A small kernel computes on the device; 503 too where no more requests may wait for it, and
    while its process restarts or nothing comes back from its driver."""
    with slot:
        if not engine.ready():
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
