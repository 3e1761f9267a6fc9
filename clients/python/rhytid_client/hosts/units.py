"""Lengths: from the unit of a map to that of a scene."""

from __future__ import annotations

import re
from math import log
from typing import Any

from numpy.typing import NDArray

from rhytid_client.hosts.trouble import Trouble

# The units that the service knows, in millimetres.
MILLIMETRES = {
    **{"um": 0.001, "mm": 1.0, "cm": 10.0, "dm": 100.0, "m": 1000.0},
    **{"in": 25.4, "ft": 304.8},
}
# A face or a head, in millimetres, and the units that a mesh of it may be in.
_HEAD = 250.0
_GUESSED = ("mm", "cm", "m")
_COUNTED = re.compile(r" *([0-9]*\.?[0-9]+(?:[eE][+-]?[0-9]+)?) *([^\W\d_]+) *")


def factor(of_map: str, of_scene: str) -> float:
    """Units of the scene in one of the map; 1 where the map names none.

    Either is a name, or a number and a name, as `5.5cm`. Raises Trouble for a unit that is no
    length known here.
    """
    if not of_map:
        return 1.0
    return _millimetres(of_map) / _millimetres(of_scene)


def _millimetres(unit: str) -> float:
    counted = _COUNTED.fullmatch(unit)
    count, name = ("1", unit) if counted is None else counted.groups()
    known = MILLIMETRES.get(name.casefold().replace("μ", "u"))
    if known is None or not float(count) > 0:
        raise Trouble(f"Maps in {unit!r} have no known size: use one of {', '.join(MILLIMETRES)}")
    return float(count) * known


def guessed_unit(positions: NDArray[Any]) -> str:
    """The unit, of mm, cm and m, in which the longest side of (V, 3) is nearest to that of a head.

    Raises Trouble where all positions are one.
    """
    longest = float((positions.max(axis=0) - positions.min(axis=0)).max())
    if not longest > 0:
        raise Trouble("All vertices are at one place")
    return min(_GUESSED, key=lambda unit: abs(log(longest * MILLIMETRES[unit] / _HEAD)))
