"""The border where errors of the OpenCL driver become ours."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from rhytid.device import watch
from rhytid.device.sigint import without_sigint
from rhytid.device.trial import cl
from rhytid.errors import DeviceError, DeviceMemoryError


@contextmanager
def driver_errors() -> Iterator[None]:
    """The one place where errors of the OpenCL runtime become ours."""
    watch.begin_call()
    try:
        with without_sigint():
            yield
    except cl.MemoryError as error:
        raise DeviceMemoryError(f"the OpenCL driver is out of memory: {error}") from error
    except cl.Error as error:
        raise DeviceError(f"the OpenCL driver failed: {error}") from error
    finally:
        watch.end_call()
