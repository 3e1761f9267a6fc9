"""Client of the rhytid facial wrinkle service: frames in, displacement tiles out."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from rhytid_client.choices import (
    GraphFormat,
    LiveFormat,
    MeshFormat,
    Method,
    Sampling,
    StretchModel,
    TileFormat,
)
from rhytid_client.errors import (
    BadAnswer,
    Conflict,
    ConnectionFailed,
    JobCancelled,
    JobFailed,
    LiveClosed,
    NotAllowed,
    NotFound,
    NotReady,
    ProblemError,
    RequestError,
    RhytidError,
    RhytidWarning,
    ServerBusy,
    ServerError,
    Timeout,
    TooLarge,
    TooMany,
)
from rhytid_client.live import LiveAnswer, LiveAsset, LiveTile
from rhytid_client.live.awaited import AsyncLive
from rhytid_client.live.blocking import Live
from rhytid_client.plain_client import PlainClient
from rhytid_client.results import (
    Asset,
    Bins,
    Device,
    Frame,
    InputWarning,
    Job,
    Notice,
    Stretch,
)
from rhytid_client.tiles import Tile

if TYPE_CHECKING:
    from rhytid_client.async_client import AsyncClient
    from rhytid_client.client import Client

__version__ = "0.1.0"

__all__ = [
    "Asset",
    "AsyncClient",
    "AsyncLive",
    "BadAnswer",
    "Bins",
    "Client",
    "Conflict",
    "ConnectionFailed",
    "Device",
    "Frame",
    "GraphFormat",
    "InputWarning",
    "Job",
    "JobCancelled",
    "JobFailed",
    "Live",
    "LiveAnswer",
    "LiveAsset",
    "LiveClosed",
    "LiveFormat",
    "LiveTile",
    "MeshFormat",
    "Method",
    "NotAllowed",
    "NotFound",
    "NotReady",
    "Notice",
    "PlainClient",
    "ProblemError",
    "RequestError",
    "RhytidError",
    "RhytidWarning",
    "Sampling",
    "ServerBusy",
    "ServerError",
    "Stretch",
    "StretchModel",
    "Tile",
    "TileFormat",
    "Timeout",
    "TooLarge",
    "TooMany",
]

# These two need httpx, the rest of the package does not: it is imported with them.
_OVER_HTTPX = {"Client": "client", "AsyncClient": "async_client"}


def __getattr__(name: str) -> Any:
    if name not in _OVER_HTTPX:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_OVER_HTTPX[name]}"), name)
