"""Soft masks of regions of the skin, from the places that expressions of known names move and
fold."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.blendshapes import region_of
from rhytid.domain.mesh import Mesh
from rhytid.pipeline.region_places import neck_share, nose_share, ramp
from rhytid.pipeline.spreading import Spreading

FloatArray = NDArray[np.float64]
# By region: powers of motion and of folds whose product tells it, as shares of their most, and at
# which it begins and is whole. By eye on two faces: brows carry the skin of the lids up with them,
# but fold the forehead alone; lips move most in a pucker, and fold as much as what is around them;
# what puffs, squints and smiles together is the cheek.
_FOLDS = {
    "forehead": (0.0, 1.0, 0.25, 0.55),
    "eye_corner": (0.5, 0.5, 0.22, 0.5),
    "lip": (1.0, 0.0, 0.65, 0.92),
    "cheek": (1.0, 0.0, 0.25, 0.55),
}
# Those that lie beside what moves.
_BESIDE = ("nose", "neck")
# What the others leave: a smile moves the corners of the lips, and much around the nose, too.
_LEFT = "cheek"


class RegionMasks:
    """What the expressions of one mesh show of regions, one after the other."""

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh
        self._shown: dict[str, list[tuple[FloatArray, FloatArray]]] = {}
        self._moved: dict[str, FloatArray] = {}

    def add(self, name: str, positions: NDArray[np.float32], folds: NDArray[np.float32]) -> None:
        """Look at one expression that moves something.  folds: (F, 3) as `FoldStage` has them."""
        region = region_of(name)
        if region is None:
            return
        offsets = positions.astype(np.float64) - self._mesh.positions
        if region in _BESIDE:
            self._moved[region] = self._moved.get(region, 0.0) + offsets
            return
        compression = folds[:, 0].astype(np.float64) + folds[:, 1]
        motion = np.linalg.norm(offsets, axis=1)
        self._shown.setdefault(region, []).append((motion, compression))

    def masks(self, surface: Spreading) -> dict[str, NDArray[np.float32]]:
        """(V,) shares from 0 to 1 of the regions that were shown."""
        shares = {region: self._by_shapes(region, surface) for region in self._shown}
        shares |= self._beside(surface)
        found = {}
        for region, share in sorted(shares.items()):
            soft = surface.of_vertices(share[:, None])[:, 0]
            found[region] = np.clip(soft, 0.0, 1.0)
        if _LEFT in found:
            for region in sorted(found.keys() - {_LEFT}):
                found[_LEFT] = found[_LEFT] * (1.0 - found[region])
        return {region: mask.astype(np.float32) for region, mask in found.items()}

    def _by_shapes(self, region: str, surface: Spreading) -> FloatArray:
        """(V,) where the expressions of a region move and fold most."""
        shown = self._shown[region]
        by_motion, by_folds, begins, whole = _FOLDS[region]
        folds = surface.of_triangles(np.stack([c for _, c in shown], axis=-1))
        shares = [
            _share(motion) ** by_motion * _share(np.sqrt(np.maximum(fold, 0.0))) ** by_folds
            for (motion, _), fold in zip(shown, folds.T, strict=True)
        ]
        return ramp(np.maximum.reduce(shares), begins, whole)

    def _beside(self, surface: Spreading) -> dict[str, FloatArray]:
        """(V,) of the nose and the neck, where the form of the face shows them."""
        found = {}
        if "nose" in self._moved:
            found["nose"] = nose_share(self._mesh, surface.normals, self._moved["nose"])
        if "neck" in self._moved:
            found["neck"] = neck_share(self._mesh, self._moved["neck"], surface.sigma)
        return {region: share for region, share in found.items() if share is not None}


def _share(values: Any) -> FloatArray:
    share: FloatArray = values / max(float(values.max()), 1e-30)
    return share
