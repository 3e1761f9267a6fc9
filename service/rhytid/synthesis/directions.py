"""Where skin lines like to run: a smooth field of directions, and smooth noise on the surface."""

from __future__ import annotations

import numpy as np

from rhytid.synthesis.surface import FloatArray, Points, unit

_WAVES = 24
# The field of a face looks along z with y up; this share of x keeps the top of a head from
# having no direction at all.
_UP, _RIGHT = np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])
_FALLBACK = 0.2
# Strength (radians) and size (pore spacings) of the waves that bend the lines.
_BEND = ((0.35, 60.0), (0.35, 12.0))


def smooth_noise(position: FloatArray, size: float, rng: np.random.Generator) -> FloatArray:
    """(N,) values of mean 0 and deviation 1 that change over about `size`: a sum of plane waves."""
    waves = rng.normal(size=(3, _WAVES)) / size
    phases = rng.uniform(0.0, 2.0 * np.pi, _WAVES)
    noise: FloatArray = np.cos(position @ waves + phases).sum(axis=1) * np.sqrt(2.0 / _WAVES)
    return noise


def level_directions(normal: FloatArray) -> FloatArray:
    """(N, 3) unit tangents around the vertical axis (y) where the surface has normals (N, 3)."""
    level = np.cross(_UP, normal) + _FALLBACK * _RIGHT
    level -= normal * np.einsum("nx,nx->n", level, normal)[:, None]
    return unit(level)


def preferred_directions(
    points: Points, spacing: float, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """(N, 3) unit tangents along the main lines, and those a right angle to the left.

    A plain stand-in for relaxed skin tension lines: level around the vertical axis (y), as on
    the forehead, the eyelids and the neck, bent by smooth noise at two sizes.
    """
    along = level_directions(points.normal)
    left = np.cross(points.normal, along)
    angle = sum(bend * smooth_noise(points.position, size * spacing, rng) for bend, size in _BEND)
    cosine, sine = np.cos(angle)[:, None], np.sin(angle)[:, None]
    return cosine * along + sine * left, cosine * left - sine * along
