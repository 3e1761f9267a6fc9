"""Memory on a device."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

if TYPE_CHECKING:
    from rhytid.device.runtime import Device


class Buffer:
    """Bytes on the device, counted in its budget until released."""

    def __init__(self, device: Device, nbytes: int, host: NDArray[Any] | None = None) -> None:
        spare = device.budget.reserve(nbytes, reuse=host is None)
        device.born.append(self)
        self.nbytes = nbytes
        self.handle: Any = spare
        self._device = device
        self._released = False
        if spare is None:
            self.handle = device.allocate(nbytes, host)

    def release(self) -> None:
        """Give the memory back; a second call does nothing."""
        elsewhere = self._device.elsewhere
        if elsewhere is None:
            self._release()
        else:
            elsewhere.step(self._release)

    def _release(self) -> None:
        if not self._released:
            self._released = True
            self._device.budget.free(self.nbytes)
            if self.handle is not None:
                self._device.pool.leave(self.handle, self.nbytes)
