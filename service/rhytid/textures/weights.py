"""Stretch and compression of skin, as weights by which a rig blends wrinkle maps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh
from rhytid.textures.chart import TEXELS, Chart
from rhytid.textures.tangents import welded

FloatArray = NDArray[np.float64]
# |log ratio| of weight 1: twice or half as long.
FULL = float(np.log(2.0))


def corner_weights(mesh: Mesh, ratios: NDArray[np.float32]) -> FloatArray:
    """(F, 3, 2) of corners: stretch, compression, each from 0 to 1.

    ratios: (F, 2) of length in the frame to length in the neutral, along both axes of stretch. A
    triangle has max(log ratio, 0) and max(-log ratio, 0), the larger of both axes, over FULL; a
    vertex has the mean of its triangles by their areas in the neutral.
    """
    logs = np.log(np.clip(ratios.astype(np.float64), 1e-6, 1e6)) / FULL
    shares = np.stack([logs.max(axis=1), -logs.min(axis=1)], axis=1).clip(0.0, 1.0)
    corners = mesh.positions.astype(np.float64)[mesh.faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(cross, axis=1)
    number = welded(mesh)[mesh.faces].reshape(-1)
    size = np.maximum(np.bincount(number, np.repeat(area, 3)), 1e-300)
    mean = [np.bincount(number, np.repeat(area * share, 3)) / size for share in shares.T]
    return np.stack(mean, axis=1)[number].reshape(-1, 3, 2)


def weight_map(chart: Chart, corners: FloatArray) -> NDArray[np.float32]:
    """(R, R, 2) of corner weights (F, 3, 2). Beyond the padding a texel has what the nearest one
    within it has, so that coarser levels do not fade towards the borders of islands."""
    side = len(chart.triangles)
    out = np.zeros((side, side, 2), np.float32)
    rows = max(TEXELS // side, 1)
    for start in range(0, side, rows):
        part = slice(start, min(start + rows, side))
        found = chart.triangles[part].reshape(-1)
        share = chart.corner_weights(part, np.ones((part.stop - start, side), np.bool_))
        out[part] = np.einsum("kc,kcx->kx", share, corners[found]).reshape(-1, side, 2)
    return out
