"""From stretch to scales and weights (Alg. 1 to 3) in numpy: float32, once per frame."""

from __future__ import annotations

import numpy as np

from rhytid.pipeline.reach import SCALE_LIMIT
from rhytid_lab.bench.scene import Floats, Scene

_EPSILON = np.float32(1e-6)


def wrinkle_scales(scene: Scene) -> Floats:
    """(K, 2) σ_w, σ_d of each wrinkle (Alg. 1)."""
    response, triangle = scene.settings.response, scene.wrinkles.triangle
    extent = scene.wrinkles.segments[:, 2:]
    theta = extent / np.linalg.norm(extent, axis=1, keepdims=True)
    r = _across(theta, scene.axes[triangle], scene.logs[triangle])
    return _scales(r, response.alpha_w, response.alpha_d)


def pore_scales(scene: Scene) -> Floats:
    """(L, 2) σ_w, σ_d of each pore (Alg. 2)."""
    response = scene.settings.response
    r = scene.logs[scene.pores.triangle].mean(axis=1)
    return _scales(r, response.beta_w, response.beta_d)


def unit_scales(count: int) -> Floats:
    """(count, 2) of what is not stretched."""
    return np.ones((count, 2), np.float32)


def sample_weights(scene: Scene) -> Floats:
    """(F + 1, N + 1) where each triangle stands between the samples, from 0 to M - 1 (Alg. 3,
    lines 6 to 10); the last column is the pores'."""
    bins = scene.settings.bins
    theta = scene.directions[None]
    r = _across(theta, scene.axes[:, None], scene.logs[:, None])
    r = np.concatenate([r, scene.logs.mean(axis=1, keepdims=True)], axis=1)
    share = np.clip(r / np.float32(bins.r_max), -1, 1)
    position: Floats = (share + 1) * np.float32(0.5 * (bins.samples - 1))
    return position


def _across(theta: Floats, axes: Floats, logs: Floats) -> Floats:
    """Alg. 1, lines 4 and 5."""
    d1 = np.maximum(1 - np.abs((theta * axes[..., :2]).sum(axis=-1)), 0)
    d2 = np.maximum(1 - np.abs((theta * axes[..., 2:]).sum(axis=-1)), 0)
    found: Floats = (d1 * logs[..., 0] + d2 * logs[..., 1]) / (d1 + d2 + _EPSILON)
    return found


def _scales(r: Floats, width: float, depth: float) -> Floats:
    """Alg. 1, lines 7 and 8."""
    exponents = np.array([width, -depth], np.float32)
    scales: Floats = np.clip(np.exp(r[:, None] * exponents), 1 / SCALE_LIMIT, SCALE_LIMIT)
    return scales
