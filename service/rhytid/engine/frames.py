"""Frames in memory: positions, a digest of them, and how much they stretch."""

from __future__ import annotations

import hashlib
import threading
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.frame import NEUTRAL
from rhytid.domain.warnings import InputWarning
from rhytid.engine.log_stretch import NAMES, LogStretch
from rhytid.engine.messages import FrameInfo
from rhytid.errors import FetchingError, FrameMemoryError, NotFoundError, ReadOnlyError


@dataclass(frozen=True, eq=False)
class Frame:
    """Positions (V, 3) float32, None for the neutral; `digest` names their content."""

    positions: NDArray[np.float32] | None
    digest: str

    @classmethod
    def of(cls, positions: NDArray[np.float32]) -> Frame:
        """A frame with the digest of its positions."""
        return cls(positions, hashlib.sha256(positions.tobytes()).hexdigest()[:32])


NEUTRAL_FRAME = Frame(None, NEUTRAL)


LEFT = "the asset has left this machine for the shared store: ask again"


class FrameMemory:
    """Counts the bytes of all frames of all assets against a limit."""

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._used = 0
        self._lock = threading.Lock()

    def change(self, more: int) -> None:
        """Count `more` bytes in, or out where negative; raises FrameMemoryError naming both
        numbers."""
        with self._lock:
            if more > 0 and self._used + more > self._limit:
                raise FrameMemoryError(
                    f"frames hold {self._used} of {self._limit} bytes (RHYTID_FRAME_MEMORY_MB), "
                    f"{more} more do not fit: delete some"
                )
            self._used += more


@dataclass(frozen=True, eq=False)
class _Stored:
    frame: Frame
    stretch: LogStretch
    warnings: tuple[InputWarning, ...]
    number: int

    def info(self, name: str, limit: float) -> FrameInfo:
        return FrameInfo(name, self.stretch.percentiles(limit), self.warnings)


class Frames:
    """The frames of one asset by name. `neutral` is always there and cannot be written."""

    def __init__(self, memory: FrameMemory) -> None:
        self._memory = memory
        self._lock = threading.Lock()
        self._frames: dict[str, _Stored] = {}
        self._closed = self._left = False
        self._stored = 0

    @property
    def stored(self) -> int:
        """How often a frame was stored without `since`."""
        return self._stored

    def put(
        self,
        name: str,
        frame: Frame,
        stretch: LogStretch,
        warnings: tuple[InputWarning, ...] = (),
        *,
        since: int | None = None,
    ) -> None:
        """Store a frame, how it stretches and what is probably wrong with it, in place of one of
        the same name.

        since: `stored` when the frame was sent; one of the same name that came later stays.
        """
        assert frame.positions is not None
        refuse_neutral(name)
        with self._lock:
            if self._left:
                raise FetchingError(LEFT)
            if self._closed:
                raise NotFoundError("the asset was removed")
            if since is not None and name in self._frames and self._frames[name].number > since:
                return
            self._memory.change(frame.positions.nbytes - self._bytes(name))
            if since is None:
                self._stored = since = self._stored + 1
            self._frames[name] = _Stored(frame, stretch, warnings, since)

    def get(self, name: str) -> Frame:
        """A frame by name; raises NotFoundError."""
        return NEUTRAL_FRAME if name == NEUTRAL else self._entry(name).frame

    def info(self, name: str, limit: float) -> FrameInfo:
        """The figures of a frame, its log stretch clamped to ± `limit`; raises NotFoundError."""
        if name == NEUTRAL:
            return _neutral_info()
        return self._entry(name).info(name, limit)

    def infos(self, limit: float) -> list[FrameInfo]:
        """Every frame, the neutral first, then by name."""
        with self._lock:
            known = sorted(self._frames.items())
        return [_neutral_info(), *(stored.info(name, limit) for name, stored in known)]

    def delete(self, name: str) -> None:
        """Delete a frame; raises NotFoundError, and ReadOnlyError for the neutral."""
        refuse_neutral(name)
        self._entry(name)
        with self._lock:
            self._memory.change(-self._bytes(name))
            self._frames.pop(name, None)

    def close(self) -> None:
        """Delete every frame and store no more: the asset was removed."""
        with self._lock:
            self._closed = True
            self._memory.change(-sum(self._bytes(name) for name in self._frames))
            self._frames.clear()

    def leave(self, *, anyway: bool = False) -> bool:
        """Store no more, because the asset leaves this machine; False, and nothing is done, where
        there is a frame. anyway: its frames go with it."""
        with self._lock:
            if anyway:
                self._memory.change(-sum(self._bytes(name) for name in self._frames))
                self._frames.clear()
            self._left = not self._frames
            return self._left

    def _entry(self, name: str) -> _Stored:
        with self._lock:
            if name not in self._frames:
                raise NotFoundError(f"no frame {name!r}")
            return self._frames[name]

    def _bytes(self, name: str) -> int:
        entry = self._frames.get(name)
        if entry is None or entry.frame.positions is None:
            return 0
        return entry.frame.positions.nbytes


def refuse_neutral(name: str) -> None:
    """Raise ReadOnlyError for the name of the neutral frame."""
    if name == NEUTRAL:
        raise ReadOnlyError("the frame neutral always exists and is read-only")


def _neutral_info() -> FrameInfo:
    return FrameInfo(NEUTRAL, dict.fromkeys(NAMES, 0.0))
