"""How wrinkles (Alg. 1) and pores (Alg. 2) answer to stretch."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from reference.inputs import Array

EPSILON = 1e-6
WIDEST = 4.0


def wrinkle_stretch(log_ratios: ArrayLike, axes: ArrayLike, direction: ArrayLike) -> Array:
    """r (...) of Alg. 1: the log stretches, each weighted by how far its axis is from θ.

    log_ratios: (..., 2), clamped.  axes: (..., 2, 2).  direction: (..., 2), unit θ.
    """
    direction = np.asarray(direction, np.float64)
    d = 1.0 - np.abs((np.asarray(axes, np.float64) * direction[..., None, :]).sum(-1))
    r: Array = (d * np.asarray(log_ratios, np.float64)).sum(-1) / (d.sum(-1) + EPSILON)
    return r


def on_surface(jacobian: ArrayLike, vectors: ArrayLike) -> Array:
    """Unit vectors Jx/|Jx| in the neutral tangent plane: what `angles: "surface"` compares.

    jacobian: (..., 2, 2), from UV to the plane.  vectors: (..., 2), broadcast against it.
    """
    turned = np.einsum("...ij,...j->...i", np.asarray(jacobian), np.asarray(vectors))
    surface: Array = turned / np.linalg.norm(turned, axis=-1, keepdims=True)
    return surface


def pore_stretch(log_ratios: ArrayLike) -> Array:
    """r (...) of Alg. 2: the mean of the two log stretches (..., 2)."""
    r: Array = np.asarray(log_ratios, np.float64).mean(axis=-1)
    return r


def scales(r: ArrayLike, width: float, depth: float) -> tuple[Array, Array]:
    """σ_w = exp(r)^width and σ_d = exp(r)^-depth, both clamped to [1/4, 4]."""
    r = np.asarray(r, np.float64)
    most = np.log(WIDEST)
    return np.exp(np.clip(width * r, -most, most)), np.exp(np.clip(-depth * r, -most, most))
