"""Shares of the lips up to the vermilion border, and of the mouth around them, from what
expressions move."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

FloatArray = NDArray[np.float64]
# What rolls in turns about the border of a lip: within this distance, in the length that smooths
# regions, the border moves about three quarters of what moves most.
_NEAR = 1.7
# That most is at least so much of what the roll moves anywhere: beyond the corners of the mouth it
# is no lip.
_LEAST_ROLL = 0.35
# Of the product of both, in a roll and in a pucker: where the lip begins and is whole. By eye on
# one face: at the borders of its middle it is 0.58 and 0.6.
_LIP = (0.50, 0.68)
# Without rolls: of the motion in a pucker.
_PUCKERED = (0.72, 0.9)
# Of the motion in a pucker and of an open jaw: where the mouth and the chin begin and are whole.
_MOUTH, _CHIN = (0.22, 0.5), (0.72, 0.86)


def lip_share(
    places: FloatArray, rolls: Sequence[FloatArray], pucker: FloatArray, length: float
) -> FloatArray:
    """(V,) how far vertices are red of a lip, 0 to 1.

    places: (V, 3) of the vertices.  rolls: (V,) how far each roll of a lip moves them.  pucker:
    (V,) the same of a pucker, as a share of its most.  length: that smooths regions, mesh units.
    """
    if not rolls:
        return ramp(pucker, *_PUCKERED)
    rolled = np.maximum.reduce([_of_most_near(places, roll, _NEAR * length) for roll in rolls])
    return ramp(rolled * pucker, *_LIP)


def mouth_share(pucker: FloatArray, jaw: FloatArray | None) -> FloatArray:
    """(V,) how far vertices are around the mouth or of the chin, 0 to 1; lips among them.

    pucker, jaw: (V,) how far a pucker and an opening jaw move them, as shares of their most.
    """
    found = ramp(pucker, *_MOUTH)
    return found if jaw is None else np.maximum(found, ramp(jaw, *_CHIN))


def ramp(value: FloatArray, begins: float, whole: float) -> FloatArray:
    """From 0 to 1, linear; `whole` may be below `begins`."""
    found: FloatArray = np.clip((value - begins) / (whole - begins), 0.0, 1.0)
    return found


def _of_most_near(places: FloatArray, motion: FloatArray, reach: float) -> FloatArray:
    """(V,) motion as a share of the most of what lies within `reach`."""
    least = _LEAST_ROLL * float(motion.max())
    found = motion / max(least, 1e-30)
    moved = np.flatnonzero(motion > 0.1 * least)
    tree = cKDTree(places[moved])
    near = tree.query_ball_point(places[moved], reach)
    most = np.array([motion[moved[rows]].max() for rows in near])
    found[moved] = motion[moved] / np.maximum(most, least)
    return found
