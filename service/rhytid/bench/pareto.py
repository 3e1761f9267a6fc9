"""The accuracy study as a picture: error over time, the Pareto front drawn through it."""

from __future__ import annotations

from collections.abc import Sequence

from PIL import Image

from rhytid.bench.accuracy import Accuracy, front
from rhytid.domain.asset_settings import BinSettings
from rhytid.pictures.scatter import Point, scatter


def pareto(found: Sequence[Accuracy]) -> Image.Image:
    """Mean relative rms over blending time; colours tell the merge and the depth."""
    best = front(found)
    points = [
        Point(one.map_copies, 100 * one.error, _series(one.bins), short(one.bins), one in best)
        for one in found
    ]
    return scatter(
        points, "blending time, map copies", "rms of binned - redraw over rms of redraw, %"
    )


def short(bins: BinSettings) -> str:
    """A choice of bins in a few letters; the colour tells the rest."""
    return f"N {bins.count}, M {bins.samples}, {bins.bits} bit"


def _series(bins: BinSettings) -> str:
    factored = "depth factored" if bins.depth_factored else "depth drawn"
    return f"merge {bins.merge}, {factored}"
