"""Percentiles of log stretch that stay right when the clamp changes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_PERCENTILES = (1, 10, 50, 90, 99)
# Names of the percentiles: of the clamped log stretch, and one of its absolute value.
NAMES = (*(f"p{p}" for p in _PERCENTILES), "abs_p90")


@dataclass(frozen=True, eq=False)
class LogStretch:
    """Between which values of the unclamped log stretch of a frame each percentile lies.

    A clamp keeps the order of values, so these two stand at the same place in any clamped frame:
    its percentiles need no second measurement.  lower, upper (6,): the values, in the order of
    NAMES.  share (6,): how far from the one to the other, linear.
    """

    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    share: NDArray[np.float64]

    @classmethod
    def of(cls, ratios: NDArray[np.float32]) -> LogStretch:
        """Of the stretch ratios (F, 2), over triangles and both axes."""
        with np.errstate(divide="ignore"):
            logs = np.log(ratios.astype(np.float64)).ravel()
        # As numpy's percentile of method "linear" has it.
        places = np.array([*_PERCENTILES, 90]) / 100 * (logs.size - 1)
        low = np.floor(places).astype(int)
        high = np.minimum(low + 1, logs.size - 1)
        both = np.append(low, high)
        found = np.partition(logs, both)[both].reshape(2, -1)
        found[:, -1] = np.partition(np.abs(logs), both)[both].reshape(2, -1)[:, -1]
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
