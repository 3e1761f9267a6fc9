"""Hit rate and wait of each policy over the heads that a device holds, drawn by matplotlib."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from rhytid.domain.wording import install_hint
from rhytid.errors import RhytidError
from rhytid_lab.scaling.fleet import Fleet, Outcome, compare

try:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
except ImportError as error:
    raise RhytidError(f"plots need matplotlib; {install_hint('lab')}") from error

# Heads that a device holds, over as many as there are for each device.
ROOMS = (1.0, 1.25, 1.5, 2.0, 3.0)
_MARKS = "osD^v"
# The shortest wait that is drawn, seconds: a tenth of a request.
_SHORTEST = 0.01


def series(fleet: Fleet, count: int, seed: int) -> dict[int, list[Outcome]]:
    """Every policy by the heads that a device holds."""
    usual = fleet.heads / fleet.devices
    rooms = [max(round(room * usual), 1) for room in ROOMS]
    return {held: compare(replace(fleet, held=held), count, seed) for held in rooms}


def plot(outcomes: Mapping[int, list[Outcome]]) -> Figure:
    """Two planes side by side: share of requests that miss, and 99th percentile of the wait."""
    figure = Figure(figsize=(11.5, 4.6), dpi=100, layout="constrained")
    missed, waited = figure.subplots(1, 2)
    _lines(missed, outcomes, lambda one: 100.0 * (1.0 - one.hits), 0.001)
    _lines(waited, outcomes, lambda one: one.p99, _SHORTEST)
    missed.set_ylabel("requests that load a head, %")
    waited.set_ylabel("99th percentile of the wait, s")
    handles, names = missed.get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=3, frameon=False)
    return figure


def _lines(
    axes: Axes,
    outcomes: Mapping[int, list[Outcome]],
    of: Callable[[Outcome], float],
    least: float,
) -> None:
    held = sorted(outcomes)
    for index, first in enumerate(outcomes[held[0]]):
        values = [max(of(outcomes[room][index]), least) for room in held]
        line = "--" if index == 0 else "-"  # the naive one lies under another
        axes.plot(held, values, line, marker=_MARKS[index], label=first.policy, zorder=5 - index)
    axes.set(yscale="log", xlabel="heads that a device holds", xticks=held)
    axes.yaxis.set_major_formatter("{x:g}")
    axes.grid(alpha=0.4)
    axes.spines[["top", "right"]].set_visible(False)
