"""Previews of the skin of a graph: a sheet of whole maps and of patches as they lie on the surface,
a view of each region of a face, and the folds on the shaded face.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from rhytid.domain.expressions import Folds
from rhytid.domain.skin import REGIONS
from rhytid.pictures.raster import View, shade_mesh, vertex_normals
from rhytid.pictures.relief import relief
from rhytid.pictures.sheet import Panel, marked, scale_bar, sheet
from rhytid.pictures.surface_patch import Frame, SurfacePatch, surface_patch

# Texels and pixels per side.
WHOLE, PATCH = 512, 720
# Degrees over the surface: as skin is looked at, and grazing.
LIGHTS = (45.0, 15.0)
# Means over many texels have little relief left.
_EXAGGERATION = 10.0
_MARK = (178, 32, 32)
# Where the patch of a region may lie: at this part of its largest share or more.
_REGION_INSIDE = 0.85
# Triangles that are rated, at most.
_MOST_RATED = 400
# So many of the best are drawn, at so many pixels per side.
_BEST, _COARSE = 40, 24
# Regions that are known by their folds.
_FOLDING = ("forehead", "eye_corner", "lip")
# Weight of skin without folds, where skin that folds most has 1.
_UNFOLDED_WEIGHT = 0.15
# Pixels between two strokes, and along the longest of them.
_STROKE_SPACING, _STROKE_LENGTH = 9.0, 17.0
# Root mean square log compression that is drawn in the strongest colour.
_STRONGEST_FOLD = 0.12
_FOLD_SUPERSAMPLING = 2
_FAINT_FOLD, _STRONG_FOLD = np.array([70.0, 90.0, 190.0]), np.array([200.0, 20.0, 20.0])


@dataclass(frozen=True, eq=False)
class WholeMap:
    """The map of a UDIM for a preview.

    heights: (WHOLE, WHOLE), mesh units.  side: length of a UV step of 1 on the surface, on average,
    mesh units.
    """

    udim: int
    heights: NDArray[Any]
    side: float


@dataclass(frozen=True, eq=False)
class Patch:
    """A square of `side` mesh units around a place.

    uv: (2,) of the place in its UDIM.  surface: (PATCH, PATCH) pixels on the mesh.  heights: (R, R)
    the map of that UDIM, valid at least where the patch reads it.
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
    """A sheet of whole maps in one row, their relief exaggerated, and of patches below at true
    scale, each row of these under one light of LIGHTS.

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
    """The panel of a patch so many millimetres wide, with a bar that shows its scale."""
    length = _round(0.3 * millimetres)
    pixels = length * len(surface.uv) / millimetres
    return Panel(title, scale_bar(surface.picture(heights, light), pixels, f"{length:g} mm"))


def _round(most: float) -> float:
    """The largest of 1, 2, 5, 10, 20 … that is no more than `most`."""
    tens = 10.0 ** math.floor(math.log10(most))
    return max(step * tens for step in (1, 2, 5) if step * tens <= most)


@dataclass(frozen=True, eq=False)
class RegionView:
    """A square patch of a region, seen along the normal of its middle.

    triangle: the number of the one in the middle.
    """

    region: str
    triangle: int
    surface: SurfacePatch

    @property
    def scale(self) -> float:
        """UV steps in a mesh unit at the middle, the mean of both directions."""
        by_uv = self.surface.by_uv[self.surface.seen.triangle[tuple(_middle(self.surface))]]
        return float(np.sqrt(abs(np.linalg.det(by_uv))))


def region_views(
    corners: NDArray[Any],
    triangle_uv: NDArray[Any],
    masks: Mapping[str, NDArray[Any]],
    folds: NDArray[Any],
    side: float,
    pixels: int,
) -> list[RegionView]:
    """One view for each region that a mask shows, in the order of `REGIONS`.

    corners: (F, 3, 3).  triangle_uv: (F, 3, 2) local to the UDIM.  masks: (F,) shares from 0 to 1,
    by region.  folds: (F,) how far skin folds in one direction.  side: of a patch, mesh units.
    pixels: per side of a view.
    """
    views = []
    for region in (name for name in REGIONS if name in masks):
        weight = np.asarray(masks[region], np.float64)
        if region in _FOLDING:
            weight = weight * (_UNFOLDED_WEIGHT + folds / max(float(folds.max()), 1e-30))
        if weight.max() <= 0.0:
            continue
        best = _best_triangles(np.asarray(corners, np.float64), weight, side)
        seen = [
            _patch_around(corners, triangle_uv, t, side, _COARSE).seen.covered.mean() for t in best
        ]
        # The best one that no rim of the mesh cuts, else the one that is cut least.
        triangle = int(best[int(np.argmax(np.round(seen, 1)))])
        surface = _patch_around(corners, triangle_uv, triangle, side, pixels)
        views.append(RegionView(region, triangle, surface))
    return views


def _patch_around(
    corners: NDArray[Any], triangle_uv: NDArray[Any], triangle: int, side: float, pixels: int
) -> SurfacePatch:
    return surface_patch(corners, triangle_uv, Frame.of(corners[triangle]), side, pixels)


def _best_triangles(
    corners: NDArray[np.float64], weight: NDArray[np.float64], side: float
) -> NDArray[np.intp]:
    """Triangles around which a patch has much weight and is flat, the best first."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    centre = corners.mean(axis=1)
    area = np.linalg.norm(normal, axis=1)
    inside = np.flatnonzero((weight >= _REGION_INSIDE * np.percentile(weight, 99.5)) & (area > 0))
    chosen = inside[:: max(1, len(inside) // _MOST_RATED)]
    score, around = np.empty(len(chosen)), np.empty(len(chosen))
    for i, triangle in enumerate(chosen):
        near = np.sum((centre - centre[triangle]) ** 2, axis=1) <= (0.7 * side) ** 2
        near[triangle] = True
        flat = np.linalg.norm(normal[near].sum(axis=0)) / area[near].sum()
        score[i] = flat**8 * np.average(weight[near], weights=area[near])
        around[i] = area[near].sum()
    # Half a patch at a rim is flatter than a whole one.
    score *= np.minimum(around / np.percentile(around, 80), 1.0) ** 2
    found: NDArray[np.intp] = chosen[np.argsort(-score, kind="stable")][:_BEST]
    return found


def _middle(surface: SurfacePatch) -> NDArray[np.intp]:
    """Row and column of the covered pixel nearest to the middle."""
    covered = np.argwhere(surface.seen.covered)
    found: NDArray[np.intp] = covered[np.argmin(((covered - len(surface.uv) / 2) ** 2).sum(axis=1))]
    return found


def fold_picture(
    positions: NDArray[Any], faces: NDArray[Any], folds: Folds, size: int = 1024
) -> Image.Image:
    """The mesh seen from +z with strokes along the lines that folds prefer: long and red where skin
    folds much, short and blue where it hardly does.

    positions: (V, 3).  faces: (F, 3).  size: pixels per side.
    """
    view = View.around(positions)
    clay = Image.fromarray(shade_mesh(positions, faces, size, view))
    image = Image.blend(clay, Image.new("RGB", clay.size, (255, 255, 255)), 0.45)
    image = image.resize(
        (size * _FOLD_SUPERSAMPLING, size * _FOLD_SUPERSAMPLING), Image.Resampling.BICUBIC
    )
    canvas = ImageDraw.Draw(image)
    strength, eccentricity, axis = folds.axes()
    normal = vertex_normals(positions, faces)
    lines = np.cross(normal, axis)[:, :2] * (1, -1)
    share = np.minimum(strength / _STRONGEST_FOLD, 1.0)
    pixels = view.pixels(positions, size * _FOLD_SUPERSAMPLING)
    for i in _spaced_vertices(pixels, positions, normal):
        half = lines[i] * _FOLD_SUPERSAMPLING * _STROKE_LENGTH * (0.15 + 0.35 * np.sqrt(share[i]))
        half *= 0.3 + 0.7 * eccentricity[i] ** 0.5
        colour = (_FAINT_FOLD + (_STRONG_FOLD - _FAINT_FOLD) * share[i]).astype(int)
        ends = [tuple(pixels[i] - half), tuple(pixels[i] + half)]
        canvas.line(
            ends, fill=tuple(colour), width=_FOLD_SUPERSAMPLING * (2 if share[i] > 0.25 else 1)
        )
    return image.resize((size, size), Image.Resampling.LANCZOS)


def _spaced_vertices(
    pixels: NDArray[np.float64], positions: NDArray[Any], normal: NDArray[np.float64]
) -> NDArray[np.intp]:
    """Vertices that face the viewer, the nearest one of each cell of the picture."""
    seen = np.flatnonzero(normal[:, 2] > 0.08)
    seen = seen[np.argsort(-np.asarray(positions, np.float64)[seen, 2], kind="stable")]
    cells = np.floor(pixels[seen] / (_FOLD_SUPERSAMPLING * _STROKE_SPACING)).astype(np.int64)
    first = np.unique(cells, axis=0, return_index=True)[1]
    found: NDArray[np.intp] = seen[first]
    return found
