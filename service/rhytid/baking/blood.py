"""Blood in skin over time: the area of skin with a lag, for the profile `blood`.

At a place of the surface, x is the log of the area of its triangles in a frame over that in the
neutral, and y follows it with a time constant: dy/dt = (x - y) / seconds, x constant from one frame
to the next. So y is a mean of x in which a frame weighs e times less for every `seconds` that it
lies back. Frames farther back than REACH time constants are left out: the last one within stands
for them. What y is in a frame depends on no frame after it and on no frame baked before, so frames
may be baked in any order, by any machine that can read those before.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.baking.frame_names import FramePlace, frame_numbers
from rhytid.baking.frames import FrameFiles
from rhytid.baking.request import Lag
from rhytid.domain.mesh import Mesh
from rhytid.exports.textures.frame_map import VertexField
from rhytid.exports.textures.stretch import MOST, area_sums

FloatArray = NDArray[np.float64]
# Time constants after which a frame is forgotten: it would weigh 0.0003.
REACH = 8.0


class BloodFlow:
    """The lagging areas of the frames of an animation. One thread uses it.

    Of the frames that count for the last one that was asked for it keeps a number for each place.
    """

    def __init__(self, mesh: Mesh, frames: FrameFiles, lag: Lag) -> None:
        self._mesh, self._frames, self._lag = mesh, frames, lag
        self._rest = area_sums(mesh, mesh.positions)
        self._kept: dict[FramePlace, _Measured] = {}

    def key(self, place: FramePlace) -> str:
        """16 hex digits that name all that the field of a frame is made of."""
        digest = hashlib.sha256(f"{self._lag}".encode())
        for number, one in self._measured(place):
            digest.update(f" {number} {one.digest}".encode())
        return digest.hexdigest()[:16]

    def field(self, place: FramePlace) -> VertexField:
        """(P, 1) at the places of the mesh: the lagging log of the ratio of areas."""
        (last, first), *rest = self._measured(place)
        late = first.area
        for number, one in rest:
            kept = self._lag.kept(number - last)
            late, last = one.area + kept * (late - one.area), number
        return VertexField(late[:, None], self._rest.places)

    def _measured(self, place: FramePlace) -> list[tuple[int, _Measured]]:
        """The frames that count for one, and their numbers, in ascending order."""
        window = counted_for(self._frames.places, place, self._lag)
        there = {one for _, one in window}
        self._kept = {one: found for one, found in self._kept.items() if one in there}
        for one in there - self._kept.keys():
            self._kept[one] = self._measure(one)
        return [(number, self._kept[one]) for number, one in window]

    def _measure(self, place: FramePlace) -> _Measured:
        positions = self._frames.read(place)
        digest = hashlib.sha256(np.ascontiguousarray(positions, "<f4").tobytes()).hexdigest()
        now, rest = area_sums(self._mesh, positions).values[:, 0], self._rest.values[:, 0]
        ratio = np.where(rest > 0.0, now / np.where(rest > 0.0, rest, 1.0), 1.0)
        return _Measured(np.log(ratio.clip(math.exp(-MOST), math.exp(MOST))), digest)


@dataclass(frozen=True, eq=False)
class _Measured:
    """area: (P,) log of the ratio to the neutral.  digest: of the positions."""

    area: FloatArray
    digest: str


def counted_for(
    all: Sequence[FramePlace], place: FramePlace, lag: Lag
) -> list[tuple[int, FramePlace]]:
    """The frames of an animation that count for one of them, itself last, with their numbers."""
    numbered = dict(zip(all, frame_numbers(all), strict=True))
    end = numbered[place]
    start = end - REACH * lag.frames
    near = [(number, one) for one, number in numbered.items() if start <= number <= end]
    return sorted(near, key=lambda pair: pair[0])
