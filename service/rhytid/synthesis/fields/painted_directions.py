"""Directions painted in UV, as angles on the surface."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.painted_maps import Map, Shares, shares
from rhytid.synthesis.arrays import row_blocks
from rhytid.synthesis.fields.directions import level_directions
from rhytid.synthesis.fields.fields import Factors
from rhytid.synthesis.fields.lookup import Lookup
from rhytid.synthesis.seams.charts import cross
from rhytid.synthesis.surface import FloatArray, Surface, unit


class PaintedDirections:
    """Axes by UDIM: grey g > 0 is the angle πg in UV, counterclockwise; black is none.

    Between texels cosine and sine of twice the angle, 0 where there is none, are interpolated.
    """

    def __init__(self, surface: Surface, maps: Mapping[int, Map]) -> None:
        self._surface = surface
        self._cosine, self._sine = (
            Lookup(surface, maps, partial(_part, part)) for part in (np.cos, np.sin)
        )

    def sure(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """(N,) 1 where there is one, 0 where there is none, between them where it fades."""
        found: Factors = np.minimum(np.hypot(*self._axis(triangle, uv)), np.float32(1.0))
        return found

    def instead_of(self, other: Factors, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """(N,) radians to the left from the level direction to the painted one; where it fades, to
        a mean with `other`, both as axes."""
        cosine, sine = self._axis(triangle, uv)
        there = np.flatnonzero((cosine != 0) | (sine != 0))
        angle = 0.5 * np.arctan2(sine, cosine)[there].astype(np.float64)
        painted = self._turn(angle, triangle[there], uv[there])
        sure = np.minimum(np.hypot(cosine, sine)[there], 1.0)
        both = sure * np.exp(2j * painted) + (1.0 - sure) * np.exp(2j * other[there])
        turn: Factors = other.copy()
        turn[there] = 0.5 * np.angle(both)
        return turn

    def _axis(self, triangle: NDArray[Any], uv: NDArray[Any]) -> tuple[Shares, Shares]:
        cosine = self._cosine.at(triangle, uv, neutral=0.0)
        return cosine, self._sine.at(triangle, uv, neutral=0.0)

    def _turn(self, angle: FloatArray, triangle: NDArray[Any], uv: NDArray[Any]) -> FloatArray:
        """Of angles in UV, on the surface."""
        way = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        along = self._surface.along(triangle, way)
        normal = points_to_normals(self._surface, triangle, uv)
        level = level_directions(normal)
        beside = np.cross(normal, level)
        found: FloatArray = np.arctan2((along * beside).sum(-1), (along * level).sum(-1))
        return found


def _part(part: Any, texels: Map) -> Shares:
    angle = np.float32(2.0 * np.pi) * shares(texels)
    found: Shares = np.where(texels > 0, part(angle), np.float32(0.0))
    return found


def points_to_normals(surface: Surface, triangle: NDArray[Any], uv: NDArray[Any]) -> FloatArray:
    """(N, 3) unit normals at uv (N, 2), interpolated from the corners of their triangles."""
    normals = np.empty((len(triangle), 3))
    for rows in row_blocks(len(triangle)):
        corners, at = surface.uv[triangle[rows]], uv[rows].astype(np.float64)
        one, two = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        offset, area = at - corners[:, 0], cross(one, two)
        s, t = cross(offset, two) / area, cross(one, offset) / area
        weights = np.stack([1.0 - s - t, s, t], axis=-1)
        normals[rows] = np.einsum("nc,ncx->nx", weights, surface.normals[triangle[rows]])
    return unit(normals)
