"""Lines where skin folds: the field of `Folds` at points of a surface, and what it makes of lines.

Preferred lines run across the axis along which skin is compressed most. Where it is compressed
often and far they are strong, keep to one direction and are led by primary lines; where it is not,
pores lead and lines cross each other faintly. Every weight is a smooth function of the field at a
place, against absolute scales: what folds one place changes no other.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.expressions import Folds, axes_of, form
from rhytid.domain.mesh import Mesh
from rhytid.domain.skin import USUAL_AGE, fold_factor_log
from rhytid.support import cancellation
from rhytid.synthesis.fields import Factors, level_directions
from rhytid.synthesis.progress import row_blocks
from rhytid.synthesis.surface import FloatArray, Surface, cross, unit

ComplexArray = NDArray[np.complex128]
# (5, F): what a value at the corners of a triangle is at (u, v), as slopes along both and at the
# origin; and the least and the most at its corners.
Planes = NDArray[np.float64]
# Points at a time: what is computed on the way stays in the cache.
_ROWS = 8192
# Root mean square log compression that counts as strong folding: three quarters of the largest
# possible.
FOLDED = 0.10
# Shares of what can be, and eccentricities, from which on the direction of the field is certain.
_CERTAIN, _ECCENTRIC = 0.16, 0.2
# Strength of lines where skin never folds, and where it folds most; the same of primary lines.
_FAINT, _DEEP, _POWER = 0.62, 1.5, 0.8
_FAINT_PRIMARY, _DEEP_PRIMARY = 0.55, 1.6
# Shares of what can be between which skin begins to have leaders, and the same of eccentricities.
_LEADS, _ONE_WAY = (0.06, 0.4), (0.0, 0.12)
# The same of those that are level whatever else folds, and how far skin folds across them then,
# of the most in any direction.
_LEVEL, _ACROSS = (0.05, 0.22), (0.65, 0.95)
# Where leaders lead, the lines between them cross each other: how far these keep to a direction,
# how far they go there from what they would be, and what primary lines lose, at rank 1.
_BETWEEN, _LOOSENED, _LED = 0.7, 0.8, 0.6
# How much age changes skin that folds.
AGEING = ("strength", "width", "primary")
# Log compressions between which skin begins to have fans at the corners of the mouth, by an open
# jaw alone; and eccentricities, for elsewhere the way of its folds is not that of rays.
_FANNED, _ALIKE = (0.08, 0.2), (0.1, 0.3)
# How far lines keep to a direction that nothing folds: a criss-cross.
_LOOSE = 0.44
# Expressions that fold a face in all its ways. Of each that is missing it is assumed that it folds
# a place so far, root mean square log compression, and alike in all directions.
_ALL, _UNSEEN = 40, 0.04


class FoldField:
    """The folds of a mesh at points of its surface.

    regions: names of the masks that come with the folds.  detail: UV length within which a mask
    changes little.  age: of the skin, years.  rank: how far its lines come in orders.  cautious:
    whether a few expressions say less of the direction of lines than many.
    """

    def __init__(
        self,
        mesh: Mesh,
        surface: Surface,
        folds: Folds,
        age: float = USUAL_AGE,
        rank: float = 0.0,
        cautious: bool = False,
    ) -> None:
        self._surface, self._faces, self._tensor = surface, mesh.faces, folds.tensor
        self._masks, self.regions = folds.regions, tuple(folds.regions)
        size, eccentricity, _ = folds.axes()
        share = np.tanh(size / FOLDED)
        told = share
        if cautious:
            size, eccentricity = _with_unseen(size, eccentricity, folds.moving)
            told = np.tanh(size / FOLDED)
        one_way = _ramp(eccentricity / _ECCENTRIC)
        certainty = _ramp(told / _CERTAIN) * one_way
        hold = eccentricity * np.minimum(2.0 * told, 1.0)
        found = {
            "strength": _FAINT + (_DEEP - _FAINT) * share**_POWER,
            "anisotropy": np.minimum((_LOOSE + hold) * (1.0 + certainty), 2.0),
            "primary": _FAINT_PRIMARY + (_DEEP_PRIMARY - _FAINT_PRIMARY) * share,
        }
        known = {n: np.where(f < 1.0, 1.0 - folds.known * (1.0 - f), f) for n, f in found.items()}
        known |= {"width": np.ones(len(share))}
        leading = _ramp(_within(share, _LEADS)) * _ramp(_within(eccentricity, _ONE_WAY))
        if rank > 0:
            led = min(rank, 1.0) * leading
            loose = np.minimum(_BETWEEN - known["anisotropy"], 0.0)
            known["anisotropy"] = known["anisotropy"] + _LOOSENED * led * loose
            known["primary"] = known["primary"] * (1.0 - _LED * led)
        for name in AGEING if age != USUAL_AGE else ():
            known[name] = known[name] * np.exp(fold_factor_log(name, age) * share)
        self._certainty = certainty.astype(np.float32)
        level = self._across_level()
        crossing = _ramp(_within(level / np.maximum(folds.axes()[0], 1e-12), _ACROSS))
        crossing *= _ramp(_within(np.tanh(level / FOLDED), _LEVEL))
        frown = np.zeros(len(share)) if folds.frown is None else folds.frown.astype(np.float64)
        # What a raise folds level where a frown folds upright would cross its two lines.
        crossing *= 1.0 - np.abs(frown)
        known |= {"certainty": certainty, "leading": leading, "crossing": crossing}
        known["frown"] = frown
        self._fans = folds.fans
        known["fans"] = np.zeros(len(share))
        if folds.fans is not None:
            largest, one_way, _ = axes_of(folds.fans)
            known["fans"] = _ramp(_within(largest, _FANNED)) * _ramp(_within(one_way, _ALIKE))
        known["crumpled"] = _ramp(told / _CERTAIN) * (1.0 - one_way**2)
        self._planes = {n: self._planes_of(v) for n, v in known.items()}
        used = np.flatnonzero(surface.carries)
        extent = np.ptp(surface.uv[used], axis=1).max(axis=1)
        self.detail = float(np.median(extent)) if folds.regions else float("inf")

    def factor(self, name: str, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """(N,) a property of lines by its name: the factor of their `strength`, `anisotropy` or
        `width`, that of `primary` lines; or, from 0 to 1, the `certainty` of their direction, or
        how far they have leaders (`leading`), or long level ones (`crossing`), or fold without
        one direction (`crumpled`), or have a fan at a corner of the mouth (`fans`), or lie on a
        crest of the `frown`, below 0 on the right one."""
        return self.at(self._planes[name], triangle, uv)

    def mixed(self, values: Mapping[str, float], base: float) -> Planes:
        """Values of regions, mixed by their masks; `base` where the masks leave something."""
        masks = {region: self._masks[region].astype(np.float64) for region in values}
        total: FloatArray = np.sum(list(masks.values()), axis=0)
        found = np.maximum(1.0 - total, 0.0) * base
        for region, mask in masks.items():
            found += mask / np.maximum(total, 1.0) * values[region]
        return self._planes_of(found)

    def at(self, planes: Planes, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """(N,) values at points, kept within those of the corners also where a point lies
        outside."""
        cancellation.check()
        found = np.empty(len(triangle), np.float32)
        for start in range(0, len(triangle), _ROWS):
            rows = slice(start, start + _ROWS)
            at = triangle[rows].astype(np.intp)
            along, across, value, least, most = (plane.take(at) for plane in planes)
            along *= uv[rows, 0]
            across *= uv[rows, 1]
            along += across
            value += along
            np.maximum(value, least, out=value)
            np.minimum(value, most, out=value)
            found[rows] = value
        return found

    def blended_with(self, other: Factors, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """(N,) radians to the left from the level direction to the lines of the field; where these
        are not certain, to their mean with `other` (N,), both taken as axes."""
        turn = np.empty_like(other)
        for rows in row_blocks(len(other)):
            at, where = triangle[rows], uv[rows]
            share = _places(self._surface, at, where)
            certainty = np.einsum("nc,nc->n", share, self._certainty[self._faces[at]])
            both = certainty * self._axis(self._tensor, at, share) + (1.0 - certainty) * np.exp(
                2j * other[rows]
            )
            turn[rows] = 0.5 * np.angle(both)
        return turn

    def fanned(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """(N,) radians to the left from the level direction to the lines of a fan."""
        turn = np.zeros(len(triangle), np.float32)
        if self._fans is None:
            return turn
        for rows in row_blocks(len(turn)):
            share = _places(self._surface, triangle[rows], uv[rows])
            axis: Any = self._axis(self._fans, triangle[rows], share)
            turn[rows] = 0.5 * np.angle(axis)
        return turn

    def _axis(
        self, folds: NDArray[np.float32], triangle: NDArray[Any], share: FloatArray
    ) -> ComplexArray:
        """(N,) e^2iθ of lines at an angle θ to the level direction: a right angle from the axis of
        the largest compression in the tangent plane."""
        normal = unit(np.einsum("nc,ncx->nx", share, self._surface.normals[triangle]))
        level = level_directions(normal)
        beside = np.cross(normal, level)
        tensor = np.einsum("nc,nck->nk", share, folds[self._faces[triangle]])
        along, across, mixed = (
            form(tensor, *pair) for pair in ((level, level), (beside, beside), (level, beside))
        )
        twice: ComplexArray = (across - along) - 2j * mixed
        axis: ComplexArray = twice / np.maximum(np.abs(twice), 1e-30)
        return axis

    def _across_level(self) -> FloatArray:
        """(V,) root mean square log compression across the level direction."""
        normal = np.zeros((len(self._tensor), 3))
        normal[self._faces] = self._surface.normals
        beside = np.cross(normal, level_directions(normal))
        found: FloatArray = np.sqrt(
            np.maximum(form(self._tensor.astype(np.float64), beside, beside), 0.0)
        )
        return found

    def _planes_of(self, values: FloatArray) -> Planes:
        """The planes of values at vertices (V,)."""
        corners, uv = values[self._faces], self._surface.uv
        one, two = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
        area = cross(one, two)
        area = np.where(area == 0, np.inf, area)
        rise = corners[:, 1:] - corners[:, :1]
        planes = np.empty((5, len(corners)))
        planes[0] = (rise[:, 0] * two[:, 1] - rise[:, 1] * one[:, 1]) / area
        planes[1] = (rise[:, 1] * one[:, 0] - rise[:, 0] * two[:, 0]) / area
        planes[2] = corners[:, 0] - (planes[0] * uv[:, 0, 0] + planes[1] * uv[:, 0, 1])
        planes[3], planes[4] = corners.min(axis=1), corners.max(axis=1)
        return planes


def _with_unseen(
    size: FloatArray, eccentricity: FloatArray, moving: int
) -> tuple[FloatArray, FloatArray]:
    """Size and eccentricity of folds as they tell directions, of so many expressions that move
    anything.

    A mean over few expressions is large wherever one of them folds, and has the one axis of that.
    The size is that of a mean over all; what the missing ones fold makes it rounder.
    """
    seen = min(moving / _ALL, 1.0)
    unseen = (1.0 - seen) * _UNSEEN**2
    one, two = (np.sqrt(root**2 + unseen) for root in (size, size * (1.0 - eccentricity)))
    return size * np.sqrt(seen), 1.0 - two / np.maximum(one, 1e-12)


def _places(surface: Surface, triangle: NDArray[Any], uv: NDArray[Any]) -> FloatArray:
    """(N, 3) shares of the corners at uv (N, 2), none below 0."""
    share = surface.barycentric(triangle, uv)
    np.maximum(share, 0.0, out=share)
    share /= share.sum(axis=1, keepdims=True)
    return share


def _within(value: FloatArray, span: tuple[float, float]) -> FloatArray:
    """0 at the start of a span, 1 at its end."""
    return (value - span[0]) / (span[1] - span[0])


def _ramp(value: FloatArray) -> FloatArray:
    """Smoothly from 0 to 1."""
    x = np.clip(value, 0.0, 1.0)
    ramp: FloatArray = x * x * (3.0 - 2.0 * x)
    return ramp
