"""Memory on a device, and objects that own some."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, Protocol

from rhytid.device.budget import Releasable


class Buffer:
    """Bytes on the device, counted in its budget until released.

    handle: the memory of the driver; None where there was none.  release_by: takes it back; called
    by every `release`.
    """

    def __init__(self, nbytes: int, handle: Any, release_by: Callable[[Buffer], None]) -> None:
        self.nbytes, self.handle = nbytes, handle
        self.released = False
        self._release_by = release_by

    def release(self) -> None:
        """Give the memory back; a second call does nothing."""
        self._release_by(self)


class Measured(Releasable, Protocol):
    """Something on the device whose size in bytes is known."""

    @property
    def nbytes(self) -> int:
        """Bytes on the device."""
        ...


class BufferGroup(ABC):
    """Something on the device that owns parts, and is as large as they are together."""

    @property
    @abstractmethod
    def _buffers(self) -> tuple[Measured | None, ...]:
        """What it owns; None where it has no such part."""

    @property
    def nbytes(self) -> int:
        """Bytes on the device."""
        return sum(part.nbytes for part in self._buffers if part is not None)

    def release(self) -> None:
        """Give the memory back."""
        for part in self._buffers:
            if part is not None:
                part.release()
