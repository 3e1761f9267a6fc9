"""Client of the rhytid facial wrinkle service: frames in, displacement tiles out."""

from rhytid_client.async_client import AsyncClient
from rhytid_client.client import Client
from rhytid_client.errors import (
    BadAnswer,
    Conflict,
    ConnectionFailed,
    JobCancelled,
    JobFailed,
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
)
from rhytid_client.results import (
    Asset,
    Bins,
    Device,
    Frame,
    InputWarning,
    Job,
    Notice,
    Stretch,
    Tile,
)

__version__ = "0.1.0"

__all__ = [
    "Asset",
    "AsyncClient",
    "BadAnswer",
    "Bins",
    "Client",
    "Conflict",
    "ConnectionFailed",
    "Device",
    "Frame",
    "InputWarning",
    "Job",
    "JobCancelled",
    "JobFailed",
    "NotFound",
    "NotReady",
    "Notice",
    "ProblemError",
    "RequestError",
    "RhytidError",
    "RhytidWarning",
    "ServerBusy",
    "ServerError",
    "Stretch",
    "Tile",
    "Timeout",
    "TooLarge",
]
