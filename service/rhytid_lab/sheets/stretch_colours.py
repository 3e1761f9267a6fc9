"""One frame of a face as plain arrays, and its stretch as colours (Fig. 3)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.pictures.images import Picture, axis_wheel, diverging
from rhytid.pictures.sheet import colour_bar


@dataclass(frozen=True, eq=False)
class Performance:
    """One frame of a face as plain arrays.

    neutral, deformed: (V, 3).  faces: (F, 3).  triangle_uv: (F, 3, 2), local to the UDIM of the
    maps.  axes: (F, 2, 2), axes[f, i] = ŝᵢ in UV.  ratios: (F, 2).
    """

    neutral: NDArray[Any]
    deformed: NDArray[Any]
    faces: NDArray[Any]
    triangle_uv: NDArray[Any]
    axes: NDArray[Any]
    ratios: NDArray[Any]

    @property
    def logs(self) -> NDArray[np.float64]:
        """(F, 2) log stretch; a collapsed triangle has a large negative number."""
        logs: NDArray[np.float64] = np.log(np.maximum(self.ratios, 1e-6))
        return logs


def axis_colours(frame: Performance, axis: int) -> NDArray[np.float64]:
    """(F, 3); fades to grey where the two ratios are the same within a few per cent."""
    along, logs = frame.axes[:, axis], frame.logs
    return axis_wheel(np.arctan2(along[:, 1], along[:, 0]), np.abs(logs[:, 0] - logs[:, 1]) / 0.06)


def stretch_limit(logs: NDArray[np.float64]) -> float:
    """The end of the colour scale: nearly all of this frame, slivers left out."""
    return float(np.clip(np.percentile(np.abs(logs), 99), 0.05, 0.7))


def stretch_bar(width: int, limit: float) -> Picture:
    """A strip (STRIP, width, 3) with the ratios from exp(-limit) to exp(limit)."""
    ticks = [(t * limit, f"{np.exp(t * limit):.2f}" if t else "1") for t in (-1, -0.5, 0, 0.5, 1)]
    return colour_bar(width, -limit, limit, lambda v: diverging(v, limit), ticks)
