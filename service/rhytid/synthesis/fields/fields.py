"""Properties of the skin by place, as synthesis uses them; here the same everywhere."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Factors = NDArray[np.float32]


class Fields:
    """Even skin; subclasses vary it by place.

    Every method takes the triangle (N,) and uv (N, 2) of points and answers (N,) float32. Methods
    are called with some millions of points at a time, always the same in the same order.

    least_spacing, most_spacing: what `spacing` keeps within, above 0. Pores stand apart by the
    radius times the mean of both factors.  detail: UV length within which spacing and bareness
    hardly change.  some_bare: whether `bare` is true anywhere.  some_contrast: whether
    `contrast` differs from 1 anywhere.  usual_pore_radius: what
    `pore_radius` is where nothing is painted.
    """

    least_spacing = 1.0
    most_spacing = 1.0
    detail = float("inf")
    some_bare = False
    some_contrast = False
    usual_pore_radius = 1.0

    def spacing(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Factor of the distance between pores."""
        return np.ones(len(triangle), np.float32)

    def bare(self, triangle: NDArray[Any], uv: NDArray[Any]) -> NDArray[np.bool_]:
        """Where there are no pores."""
        return np.zeros(len(triangle), np.bool_)

    def strength(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Factor of the weight of wrinkles; weights stay within (0, 1]."""
        return np.ones(len(triangle), np.float32)

    def pore_strength(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Factor of the weight of pores."""
        return self.strength(triangle, uv)

    def contrast(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Power of the weight of wrinkles, before it is multiplied; asked for where `some_contrast`
        is true."""
        return np.ones(len(triangle), np.float32)

    def primary(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Factor of the strength of primary lines."""
        return np.ones(len(triangle), np.float32)

    def turn(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Radians by which the preferred direction turns left, seen from outside."""
        return np.zeros(len(triangle), np.float32)

    def bend(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Factor of how far lines wind about the preferred direction."""
        return np.ones(len(triangle), np.float32)

    def anisotropy(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """How far walkers follow preferred directions: 1 as usual, 0 not at all; above 1 the second
        family of lines turns towards the first, until at 2 both are one."""
        return np.ones(len(triangle), np.float32)

    def width(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Factor of the width of wrinkles."""
        return np.ones(len(triangle), np.float32)

    def grain(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Factor of the micro relief between lines."""
        return np.ones(len(triangle), np.float32)

    def pore_radius(self, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """Factor of the radius of pores."""
        return np.ones(len(triangle), np.float32)
