"""Rows of tables: what the command prints, and what docs/scaling.md shows."""

from __future__ import annotations

from rhytid_lab.scaling.check import Check
from rhytid_lab.scaling.fleet import Outcome

CHECK_HEADER = (
    "size", "method", "workers", "predicted s", "processor s", "off", "wall s", "off wall",
)  # fmt: skip
OUTCOME_HEADER = ("policy", "hit rate", "max / mean", "median wait s", "p99 wait s", "loads / s")


def check_row(one: Check) -> tuple[str, ...]:
    """A check as cells of CHECK_HEADER; seconds are of one worker."""
    run = one.run
    return (
        f"{run.size}²",
        run.method,
        str(run.workers),
        f"{one.predicted:.1f}",
        f"{one.processor:.1f}",
        _percent(one.error),
        f"{run.wall:.1f}",
        _percent(one.wall_error),
    )


def outcome_row(one: Outcome) -> tuple[str, ...]:
    """An outcome as cells of OUTCOME_HEADER."""
    return (
        one.policy,
        f"{100 * one.hits:.1f} %",
        f"{one.balance:.1f}",
        f"{one.median:.2f}",
        f"{one.p99:.2f}",
        f"{one.loads:.1f}",
    )


def _percent(share: float) -> str:
    return f"{round(100 * share):+d} %"
