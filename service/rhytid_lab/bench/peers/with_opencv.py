"""`convolved` with OpenCV: every tap reads the map through a table of coordinates (`remap`)."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from rhytid.pipeline.convolve import MOST_TAPS, neutral_jacobians
from rhytid_lab.bench.peers import HostRun
from rhytid_lab.bench.scene import Floats, Scene

_TILE = 256


def convolved(scene: Scene) -> HostRun:
    """Axis 1 over the whole map, then axis 2, tile by tile with the taps that a tile needs."""
    jacobians = neutral_jacobians(scene.mesh).reshape(-1, 2, 2)
    neutral, triangles = np.ascontiguousarray(scene.neutral), scene.triangles

    def run() -> Floats:
        kernels = _kernels(scene, jacobians)
        wide = _along(neutral, triangles, kernels[:, 0])
        return _along(wide, triangles, kernels[:, 1])

    return HostRun(run)


CASES = {"convolved": convolved}


def _kernels(scene: Scene, jacobians: Floats) -> Floats:
    """(F + 1, 2, 4) of each axis: step x, step y (rows down), α, σ; texels."""
    convolve = scene.settings.convolve
    assert convolve.sigma is not None
    axes, logs = scene.axes.reshape(-1, 2, 2), scene.logs
    speed = np.linalg.norm(np.einsum("tij,taj->tai", jacobians, axes), axis=-1)
    usable = speed > 0
    gain = np.where(logs > 0, convolve.blur_gain, convolve.sharpen_gain)
    reach = convolve.sigma * scene.size / np.where(usable, speed, 1.0)
    found = np.zeros((len(axes), 2, 4), np.float32)
    found[..., 0], found[..., 1] = axes[..., 0], -axes[..., 1]
    found[..., 2] = np.clip(gain * logs, -1.0, 1.0)
    found[..., 3] = np.minimum(reach, MOST_TAPS / 3)
    found[~usable] = 0.0
    return found


def _along(source: Floats, triangles: NDArray[np.int32], kernels: Floats) -> Floats:
    out = np.empty_like(source)
    for top in range(0, len(source), _TILE):
        for left in range(0, len(source), _TILE):
            inside = np.s_[top : top + _TILE, left : left + _TILE]
            out[inside] = _tile(source, kernels[triangles[inside]], top, left, source[inside])
    return out


def _tile(source: Floats, kernels: Floats, top: int, left: int, centre: Floats) -> Floats:
    step_x, step_y, alpha, sigma = (np.ascontiguousarray(k) for k in np.moveaxis(kernels, -1, 0))
    taps = np.where(alpha != 0, np.floor(3 * sigma), 0)
    rows, columns = np.indices(centre.shape, np.float32)
    rows += top
    columns += left
    exponent = -0.5 / np.maximum(sigma, 1e-12) ** 2
    total, added = np.ones_like(centre), centre.copy()
    for i in range(1, int(taps.max()) + 1):
        weight = np.where(i <= taps, np.exp(exponent * (i * i)), 0).astype(np.float32)
        added += weight * sum(
            _read(source, columns + sign * i * step_x, rows + sign * i * step_y) for sign in (1, -1)
        )
        total += 2 * weight
    mixed: Floats = (1 - alpha) * centre + alpha / total * added
    return mixed


def _read(source: Floats, x: Floats, y: Floats) -> Any:
    return cv2.remap(source, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
