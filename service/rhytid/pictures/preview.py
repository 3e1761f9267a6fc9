"""A sheet of the skin of a graph: whole maps, and patches as they lie on the surface."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from rhytid.pictures.crops import surface_crop
from rhytid.pictures.legends import marked, scale_bar
from rhytid.pictures.places import Place
from rhytid.pictures.relief import relief
from rhytid.pictures.sheet import Panel, sheet

# Texels and pixels a side.
WHOLE, PATCH = 512, 720
# Means over many texels have little relief left.
_EXAGGERATION = 10.0
_MARK = (178, 32, 32)


@dataclass(frozen=True, eq=False)
class WholeMap:
    """heights (WHOLE, WHOLE) of a UDIM, mesh units.  side: mesh units that UV 1 is long there, on
    average."""

    udim: int
    heights: NDArray[Any]
    side: float


@dataclass(frozen=True, eq=False)
class Patch:
    """A square of `side` mesh units around a place.

    place: in the UV of its UDIM.  heights: (S, S) a square of that UDIM's map which holds the
    patch.  corner: (2,) uv of its lower left corner.  texel: uv between two texels.
    """

    name: str
    udim: int
    place: Place
    side: float
    heights: NDArray[Any]
    corner: NDArray[np.float64]
    texel: float

    def own(self) -> Place:
        """The place in a UV that goes from 0 to 1 over the heights."""
        share = 1.0 / (self.texel * len(self.heights))
        uv = (self.place.uv - self.corner) * share
        return replace(self.place, uv=uv, to_uv=self.place.to_uv * share)


def preview(
    maps: Sequence[WholeMap], patches: Sequence[Patch], unit_mm: float, caption: str
) -> Image.Image:
    """Whole maps in one row, their relief exaggerated, and patches below at true scale.

    unit_mm: millimetres in a mesh unit.
    """
    whole = [Panel(f"UDIM {m.udim}", _whole(m, patches)) for m in maps]
    near = [Panel(f"{p.name}: {p.side * unit_mm:.3g} mm", _patch(p, unit_mm)) for p in patches]
    return sheet([row for row in (whole, near) if row], caption)


def _whole(map: WholeMap, patches: Sequence[Patch]) -> Any:
    picture = relief(map.heights, map.side / len(map.heights), exaggeration=_EXAGGERATION)
    size = len(map.heights)
    inside = [p for p in patches if p.udim == map.udim]
    boxes = [
        (p.place.uv * [size, -size] + [0, size], size * p.side / map.side, p.name, _MARK)
        for p in inside
    ]
    return marked(picture, boxes)


def _patch(patch: Patch, unit_mm: float) -> Any:
    heights = surface_crop(patch.heights, patch.own(), patch.side, PATCH, deformed=False)
    picture = relief(heights, patch.side / PATCH)
    length = _round(0.3 * patch.side * unit_mm)
    pixels = length / unit_mm * PATCH / patch.side
    return scale_bar(picture, pixels, f"{length:g} mm")


def _round(most: float) -> float:
    """The largest of 1, 2, 5, 10, 20 … that is no more than `most`."""
    tens = 10.0 ** math.floor(math.log10(most))
    return max(step * tens for step in (1, 2, 5) if step * tens <= most)
