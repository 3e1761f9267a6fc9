"""Opens the device that the settings name, drawing in the shape that is fastest on it."""

from __future__ import annotations

from rhytid.device.figures import Figures
from rhytid.device.runtime import Device
from rhytid.device.select import choose
from rhytid.pipeline.measured_shape import remembered_pace, remembered_shape
from rhytid.support.settings import ServiceSettings


def open_device(
    settings: ServiceSettings, wanted: str | None = None, figures: Figures | None = None
) -> Device:
    """A device with the memory of the settings. wanted: overrides their choice of it.
    figures: what it does.

    Raises NoDeviceError where none computes.
    """
    found = choose(wanted or settings.device, settings.cache)
    device = Device(found, settings.device_memory, figures)
    if settings.cache is not None:
        device.shape = remembered_shape(device, settings.cache)
        device.work_pace = remembered_pace(device, settings.cache)
    return device
