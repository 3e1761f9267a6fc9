"""What the remote calls of an engine are made by."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from rhytid.engine_process.device_process import DeviceProcess
from rhytid.engine_process.requests import Request


class Caller(Protocol):
    """`Supervisors` on this machine; what asks engines elsewhere, too."""

    def call(self, request: Request, prepare: Callable[[DeviceProcess], None] | None = None) -> Any:
        """The answer to a request; raises what the engine raises.

        prepare: called with each process of this machine that is asked, before.
        """

    def forget(self, asset: str) -> None:
        """An asset was changed or removed: what is asked of it may be tried again."""
