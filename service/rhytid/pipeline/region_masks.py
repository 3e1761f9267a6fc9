"""Soft masks of regions of the skin, from where expressions of known names move and fold it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh
from rhytid.domain.named_shapes import region_of
from rhytid.pipeline.spreading import Spreading

FloatArray = NDArray[np.float64]
# By region: powers of motion and of folds whose product tells it, as shares of their most, and at
# which it begins and is whole. By eye on two faces: brows carry the skin of the lids up with them,
# but fold the forehead alone; lips move most in a pucker, and fold as much as what is around them.
_TOLD = {
    "forehead": (0.0, 1.0, 0.25, 0.55),
    "eye_corner": (0.5, 0.5, 0.22, 0.5),
    "lip": (1.0, 0.0, 0.65, 0.92),
}


class RegionMasks:
    """What the expressions of one mesh show of regions, one after the other."""

    def __init__(self, mesh: Mesh) -> None:
        self._neutral = mesh.positions
        self._shown: dict[str, list[tuple[FloatArray, FloatArray]]] = {}

    def add(self, name: str, positions: NDArray[np.float32], folds: NDArray[np.float32]) -> None:
        """Look at one expression that moves something.  folds: (F, 3) as `FoldStage` has them."""
        region = region_of(name)
        if region is not None:
            motion = np.linalg.norm(positions.astype(np.float64) - self._neutral, axis=1)
            compression = folds[:, 0].astype(np.float64) + folds[:, 1]
            self._shown.setdefault(region, []).append((motion, compression))

    def masks(self, surface: Spreading) -> dict[str, NDArray[np.float32]]:
        """(V,) shares from 0 to 1 of the regions that were shown."""
        found = {}
        for region, shown in sorted(self._shown.items()):
            by_motion, by_folds, begins, whole = _TOLD[region]
            folds = surface.of_triangles(np.stack([c for _, c in shown], axis=-1))
            told = [
                _share(motion) ** by_motion * _share(np.sqrt(np.maximum(fold, 0.0))) ** by_folds
                for (motion, _), fold in zip(shown, folds.T, strict=True)
            ]
            ramp = np.clip((np.maximum.reduce(told) - begins) / (whole - begins), 0.0, 1.0)
            soft = surface.of_vertices(ramp[:, None])[:, 0]
            found[region] = np.clip(soft, 0.0, 1.0).astype(np.float32)
        return found


def _share(values: Any) -> FloatArray:
    share: FloatArray = values / max(float(values.max()), 1e-30)
    return share
