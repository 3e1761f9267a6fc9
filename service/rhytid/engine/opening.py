"""Opens the device that the settings name, drawing in the shape that is fastest on it."""

from __future__ import annotations

from rhytid.device.runtime import Device
from rhytid.device.select import choose
from rhytid.pipeline.measured_shape import remembered_pace, remembered_shape
from rhytid.settings import ServiceSettings


def open_device(settings: ServiceSettings, wanted: str | None = None) -> Device:
    """A device with the memory of the settings. wanted: overrides their choice of it.

    Raises NoDeviceError where none computes.
    """
    device = Device(choose(wanted or settings.device, settings.cache), settings.device_memory)
    if settings.cache is not None:
        device.shape = remembered_shape(device, settings.cache)
        device.work_pace = remembered_pace(device, settings.cache)
    return device
