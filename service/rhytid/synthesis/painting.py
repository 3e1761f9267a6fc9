"""Painted maps and directions at places of a surface."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.painted_maps import Map, Shares, bilinear, shares
from rhytid.domain.tiles import udim_origin
from rhytid.synthesis.fields import Factors, level_directions
from rhytid.synthesis.progress import row_blocks
from rhytid.synthesis.surface import FloatArray, Surface, unit

_MIDDLE = 0.5
# A point on the border of two UDIMs belongs to that of its triangle: so far it is pulled inwards.
_PULL = 1e-4


class PaintedDirections:
    """Painted axes by UDIM: grey g > 0 is the angle πg in UV, counterclockwise; black is none.

    Between texels, cosine and sine of twice the angle are interpolated; both are 0 for black.
    """

    def __init__(self, surface: Surface, maps: Mapping[int, Map]) -> None:
        self._surface = surface
        self._cosine, self._sine = (
            PaintedMaps(surface, maps, partial(_axis_part, part)) for part in (np.cos, np.sin)
        )

    def certainty(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """(N,) 1 where a direction is painted, 0 where none is, between the two where it fades."""
        found: Factors = np.minimum(np.hypot(*self._axis(triangle, uv)), np.float32(1.0))
        return found

    def blended_with(self, other: Factors, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """(N,) radians to the left from the level direction to the painted one; where that fades,
        to its mean with `other` (N,), both taken as axes."""
        cosine, sine = self._axis(triangle, uv)
        there = np.flatnonzero((cosine != 0) | (sine != 0))
        angle = 0.5 * np.arctan2(sine, cosine)[there].astype(np.float64)
        painted = self._turn(angle, triangle[there], uv[there])
        certainty = np.minimum(np.hypot(cosine, sine)[there], 1.0)
        both = certainty * np.exp(2j * painted) + (1.0 - certainty) * np.exp(2j * other[there])
        turn: Factors = other.copy()
        turn[there] = 0.5 * np.angle(both)
        return turn

    def _axis(self, triangle: NDArray[Any], uv: NDArray[Any]) -> tuple[Shares, Shares]:
        cosine = self._cosine.at(triangle, uv, neutral=0.0)
        return cosine, self._sine.at(triangle, uv, neutral=0.0)

    def _turn(self, angle: FloatArray, triangle: NDArray[Any], uv: NDArray[Any]) -> FloatArray:
        """(N,) angles in UV as radians to the left of the level direction on the surface."""
        way = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        along = self._surface.along(triangle, way)
        normal = normals_at(self._surface, triangle, uv)
        level = level_directions(normal)
        beside = np.cross(normal, level)
        found: FloatArray = np.arctan2((along * beside).sum(-1), (along * level).sum(-1))
        return found


def normals_at(surface: Surface, triangle: NDArray[Any], uv: NDArray[Any]) -> FloatArray:
    """(N, 3) unit normals at uv (N, 2), interpolated from the corners of their triangles."""
    normals = np.empty((len(triangle), 3))
    for rows in row_blocks(len(triangle)):
        shares = surface.barycentric(triangle[rows], uv[rows])
        normals[rows] = np.einsum("nc,ncx->nx", shares, surface.normals[triangle[rows]])
    return unit(normals)


def _axis_part(part: Any, texels: Map) -> Shares:
    angle = np.float32(2.0 * np.pi) * shares(texels)
    found: Shares = np.where(texels > 0, part(angle), np.float32(0.0))
    return found


class PaintedMaps:
    """The maps of one control by UDIM.

    least, most: of all values, those of UDIMs without a map among them.  detail: the UV length of
    the smallest texel.  meaning: from texels to values, `shares` unless it is given; it is applied
    at look-up, for in float32 maps may take four times the memory.
    """

    def __init__(
        self,
        surface: Surface,
        maps: Mapping[int, Map],
        meaning: Callable[[Map], Shares] = shares,
    ) -> None:
        self._maps, self._meaning = maps, meaning
        self._centres = surface.uv.mean(axis=1)
        values = [float(shares(f(map))) for map in maps.values() for f in (np.min, np.max)]
        self.least, self.most = min([_MIDDLE, *values]), max([_MIDDLE, *values])
        self.detail = min((1.0 / max(map.shape) for map in maps.values()), default=float("inf"))

    def at(self, triangle: NDArray[Any], uv: NDArray[Any], neutral: float = _MIDDLE) -> Shares:
        """(N,) values at uv (N, 2) in triangles (N,); `neutral` where the UDIM has no map."""
        found = np.full(len(triangle), neutral, np.float32)
        for rows in row_blocks(len(triangle)):
            corner = self._corners(triangle[rows], uv[rows])
            for udim, map in self._maps.items():
                there = np.flatnonzero((corner == udim_origin(udim)).all(axis=1))
                local = uv[rows][there].astype(np.float64) - udim_origin(udim)
                found[rows.start + there] = bilinear(map, local, self._meaning)
        return found

    def _corners(self, triangle: NDArray[Any], uv: NDArray[Any]) -> FloatArray:
        """(N, 2) origins of the UDIMs of points."""
        corner: FloatArray = np.floor(uv + _PULL * (self._centres[triangle] - uv))
        return corner
