"""How long the map of an uploaded graph may take to draw."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.device.launches import FIRST_WORK
from rhytid.domain.wording import plural
from rhytid.errors import LimitError
from rhytid.pipeline.work import BLOCK, work_around

# Seconds of the densest block, which is drawn at once.
_BLOCK_SECONDS = 0.1


@dataclass(frozen=True)
class DrawLimit:
    """Seconds that one drawing of the map of a UDIM may take, about, at so much work a second.

    It is estimated from boxes around elements at any stretch: what is drawn takes a share of it.
    """

    seconds: float
    per_second: float = FIRST_WORK

    def check(
        self,
        low: NDArray[np.floating],
        high: NDArray[np.floating],
        resolution: int,
        what: str,
        udim: int,
    ) -> None:
        """Raise LimitError where drawing boxes (K, 2) in UV takes longer.  what: names them."""
        work = work_around(low, high, resolution)
        whole, block = work.sum() / self.per_second, work.max() / self.per_second
        drawing = f"drawing {plural(len(low), what, f'{what}s')} of UDIM {udim}"
        if whole > self.seconds:
            raise LimitError(
                f"{drawing} would take about {_seconds(whole)} s on this device at {resolution}² "
                f"texels: more than {_seconds(self.seconds)} s (RHYTID_DRAW_SECONDS)"
            )
        if block > _BLOCK_SECONDS:
            raise LimitError(
                f"{drawing} would take about {_seconds(block)} s on this device where they are "
                f"densest, in {BLOCK}² of {resolution}² texels: more than {_BLOCK_SECONDS} s"
            )


def _seconds(value: float) -> str:
    return f"{value:.3g}"
