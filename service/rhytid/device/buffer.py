"""Memory on a device, and objects that own some."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from rhytid.device.budget import Releasable


class Buffer:
    """Bytes on the device, counted in its budget until they are released.

    handle: the memory of the driver; None until there is any.  release_by: takes the buffer back;
    every `release` calls it.  host: the array whose memory it is; None where it has its own.
    """

    # A frame makes some seventy, whose dictionaries Python would look through for garbage.
    __slots__ = ("_release_by", "handle", "host", "nbytes", "released")

    def __init__(self, nbytes: int, handle: Any, release_by: Callable[[Buffer], None]) -> None:
        self.nbytes, self.handle = nbytes, handle
        self.host: NDArray[np.uint8] | None = None
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
    """An object on the device that owns parts, and is as large as they are together."""

    @property
    @abstractmethod
    def _buffers(self) -> tuple[Measured | None, ...]:
        """The parts that it owns; None in the place of a part that it lacks."""

    @property
    def nbytes(self) -> int:
        """Bytes on the device."""
        return sum(part.nbytes for part in self._buffers if part is not None)

    def release(self) -> None:
        """Give the memory back."""
        for part in self._buffers:
            if part is not None:
                part.release()
