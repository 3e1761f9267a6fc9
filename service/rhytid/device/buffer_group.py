"""Objects that own buffers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Protocol

from rhytid.device.budget import Releasable


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
