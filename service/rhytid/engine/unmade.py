"""What a task of the device needs and takes too long to make within it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rhytid.engine.device_asset import DeviceAsset


class Unmade(Exception):
    """A task stopped: something that is kept of the asset is not there, and takes longer to make
    than one task may.

    make: makes and keeps it, unless it is there by now, on a thread that uses the device from
    elsewhere; others draw between two of its steps.
    """

    def __init__(self, make: Callable[[DeviceAsset], None]) -> None:
        super().__init__()
        self.make = make
