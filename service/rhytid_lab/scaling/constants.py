"""The constants of the cost model, from figures that were measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rhytid.errors import InputError
from rhytid_lab.scaling.figures import Frame, Run, one_device


@dataclass(frozen=True)
class Constants:
    """Seconds that a device and a core of its host take, and bytes.

    redraw, precompute: a texel and a wrinkle.  binned: a texel of a blend.  put: positions of a
    frame are read, checked and stretched.  beyond: what drawing a frame in `bake` takes beyond the
    bench: pieces, and reading them back.  write: a texel is packed and stored.  start: a process
    until it draws, and more for each wrinkle of its asset.  file_bytes: of a texel in a file.
    asset_bytes: of a wrinkle in the store.
    """

    device: str
    redraw: tuple[float, float]
    precompute: tuple[float, float]
    binned: float
    put: float
    beyond: float
    write: float
    start: tuple[float, float]
    file_bytes: float
    asset_bytes: float = 63.0

    @classmethod
    def of(cls, frames: Sequence[Frame], runs: Sequence[Run], *, shared: bool = False) -> Constants:
        """Fit them to frames of `rhytid bench`, and to runs of `rhytid bake` by `redraw`.

        Two frames with as many texels and other wrinkles tell texels and wrinkles apart; of one
        alone everything goes by texels. So do two runs for `start`.  shared: others used the
        machine meanwhile, and the device is one core of it: all times are processor time.
        Raises InputError where a case or a run is missing.
        """
        own = [run for run in runs if run.workers == 1 and run.method == "redraw"]
        if not own:
            raise InputError("constants need a run of one process by redraw")
        device = one_device(frames)
        redraw = _plane(frames, "redraw", shared)
        share = [run.share if shared else 1.0 for run in own]
        drawn = [redraw[0] * run.texels + redraw[1] * run.wrinkles for run in own]
        per = [(run, part / run.frames) for run, part in zip(own, share, strict=True)]
        beyond = [
            _step(run, "redraw") * part - seconds
            for (run, part), seconds in zip(per, drawn, strict=True)
        ]
        return cls(
            device,
            redraw,
            _plane(frames, "precompute", shared),
            _mean([_case(frame, "binned", shared) / frame.texels for frame in frames]),
            _mean([_step(run, "stretch") * part for run, part in per]),
            max(_mean(beyond), 0.0),
            _mean([_step(run, "write") * part / run.texels for run, part in per]),
            _start(own, share),
            _mean([run.nbytes / (run.frames * run.texels) for run in own]),
        )


def _plane(frames: Sequence[Frame], case: str, shared: bool) -> tuple[float, float]:
    """Seconds of a texel and of a wrinkle, none below 0."""
    return _line([(frame.texels, frame.wrinkles, _case(frame, case, shared)) for frame in frames])


def _start(runs: Sequence[Run], share: Sequence[float]) -> tuple[float, float]:
    """Seconds of a start, and of a wrinkle of it."""
    rest = [
        (1.0, run.wrinkles, max(run.wall - sum(run.steps.values()), 1e-3) * part)
        for run, part in zip(runs, share, strict=True)
    ]
    return _line(rest)


def _line(rows: Sequence[tuple[float, float, float]]) -> tuple[float, float]:
    """a, b of z = a x + b y, by least squares of relative errors; where they cannot be told apart,
    or one would be below 0, a alone or b alone, whichever fits."""
    table = np.array(rows, dtype=float)
    scaled = table[:, :2] / table[:, 2:]
    ones = np.ones(len(table))
    if np.linalg.matrix_rank(scaled / np.linalg.norm(scaled, axis=0), tol=1e-6) == 2:
        a, b = np.linalg.lstsq(scaled, ones, rcond=None)[0]
        if min(a, b) >= 0.0:
            return float(a), float(b)
    alone: list[tuple[float, tuple[float, float]]] = []
    for column in (0, 1):
        x = scaled[:, column]
        value = float(x @ ones / (x @ x))
        off = float(np.linalg.norm(value * x - 1.0))
        alone.append((off, (value, 0.0) if column == 0 else (0.0, value)))
    by_texel, by_wrinkle = alone
    return by_wrinkle[1] if by_wrinkle[0] < 0.99 * by_texel[0] else by_texel[1]


def _case(frame: Frame, case: str, shared: bool) -> float:
    seconds = frame.processor if shared else frame.seconds
    if case not in seconds:
        raise InputError(f"{frame.size}² texels, {frame.wrinkles} wrinkles: {case} was not timed")
    return seconds[case]


def _step(run: Run, step: str) -> float:
    if step not in run.steps:
        raise InputError(f"a run at {run.size}² by {run.method} has no step {step!r}")
    return run.steps[step]


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values))
