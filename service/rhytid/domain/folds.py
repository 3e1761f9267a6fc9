"""Where skin folds, at the vertices of a mesh: what expressions leave to grow lines by."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.validation import fixed_array
from rhytid.errors import InputError

FloatArray = NDArray[np.float64]
# Expressions that move anything, from which on what they leave alone counts as never folding.
ENOUGH = 5
# Places of xx, yy, zz, xy, xz, yz in a symmetric 3 x 3 matrix.
ROWS, COLUMNS = np.array([0, 1, 2, 0, 0, 1]), np.array([0, 1, 2, 1, 2, 2])


@dataclass(frozen=True, eq=False)
class Folds:
    """tensor (V, 6) float32: xx, yy, zz, xy, xz, yz of the mean of squared log compression along
    its axes, in the space of the mesh, smoothed on the surface; dimensionless.

    moving: how many expressions moved anything.  regions: (V,) float32 shares from 0 to 1 by the
    name of the region. Raises InputError for arrays that do not fit or are not finite.
    """

    tensor: NDArray[np.float32]
    moving: int
    regions: Mapping[str, NDArray[np.float32]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        tensor = fixed_array(self.tensor, "folds", (None, 6), np.float32, InputError)
        regions = {
            name: fixed_array(self.regions[name], name, (len(tensor),), np.float32, InputError)
            for name in sorted(self.regions)
        }
        if not all(np.isfinite(array).all() for array in (tensor, *regions.values())):
            raise InputError("folds that are not finite")
        object.__setattr__(self, "tensor", tensor)
        object.__setattr__(self, "regions", regions)

    @property
    def known(self) -> float:
        """From 0 to 1: how much it says of a place that nothing folds it."""
        return min(self.moving / ENOUGH, 1.0)

    def axes(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(V,) root of the largest eigenvalue: root mean square log compression along the axis
        (V, 3) where it is largest; and (V,) by what share it is smaller across, 0 where skin is
        compressed alike in both directions. In the order size, eccentricity, axis."""
        full = np.empty((len(self.tensor), 3, 3))
        full[:, ROWS, COLUMNS] = full[:, COLUMNS, ROWS] = self.tensor
        values, vectors = np.linalg.eigh(full)
        roots = np.sqrt(np.maximum(values, 0.0))
        eccentricity = 1.0 - roots[:, 1] / np.maximum(roots[:, 2], 1e-12)
        return roots[:, 2], np.where(roots[:, 2] > 0, eccentricity, 0.0), vectors[:, :, 2]

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Everything by name."""
        regions = {f"region.{name}": mask for name, mask in self.regions.items()}
        return {"tensor": self.tensor, "moving": np.array([self.moving], np.int32), **regions}

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> Folds:
        """The inverse of `arrays`."""
        regions = {
            name.removeprefix("region."): mask
            for name, mask in arrays.items()
            if name.startswith("region.")
        }
        return cls(arrays["tensor"], int(arrays["moving"][0]), regions)
