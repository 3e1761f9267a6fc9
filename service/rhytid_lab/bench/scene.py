"""The data of a benchmark on the host, which every implementation of a case starts from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.mesh import Mesh
from rhytid.pipeline.bins import directions, quantisation_steps
from rhytid.pipeline.element_arrays import PoreArrays, WrinkleArrays

Floats = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Scene:
    """One frame of one UDIM: F triangles, K wrinkles, L pores, R² texels, row 0 at the top.

    deformed: (V, 3) positions.  axes (F + 1, 4), logs (F + 1, 2): stretch of each triangle, the
    last entry for points in none.  settings: `depth` is set.  on_cpu: whether rhytid's device is a
    processor.  draw_triangles, draw_codes, draw_neutral: make `triangles`, `codes` and `neutral` on
    first use.
    """

    mesh: Mesh
    deformed: Floats
    settings: AssetSettings
    axes: Floats
    logs: Floats
    wrinkles: WrinkleArrays
    pores: PoreArrays
    on_cpu: bool
    draw_triangles: Callable[[], NDArray[np.int32]] = field(repr=False)
    draw_codes: Callable[[], NDArray[np.integer[Any]]] = field(repr=False)
    draw_neutral: Callable[[], Floats] = field(repr=False)

    @property
    def size(self) -> int:
        """Texels a side, R."""
        return self.settings.resolution

    @property
    def depth(self) -> float:
        """Displacement of strength 1, mesh units."""
        assert self.settings.depth is not None
        return self.settings.depth

    @property
    def directions(self) -> Floats:
        """(N, 2) θ of each bin."""
        return directions(self.settings.bins.count).astype(np.float32)

    @property
    def steps(self) -> Floats:
        """(N + 1, M) displacement of a code."""
        return quantisation_steps(self.settings, self.wrinkles.share_range)

    @cached_property
    def triangles(self) -> NDArray[np.int32]:
        """(R, R) triangle of each texel."""
        return self.draw_triangles()

    @cached_property
    def codes(self) -> NDArray[np.integer[Any]]:
        """(N + 1, M, R, R) precomputed maps of the preset `paper`."""
        return self.draw_codes()

    @cached_property
    def neutral(self) -> Floats:
        """(R, R) undeformed displacement."""
        return self.draw_neutral()
