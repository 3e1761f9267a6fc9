"""A view of each region of a face: its flattest patch, where it folds if it does."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.skin import REGIONS
from rhytid.pictures.surface_patch import Frame, SurfacePatch, surface_patch

# Where the patch of a region may lie: at this part of its largest share or more.
_INSIDE = 0.85
# Triangles that are rated, at most.
_CANDIDATES = 400
# Of these the best so many are drawn, at so many pixels per side.
_BEST, _COARSE = 40, 24
# Regions that are known by their folds.
_FOLDING = ("forehead", "eye_corner", "lip")
# Weight of skin without folds, where skin that folds most has 1.
_REST = 0.15


@dataclass(frozen=True, eq=False)
class RegionView:
    """A square patch of a region, seen along the normal of its middle.  triangle: there."""

    region: str
    triangle: int
    surface: SurfacePatch

    @property
    def scale(self) -> float:
        """UV to a mesh unit in the middle, the mean of both directions."""
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

    corners: (F, 3, 3).  triangle_uv: (F, 3, 2) local to the UDIM.  masks: (F,) shares from 0 to 1.
    folds: (F,) how far skin folds one way.  side: of a patch, mesh units.
    """
    views = []
    for region in (name for name in REGIONS if name in masks):
        weight = np.asarray(masks[region], np.float64)
        if region in _FOLDING:
            weight = weight * (_REST + folds / max(float(folds.max()), 1e-30))
        if weight.max() <= 0.0:
            continue
        best = _best_triangles(np.asarray(corners, np.float64), weight, side)
        seen = [_patch(corners, triangle_uv, t, side, _COARSE).seen.covered.mean() for t in best]
        # The best one that no rim of the mesh cuts, else the one that is cut least.
        triangle = int(best[int(np.argmax(np.round(seen, 1)))])
        surface = _patch(corners, triangle_uv, triangle, side, pixels)
        views.append(RegionView(region, triangle, surface))
    return views


def _patch(
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
    inside = np.flatnonzero((weight >= _INSIDE * np.percentile(weight, 99.5)) & (area > 0))
    chosen = inside[:: max(1, len(inside) // _CANDIDATES)]
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
