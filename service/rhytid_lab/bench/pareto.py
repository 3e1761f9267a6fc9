"""The accuracy study as a picture: error over time, the Pareto front drawn through it."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from rhytid.domain.asset_settings import BinSettings
from rhytid_lab.bench.accuracy import Accuracy, front
from rhytid_lab.plots import Point, scatter


def pareto(found: Sequence[Accuracy]) -> Figure:
    """Mean relative rms over blending time; colours stand for merges."""
    best = front(found)
    points = [
        Point(
            one.map_copies, 100 * one.error, f"merge {one.bins.merge}", short(one.bins), one in best
        )
        for one in found
    ]
    return scatter(
        points, "blending time, map copies", "rms of binned - redraw over rms of redraw, %"
    )


def short(bins: BinSettings) -> str:
    """A choice of bins in a few letters; the colour shows the rest."""
    depth = ", factored" if bins.depth_factored else ""
    tilt = ", tilt" if bins.tilt else ""
    reach = f", reach {bins.reach:g}" if bins.reach > 1.0 else ""
    pores = f" pores {bins.pore_samples}" if bins.pore_samples else ""
    return f"N {bins.count}, M {bins.samples}{pores}, {bins.bits} bit{depth}{tilt}{reach}"
