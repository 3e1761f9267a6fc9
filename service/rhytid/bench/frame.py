"""What one frame costs on a device: stretch, redraw, blend, convolution, and the maps made ahead.

Every time is the median of a few runs, after one that does not count, and comes with its ratio to
*one map copy* taken in the same run: a kernel that reads and writes R² float32.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.device.runtime import Buffer, Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import mesh_udims
from rhytid.engine.spacing import mean_spacing
from rhytid.pipeline.bins import BinMaker, BinTile
from rhytid.pipeline.blend import Blend
from rhytid.pipeline.convolve import Convolve
from rhytid.pipeline.elements import UdimElements, pore_arrays, wrinkle_arrays
from rhytid.pipeline.locate import UdimTriangles, locate_points
from rhytid.pipeline.neutral_tiles import NeutralTile
from rhytid.pipeline.redraw import redrawing, respond
from rhytid.pipeline.stretch import StretchStage
from rhytid.pipeline.stretch_buffers import StretchBuffers


@dataclass(frozen=True)
class Cost:
    """A case with its time in seconds and in map copies."""

    case: str
    seconds: float
    map_copies: float


class FrameBench:
    """The first UDIM of a face on a device, ready to be timed.

    mesh, graph: the face.  deformed: (V, 3) float32 positions of the frame.
    """

    def __init__(
        self,
        device: Device,
        mesh: Mesh,
        graph: WrinkleGraph,
        deformed: NDArray[np.float32],
        settings: AssetSettings,
    ) -> None:
        self.device, self.wrinkles = device, graph.wrinkles
        self._deformed = deformed
        self._copy: float | None = None
        self._udim = udim = mesh_udims(mesh)[0]
        size, padding = settings.resolution, settings.padding
        pore = locate_points(device, mesh, graph.node_uv, size, padding)
        wrinkle = locate_points(device, mesh, graph.centres(), size, padding)
        self._settings = settings = settings.resolved(mean_spacing(mesh, graph, pore))
        self._elements = UdimElements(
            device,
            wrinkle_arrays(graph, wrinkle, settings, udim),
            pore_arrays(graph, pore, settings, udim),
            settings.bins.count,
        )
        self._located = UdimTriangles(device, mesh, udim, size, padding)
        self._stage = StretchStage(device, mesh)
        self._blend = Blend(device, settings, len(mesh.faces))
        self._bins: list[BinTile] = []
        self._convolve = Convolve(device, mesh)
        self._neutral: list[NeutralTile] = []

    def cases(self) -> list[str]:
        """What can be timed, in an order in which each has what it needs."""
        return ["copy", "stretch", "redraw", "precompute", "binned", "convolved"]

    def cost(self, case: str, repeats: int) -> Cost:
        """Time one case of `cases`; the copy is timed first."""
        if self._copy is None:
            self._copy = self._time(self._copying(), max(repeats, 5))
        if case == "copy":
            return Cost(case, self._copy, 1.0)
        if case == "binned" and not self._bins:
            self._precompute()
        if case == "convolved" and not self._neutral:
            self._draw_neutral()
        seconds = self._time(getattr(self, f"_{case}"), 1 if case == "precompute" else repeats)
        return Cost(case, seconds, seconds / self._copy)

    def release(self) -> None:
        """Give the device memory back."""
        made = (*self._bins, *self._neutral)
        stages = (self._elements, self._located, self._stage, self._blend, self._convolve)
        _release(*made, *stages)
        self._bins.clear()
        self._neutral.clear()

    def _time(self, work: Callable[[], None], repeats: int) -> float:
        taken = []
        for _ in range(repeats + 1):
            self.device.finish()
            start = time.perf_counter()
            work()
            self.device.finish()
            taken.append(time.perf_counter() - start)
        return statistics.median(taken[1:])

    def _copying(self) -> Callable[[], None]:
        count = self._settings.resolution**2
        source, target = (self.device.full(count, np.float32(1.0)) for _ in range(2))
        return lambda: self.device.launch("copy", "copy_map", (count // 16,), source, target)

    def _stretched(self, positions: NDArray[np.float32] | None) -> StretchBuffers:
        return self._stage.run(positions, self._settings.response.log_stretch_limit)

    def _tiles(self) -> list[tuple[int, int, int]]:
        """(row, column, side) of every tile of level 0."""
        side = self._settings.tile_size
        starts = range(0, self._settings.resolution, side)
        return [(row, column, side) for row in starts for column in starts]

    def _stretch(self) -> None:
        self._stretched(self._deformed).release()

    def _redraw(self) -> None:
        stretch = self._stretched(self._deformed)
        scales = respond(self.device, self._elements, self._settings, stretch)
        draw = redrawing(self.device, self._elements, self._settings, scales)
        out = draw(0, 0, self._settings.resolution)
        _release(stretch, scales, out)

    def _precompute(self) -> None:
        _release(*self._bins)
        self._bins.clear()
        maker = BinMaker(self.device, self._elements, self._located, self._settings)
        self._bins = [maker.tile(0, *tile) for tile in self._tiles()]

    def _binned(self) -> None:
        stretch = self._stretched(self._deformed)
        coefficients = self._blend.coefficients(stretch)
        tiles: list[Buffer] = [self._blend.tile(maps, coefficients) for maps in self._bins]
        _release(stretch, coefficients, *tiles)

    def _draw_neutral(self) -> None:
        stretch = self._stretched(None)
        scales = respond(self.device, self._elements, self._settings, stretch)
        draw = redrawing(self.device, self._elements, self._settings, scales)
        self._neutral = [
            self._convolve.neutral_tile(
                draw, self._located, self._settings, self._udim, row, column, side
            )
            for row, column, side in self._tiles()
        ]
        _release(stretch, scales)

    def _convolved(self) -> None:
        stretch = self._stretched(self._deformed)
        kernels = self._convolve.kernels(stretch, self._settings)
        tiles = [self._convolve.tile(n, kernels, self._settings) for n in self._neutral]
        _release(stretch, kernels, *tiles)


def _release(*things: object) -> None:
    for thing in things:
        thing.release()  # type: ignore[attr-defined]
