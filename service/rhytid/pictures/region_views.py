"""Where each region of a face is looked at: its flattest patch, and where it folds if it does."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.regions import REGIONS
from rhytid.pictures.surface_patch import Frame, SurfacePatch, surface_patch

# Of the largest share of a region: where its patch may lie.
_INSIDE = 0.85
# Places that are looked at, at most.
_CANDIDATES = 400
# Of these so many are looked at closely, at so many pixels per side.
_LIKELY, _COARSE = 40, 24
# Regions that are known by their folds.
_FOLDING = ("forehead", "eye_corner", "lip")
# What nothing folds counts so much beside what folds most.
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
        liking = np.asarray(masks[region], np.float64)
        if region in _FOLDING:
            liking = liking * (_REST + folds / max(float(folds.max()), 1e-30))
        if liking.max() <= 0.0:
            continue
        likely = _likely(np.asarray(corners, np.float64), liking, side)
        seen = [_patch(corners, triangle_uv, t, side, _COARSE).seen.covered.mean() for t in likely]
        # The best one that no rim of the mesh cuts, else the one that is cut least.
        triangle = int(likely[int(np.argmax(np.round(seen, 1)))])
        surface = _patch(corners, triangle_uv, triangle, side, pixels)
        views.append(RegionView(region, triangle, surface))
    return views


def _patch(
    corners: NDArray[Any], triangle_uv: NDArray[Any], triangle: int, side: float, pixels: int
) -> SurfacePatch:
    return surface_patch(corners, triangle_uv, Frame.of(corners[triangle]), side, pixels)


def _likely(
    corners: NDArray[np.float64], liking: NDArray[np.float64], side: float
) -> NDArray[np.intp]:
    """Triangles around which a patch is liked and flat, the best first."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    centre = corners.mean(axis=1)
    area = np.linalg.norm(normal, axis=1)
    inside = np.flatnonzero((liking >= _INSIDE * np.percentile(liking, 99.5)) & (area > 0))
    chosen = inside[:: max(1, len(inside) // _CANDIDATES)]
    score, around = np.empty(len(chosen)), np.empty(len(chosen))
    for i, triangle in enumerate(chosen):
        near = np.sum((centre - centre[triangle]) ** 2, axis=1) <= (0.7 * side) ** 2
        near[triangle] = True
        flat = np.linalg.norm(normal[near].sum(axis=0)) / area[near].sum()
        score[i] = flat**8 * np.average(liking[near], weights=area[near])
        around[i] = area[near].sum()
    # Half a patch at a rim is flatter than a whole one.
    score *= np.minimum(around / np.percentile(around, 80), 1.0) ** 2
    found: NDArray[np.intp] = chosen[np.argsort(-score, kind="stable")][:_LIKELY]
    return found


def _middle(surface: SurfacePatch) -> NDArray[np.intp]:
    """Row and column of the covered pixel nearest to the middle."""
    covered = np.argwhere(surface.seen.covered)
    found: NDArray[np.intp] = covered[np.argmin(((covered - len(surface.uv) / 2) ** 2).sum(axis=1))]
    return found
