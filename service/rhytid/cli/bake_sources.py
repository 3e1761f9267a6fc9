"""What the maps of a bake are drawn from, each found when a profile asks for it, and once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh
from rhytid.engine.messages import AssetInfo
from rhytid.exports.textures.frame_map import Chart, FrameMap, Padding
from rhytid.exports.textures.tangents import Posed
from rhytid.exports.textures.writers import corner_weights

if TYPE_CHECKING:
    from rhytid.engine.engine import Engine
    from rhytid.engine.messages import TilePlan

# Of the digest of a frame, in keys of files.
_DIGITS = 16


@dataclass(frozen=True, eq=False)
class FrameSurface:
    """The surface of one frame: for normal maps, and its stretch as weights.

    digest: 16 hex digits that name its positions.
    """

    digest: Callable[[], str]
    posed: Callable[[], Posed]
    weights: Callable[[], NDArray[np.float64]]


class MapSources:
    """The maps of an asset. Its charts are kept, 10 bytes per texel of each UDIM; paddings, which
    are all that floats need, are small."""

    def __init__(self, engine: Engine, asset: AssetInfo, mesh: Mesh) -> None:
        self._engine, self._asset, self._mesh = engine, asset, mesh
        self._depth = float(asset.settings["depth"] or 0.0)
        self._reach = int(asset.settings["padding"])
        self._charts: dict[int, Chart] = {}
        self._paddings: dict[int, Padding] = {}

    def surface(self, frame: str, positions: Callable[[], NDArray[np.float32]]) -> FrameSurface:
        """Of a frame that the engine holds, and what reads its positions (V, 3)."""
        engine, asset, mesh = self._engine, self._asset.id, self._mesh
        return FrameSurface(
            cache(lambda: engine.frames.digest(asset, frame)[:_DIGITS]),
            cache(lambda: Posed.of(mesh, positions())),
            cache(lambda: corner_weights(mesh, engine.frames.stretch(asset, frame).ratios)),
        )

    def map(
        self, surface: FrameSurface, plan: TilePlan, heights: Callable[[], NDArray[np.float32]]
    ) -> FrameMap:
        """A planned map, whose displacement `heights` draws."""
        udim = plan.header.udim
        return FrameMap(
            plan.header,
            self._depth,
            heights,
            lambda: self._padding(udim),
            lambda: self._chart(udim),
            surface.posed,
            surface.weights,
        )

    def _chart(self, udim: int) -> Chart:
        if udim not in self._charts:
            self._charts[udim] = Chart.of(self._mesh, udim, self._triangles(udim))
        return self._charts[udim]

    def _padding(self, udim: int) -> Padding:
        if udim not in self._paddings:
            found = self._triangles(udim)
            self._paddings[udim] = Padding.of(self._mesh, udim, found, self._reach)
        return self._paddings[udim]

    def _triangles(self, udim: int) -> NDArray[np.int32]:
        return self._engine.tiles.triangles(self._asset.id, udim)
