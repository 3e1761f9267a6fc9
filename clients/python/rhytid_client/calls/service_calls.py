"""Is the server there, and what does it compute on."""

from __future__ import annotations

from rhytid_client import parse
from rhytid_client.exchange import Flow
from rhytid_client.requests import get
from rhytid_client.results import Device


def health() -> Flow[bool]:
    """True: the process answers. Raises ConnectionFailed or ServerError otherwise."""
    parse.value((yield get("healthz")))
    return True


def ready() -> Flow[bool]:
    """Whether the server's device computes."""
    response = yield get("readyz")
    if response.status == 503:
        return False
    parse.value(response)
    return True


def metrics() -> Flow[str]:
    """The server's figures as Prometheus text."""
    return parse.content((yield get("metrics"))).decode("utf-8", "replace")


def devices() -> Flow[list[Device]]:
    """The server's OpenCL devices, with memory budget and use."""
    return parse.many(Device, (yield get("v1", "devices")))
