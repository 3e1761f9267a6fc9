"""The frames of one animation, each read when it is asked for, and the numbers that they have."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.expressions import Expressions, evenly_spaced
from rhytid.errors import FrameError, LimitError
from rhytid.formats.limits import MAX_FRAME_NUMBERS, check_size

Frame = NDArray[np.float32]

# The most frames of one file: more than an hour at 24 frames per second.
MOST_FRAMES = 100_000
# How far from a whole number a sample may lie and still be that frame. Times are float32 seconds:
# after an hour their step is 0.006 of a frame.
_NEAR = 0.01


@dataclass(frozen=True)
class FrameSet:
    """The frames of one animation, which are read one at a time.

    count: of frames.  read: gives frame i, (V, 3) float32 less the centre of the mesh; raises
    FrameError naming the frame that cannot be used.  numbers: the frame numbers that the file
    itself gives, None where it gives none.
    """

    count: int
    read: Callable[[int], Frame]
    numbers: tuple[int, ...] | None = None

    @classmethod
    def of(cls, frames: Frame) -> FrameSet:
        """The set of frames (N, V, 3) that are in memory."""
        return cls(len(frames), lambda i: frames[i])

    def __len__(self) -> int:
        return self.count

    def expressions(self, vertices: int) -> Expressions:
        """The frames as expressions without names. Of many frames some are taken, evenly, since no
        more are looked at. Raises FrameError and LimitError."""
        chosen = evenly_spaced(self.count)
        check_size("the frames", 3 * vertices * len(chosen), MAX_FRAME_NUMBERS)
        read = np.empty((len(chosen), vertices, 3), np.float32)
        for row, i in zip(read, chosen, strict=True):
            row[:] = self.read(i)
        return Expressions.checked(read, vertices, [f"{i:04d}" for i in chosen])


@dataclass(frozen=True)
class Clip:
    """Which animation of a file is meant, where it holds several.

    prim: path or name of a USD mesh.  clip: name or number of a glTF animation.  fps: frames per
    second, for files that count time in seconds.
    """

    prim: str | None = None
    clip: str | None = None
    fps: float = 24.0


def frames_between(first: float, last: float) -> tuple[int, ...]:
    """The whole numbers from first to last; raises FrameError where there are none or one is below
    0, LimitError above MOST_FRAMES of them."""
    if not (math.isfinite(first) and math.isfinite(last)):
        raise FrameError(f"frames from {first} to {last}: not finite")
    start, end = math.ceil(first - _NEAR), math.floor(last + _NEAR)
    if end < start:
        raise FrameError(f"there is no whole frame between {first:g} and {last:g}")
    check_frame_count(end - start + 1)
    return checked_numbers(range(start, end + 1))


def frames_at(times: NDArray[np.float64], what: str) -> tuple[list[int], tuple[int, ...]]:
    """The samples that are frames, and the numbers of these frames.

    times: (N,) of the samples, in frames.  what: for messages, what would set the times right.

    A sample at a whole number is that frame; samples between whole numbers are passed over. Raises
    FrameError naming the first sample that is out of order, or a sample between two whole numbers
    of which one, though inside the range, has no sample.
    """
    finite = np.isfinite(times)
    if not finite.all():
        raise FrameError(f"sample {int(np.argmin(finite))} has no finite time")
    late = np.diff(times) <= 0.0
    if late.any():
        i = int(np.argmax(late))
        raise FrameError(f"sample {i + 1} is at frame {times[i + 1]:g}, not after {times[i]:g}")
    nearest = np.rint(times)
    whole = np.abs(times - nearest) <= _NEAR
    between = times[~whole]
    missed = np.setdiff1d(np.concatenate([np.floor(between), np.ceil(between)]), nearest[whole])
    missed = missed[(missed > times[0]) & (missed < times[-1])]
    if len(missed) or not whole.any():
        place = f"{between[0]:.6g}" if len(between) else "none"
        raise FrameError(f"a sample lies at frame {place}, between whole frames; {what}")
    chosen = np.flatnonzero(whole)
    return chosen.tolist(), checked_numbers([int(n) for n in nearest[chosen]])


def check_frame_count(count: int) -> None:
    """Raise LimitError above MOST_FRAMES."""
    if count > MOST_FRAMES:
        raise LimitError(f"{count} frames: at most {MOST_FRAMES} of one file")


def checked_numbers(numbers: Sequence[int]) -> tuple[int, ...]:
    """The frame numbers as a tuple; raises FrameError where one is below 0, or two are the same."""
    if numbers and min(numbers) < 0:
        raise FrameError(f"frame {min(numbers)}: the numbers of frames begin at 0; move the frames")
    if len(set(numbers)) < len(numbers):
        raise FrameError("two samples are of one frame")
    return tuple(numbers)
