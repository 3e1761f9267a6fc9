"""The neutral map blurred along stretched axes and sharpened along compressed ones (after Nagano
et al. 2015)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from reference.inputs import Array

MOST_TAPS = 63


def share(logs: ArrayLike, blur_gain: float, sharpen_gain: float) -> Array:
    """alpha of log stretch: blurs where positive, sharpens where negative."""
    r = np.asarray(logs, np.float64)
    clamped: Array = np.clip(np.where(r > 0, blur_gain, sharpen_gain) * r, -1.0, 1.0)
    return clamped


def deviation(jacobian: Array, axes: Array, sigma: float, resolution: int) -> Array:
    """(F, 2) sigma in texels along the axes (F, 2, 2); jacobian: (F, k, 2), not zero."""
    speed = np.linalg.norm(np.einsum("fkd,fid->fik", jacobian, axes), axis=-1)
    texels: Array = np.minimum(sigma * resolution / speed, MOST_TAPS / 3)
    return texels


def deviation_in(metric: Array, axes: Array, sigma: float, resolution: int) -> Array:
    """(P, 2) the same from metrics G = JᵀJ (P, 2, 2): |J s|² = sᵀGs."""
    speed = np.sqrt(np.einsum("pik,pkl,pil->pi", axes, metric, axes))
    texels: Array = np.minimum(sigma * resolution / speed, MOST_TAPS / 3)
    return texels


def along(heights: Array, axis: Array, alpha: Array, sigma: Array) -> Array:
    """(R, C) one pass: (1 - alpha) delta + alpha G with taps one texel apart to 3 sigma.

    axis: (R, C, 2) unit vectors in UV, v up, so down the rows where it is negative.  alpha, sigma
    (in texels): (R, C).  Beyond the border the texel at the border is read.
    """
    rows, columns = np.indices(heights.shape, np.float64)
    taps = np.floor(3.0 * sigma)
    total, weighted = np.ones(heights.shape), np.array(heights, np.float64)
    for k in range(1, int(taps.max(initial=0)) + 1):
        weight = np.where(k <= taps, np.exp(-0.5 * np.square(k / np.maximum(sigma, 0.1))), 0.0)
        for sign in (-k, k):
            at = (rows - sign * axis[..., 1], columns + sign * axis[..., 0])
            weighted += weight * bilinear(heights, *at)
            total += weight
    return (1.0 - alpha) * heights + alpha * weighted / total


def convolved(heights: Array, axes: Array, alpha: Array, sigma: Array) -> Array:
    """(R, C) both passes; axes: (R, C, 2, 2), alpha, sigma: (R, C, 2)."""
    found = heights
    for i in range(2):
        found = along(found, axes[:, :, i], alpha[:, :, i], sigma[:, :, i])
    return found


def gain(alpha: float, sigma: float, frequency: ArrayLike) -> Array:
    """What one pass along an axis of the map makes of a wave of so many periods per texel."""
    k = np.arange(1, int(3.0 * sigma) + 1)
    weight = np.exp(-0.5 * np.square(k / sigma))
    waves = np.cos(2 * np.pi * np.multiply.outer(np.asarray(frequency, np.float64), k))
    response: Array = (1 + 2 * waves @ weight) / (1 + 2 * weight.sum())
    return 1.0 - alpha * (1.0 - response)


def bilinear(heights: Array, rows: Array, columns: Array) -> Array:
    """Values between the centres of texels; beyond the border that of the border."""
    top, left = np.floor(rows).astype(int), np.floor(columns).astype(int)
    y, x = rows - top, columns - left

    height, width = heights.shape
    texels = np.ravel(heights)
    above, below = (np.clip(top + i, 0, height - 1) * width for i in (0, 1))
    before, behind = (np.clip(left + i, 0, width - 1) for i in (0, 1))
    upper = (1 - x) * texels[above + before] + x * texels[above + behind]
    lower = (1 - x) * texels[below + before] + x * texels[below + behind]
    blended: Array = (1 - y) * upper + y * lower
    return blended
