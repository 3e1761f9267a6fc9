"""A sheet of the skin of a graph: whole maps, and patches as they lie on the surface."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from rhytid.pictures.legends import marked, scale_bar
from rhytid.pictures.relief import relief
from rhytid.pictures.sheet import Panel, sheet
from rhytid.pictures.surface_patch import SurfacePatch

# Texels and pixels per side.
WHOLE, PATCH = 512, 720
# Degrees over the surface: as skin is looked at, and grazing.
LIGHTS = (45.0, 15.0)
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

    uv: (2,) of the place in its UDIM.  surface: (PATCH, PATCH) pixels on the mesh.  heights:
    (R, R) the map of that UDIM; right where the patch reads it.
    """

    name: str
    udim: int
    uv: NDArray[np.float64]
    side: float
    surface: SurfacePatch
    heights: NDArray[Any]


def preview(
    maps: Sequence[WholeMap], patches: Sequence[Patch], unit_mm: float, caption: str
) -> Image.Image:
    """Whole maps in one row, their relief exaggerated, and patches below at true scale, each row
    under one light of LIGHTS.

    unit_mm: millimetres in a mesh unit.
    """
    whole = [Panel(f"UDIM {m.udim}", _whole(m, patches)) for m in maps]
    near = [[_patch(p, light, unit_mm) for p in patches] for light in LIGHTS]
    return sheet([row for row in (whole, *near) if row], caption)


def _whole(map: WholeMap, patches: Sequence[Patch]) -> Any:
    picture = relief(map.heights, map.side / len(map.heights), exaggeration=_EXAGGERATION)
    size = len(map.heights)
    inside = [p for p in patches if p.udim == map.udim]
    boxes = [
        (p.uv * [size, -size] + [0, size], size * p.side / map.side, p.name, _MARK) for p in inside
    ]
    return marked(picture, boxes)


def _patch(patch: Patch, light: float, unit_mm: float) -> Panel:
    title = f"{patch.name}: {patch.side * unit_mm:.3g} mm, light at {light:g}°"
    return patch_panel(title, patch.surface, patch.heights, light, patch.side * unit_mm)


def patch_panel(
    title: str, surface: SurfacePatch, heights: NDArray[Any], light: float, millimetres: float
) -> Panel:
    """A patch so many millimetres wide, with a bar that shows its scale."""
    length = _round(0.3 * millimetres)
    pixels = length * len(surface.uv) / millimetres
    return Panel(title, scale_bar(surface.picture(heights, light), pixels, f"{length:g} mm"))


def _round(most: float) -> float:
    """The largest of 1, 2, 5, 10, 20 … that is no more than `most`."""
    tens = 10.0 ** math.floor(math.log10(most))
    return max(step * tens for step in (1, 2, 5) if step * tens <= most)
