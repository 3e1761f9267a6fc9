"""What a frame costs, beside the times that the paper reports (section 3)."""

from __future__ import annotations

from dataclasses import dataclass

from rhytid_lab.bench.frame import Cost

# Seconds on an NVIDIA GeForce RTX 3090 at 16384² texels and about 20 million wrinkles.
PAPER_SIZE, PAPER_WRINKLES = 16384, 20_000_000
PAPER_SECONDS = {
    "stretch": 1.5,
    "convolved": 2.0,
    "redraw": 2.4,
    "binned": 0.05,
    "precompute": 60.0,
}


@dataclass(frozen=True)
class TimeRow:
    """A case: seconds and map copies here, seconds scaled to the paper's size, and the paper's."""

    case: str
    seconds: float
    map_copies: float
    scaled: float
    paper: float | None


def wrinkles_at(resolution: int) -> int:
    """As many wrinkles per texel as the paper has."""
    return max(round(PAPER_WRINKLES * resolution**2 / PAPER_SIZE**2), 100)


def time_rows(costs: list[Cost], resolution: int) -> list[TimeRow]:
    """Costs at `resolution` with `wrinkles_at(resolution)` wrinkles, and the paper's beside them.

    Texels and wrinkles grow by the same factor, so times of maps are scaled by it. Stretch is per
    triangle here and stays; the paper's is per texel.
    """
    factor = (PAPER_SIZE / resolution) ** 2
    return [
        TimeRow(
            cost.case,
            cost.seconds,
            cost.map_copies,
            cost.seconds * (1.0 if cost.case == "stretch" else factor),
            PAPER_SECONDS.get(cost.case),
        )
        for cost in costs
    ]
