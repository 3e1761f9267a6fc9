"""Frames in memory: their positions, a digest of these, and percentiles of how much they
stretch."""

from __future__ import annotations

import hashlib
import threading
from collections import OrderedDict
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rhytid.domain.frame import NEUTRAL, check_positions
from rhytid.domain.warnings import InputWarning
from rhytid.engine.changes import counted
from rhytid.engine.messages import FrameInfo
from rhytid.errors import (
    FetchingError,
    FrameMemoryError,
    NotFoundError,
    ReadOnlyError,
    RhytidError,
)

# Bytes of frames that are drawn without being stored, which are remembered.
_RECENT = 64 << 20
# Names in the message about a frame that there is not, at most.
_LISTED = 8


class UnknownFrameError(RhytidError):
    """A frame that is named by its digest alone is not here (any more); never seen by callers."""


_PERCENTILES = (1, 10, 50, 90, 99)
# Names of the percentiles: of the clamped log stretch, and one of its absolute value.
NAMES = (*(f"p{p}" for p in _PERCENTILES), "abs_p90")


@dataclass(frozen=True, eq=False)
class Frame:
    """Checked positions (V, 3) float32 and 32 hex digits that name them.

    positions: None for the neutral, and for a frame that the engine got a moment ago: `digest`
    alone names that.
    """

    positions: NDArray[np.float32] | None
    digest: str

    @classmethod
    def of(cls, positions: NDArray[np.float32]) -> Frame:
        """A frame of checked positions."""
        return cls(positions, hashlib.sha256(positions.reshape(-1).data).hexdigest()[:32])

    @classmethod
    def checked(cls, positions: ArrayLike, vertices: int) -> Frame:
        """A frame of positions; raises FrameError naming the count or the first vertex that is not
        finite."""
        return cls.of(check_positions(positions, vertices))

    @property
    def bare(self) -> Frame:
        """The same without its positions."""
        return Frame(None, self.digest)


NEUTRAL_FRAME = Frame(None, NEUTRAL)


LEFT = "the asset has left this machine for the shared store: ask again"


class FrameMemory:
    """Counts the bytes of all stored frames of all assets against a limit, and keeps those for a
    while that were drawn without being stored."""

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._used = 0
        self._lock = threading.Lock()
        self._recent: OrderedDict[str, Frame] = OrderedDict()
        self._recent_bytes = 0

    def recent(self, frame: Frame) -> Frame:
        """A frame that is not stored, with its positions, which are kept; raises UnknownFrameError
        where it has none and they are not here."""
        with self._lock:
            known = self._recent.pop(frame.digest, None)
            found = known or frame
            if found.positions is None:
                raise UnknownFrameError(f"frame {frame.digest} is not here")
            self._recent[frame.digest] = found
            self._recent_bytes += 0 if known else found.positions.nbytes
            while self._recent_bytes > _RECENT and len(self._recent) > 1:
                _, oldest = self._recent.popitem(last=False)
                assert oldest.positions is not None
                self._recent_bytes -= oldest.positions.nbytes
        return found

    def change(self, more: int) -> None:
        """Count `more` bytes in, or out where negative; raises FrameMemoryError, naming both
        numbers, where they do not fit."""
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
    """The frames of one asset by name. The frame `neutral` always exists and cannot be written.

    asset: its id.
    """

    def __init__(self, memory: FrameMemory, asset: str) -> None:
        self._memory, self._asset = memory, asset
        self._lock = threading.Lock()
        self._frames: dict[str, _Stored] = {}
        self._closed = self._left = False
        self._stored = 0

    def recent(self, frame: Frame) -> Frame:
        """As `FrameMemory.recent`."""
        return self._memory.recent(frame)

    @property
    def stored(self) -> int:
        """How often a frame was stored by a call without `since`."""
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
        """Store a frame, its stretch and its warnings, in place of the frame of the same name.

        since: the value of `stored` when the frame was sent; a frame of the same name that came
        later stays.
        """
        assert frame.positions is not None
        refuse_neutral(name)
        with counted().changing(self._asset, name), self._lock:
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
        """Every frame, `neutral` first, then by name."""
        with self._lock:
            known = sorted(self._frames.items())
        return [_neutral_info(), *(stored.info(name, limit) for name, stored in known)]

    def delete(self, name: str) -> None:
        """Delete a frame; raises NotFoundError, and ReadOnlyError for the neutral."""
        refuse_neutral(name)
        self._entry(name)
        with counted().changing(self._asset, name), self._lock:
            self._memory.change(-self._bytes(name))
            self._frames.pop(name, None)

    def close(self) -> None:
        """Delete every frame and store no more: the asset was removed."""
        with counted().changing(self._asset), self._lock:
            self._closed = True
            self._memory.change(-sum(self._bytes(name) for name in self._frames))
            self._frames.clear()

    def leave(self, *, anyway: bool = False) -> bool:
        """Store no more, because the asset leaves this machine. Returns False, and does nothing,
        where there is a frame.  anyway: its frames go with it."""
        with counted().changing(self._asset), self._lock:
            if anyway:
                self._memory.change(-sum(self._bytes(name) for name in self._frames))
                self._frames.clear()
            self._left = not self._frames
            return self._left

    def _entry(self, name: str) -> _Stored:
        with self._lock:
            if name not in self._frames:
                raise NotFoundError(f"no frame {name!r}: {_there(self._frames)}")
            return self._frames[name]

    def _bytes(self, name: str) -> int:
        entry = self._frames.get(name)
        if entry is None or entry.frame.positions is None:
            return 0
        return entry.frame.positions.nbytes


def _there(names: Iterable[str]) -> str:
    """Words for the frames that there are, by name; of many the first."""
    found = [NEUTRAL, *sorted(names)]
    if len(found) == 1:
        return f"there is {NEUTRAL} alone"
    more = len(found) - _LISTED
    end = [f"{more} more"] if more > 0 else [found.pop()]
    return f"there are {', '.join(found[:_LISTED])} and {end[0]}"


def refuse_neutral(name: str) -> None:
    """Raise ReadOnlyError for the name of the neutral frame."""
    if name == NEUTRAL:
        raise ReadOnlyError("the frame neutral always exists and is read-only")


def _neutral_info() -> FrameInfo:
    return FrameInfo(NEUTRAL, dict.fromkeys(NAMES, 0.0))


@dataclass(frozen=True, eq=False)
class LogStretch:
    """The two values of the unclamped log stretch of a frame that each percentile lies between.

    A clamp keeps the order of values, so the same two values, clamped, enclose the percentile of
    any clamped frame: no second measurement is needed.  lower, upper (6,): the values, in the order
    of NAMES.  share (6,): how far each percentile lies from lower to upper, linear.
    """

    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    share: NDArray[np.float64]

    @classmethod
    def of(cls, ratios: NDArray[np.float32]) -> LogStretch:
        """Measures the stretch ratios (F, 2) of a frame, over triangles and both axes."""
        # As numpy's percentile of method "linear" has it.
        places = np.array([*_PERCENTILES, 90]) / 100 * (ratios.size - 1)
        low = np.floor(places).astype(int)
        high = np.minimum(low + 1, ratios.size - 1)
        with np.errstate(divide="ignore"):
            # Sorting floats is several times faster than finding a few places among doubles.
            found = np.log(np.sort(ratios, axis=None)[[low, high]].astype(np.float64))
            sizes = np.abs(np.log(ratios.astype(np.float64))).ravel()
        sizes.partition(low[-1])
        found[:, -1] = sizes[low[-1]], sizes[high[-1] :].min()
        return cls(found[0], found[1], places - low)

    def percentiles(self, limit: float) -> dict[str, float]:
        """Percentiles by name, of log stretch clamped to ± `limit`."""
        lower, upper = np.clip(self.lower, -limit, limit), np.clip(self.upper, -limit, limit)
        found = np.where(
            self.share < 0.5,
            lower + (upper - lower) * self.share,
            upper - (upper - lower) * (1.0 - self.share),
        )
        return dict(zip(NAMES, found.tolist(), strict=True))
