"""How long blending takes for a choice of bins, without the memory that a whole map would need."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from rhytid.bench.subject import Grown, Subject
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import BinSettings
from rhytid.domain.tiles import TileAddress, TileGrid
from rhytid.pipeline.bins import BinMaker, BinTile
from rhytid.pipeline.blend import Blend
from rhytid.pipeline.elements import UdimElements, pore_arrays, wrinkle_arrays
from rhytid.pipeline.locate import UdimTriangles, locate_points
from rhytid.pipeline.stretch import StretchStage

REPEATS = 9


class BlendClock:
    """The frame of a subject that stretches most, at the size at which blending is timed.

    Times are of a whole map, from a few tiles in its middle, beside a copy of the same map. On a
    processor they are its own time, all cores together, which other work disturbs little.
    """

    def __init__(self, device: Device, subject: Subject, grown: Grown, resolution: int) -> None:
        self._device, self._subject = device, subject
        self._now = time.process_time if device.info.kind == "cpu" else time.perf_counter
        self._settings = settings = subject.settings(grown, resolution)
        graph, mesh, udim = grown.graph, subject.mesh, subject.udim
        padding = settings.padding
        wrinkle = locate_points(device, mesh, graph.centres(), resolution, padding)
        pore = locate_points(device, mesh, graph.node_uv, resolution, padding)
        self._wrinkles = wrinkle_arrays(graph, wrinkle, settings, udim)
        self._pores = pore_arrays(graph, pore, settings, udim)
        self._located = UdimTriangles(device, mesh, udim, resolution, padding)
        positions = subject.frames[subject.strongest].positions
        limit = settings.response.log_stretch_limit
        self._stage = StretchStage(device, mesh)
        self._stretch = self._stage.run(positions, limit)
        self.copy_seconds = self._copy()

    def seconds(self, bins: BinSettings) -> float:
        """Of Alg. 3 for a whole map, its precomputed maps at hand: the fastest of a few runs."""
        settings = replace(self._settings, bins=replace(bins, r_max=self._subject.r_max))
        elements = UdimElements(self._device, self._wrinkles, self._pores, bins.count)
        maker = BinMaker(self._device, elements, self._located, settings)
        blend = Blend(self._device, settings, len(self._subject.mesh.faces))
        grid = settings.grid
        places = middle_tiles(grid, self._subject.udim)
        side = grid.tile_size
        maps = [maker.tile(0, a.row * side, a.column * side, side) for a in places]
        found = min(self._blend(blend, maps) for _ in range(REPEATS))
        for tile in maps:
            tile.release()
        blend.release()
        elements.release()
        return found * grid.count(0) ** 2 / len(places)

    def release(self) -> None:
        """Give the device memory back."""
        self._located.release()
        self._stretch.release()
        self._stage.release()

    def _blend(self, blend: Blend, maps: list[BinTile]) -> float:
        coefficients = blend.coefficients(self._stretch)
        self._device.finish()
        start = self._now()
        tiles = [blend.tile(one, coefficients) for one in maps]
        self._device.finish()
        taken = self._now() - start
        for buffer in (coefficients, *tiles):
            buffer.release()
        return taken

    def _copy(self) -> float:
        count = self._settings.resolution**2
        source, target = (self._device.full(count, np.float32(1.0)) for _ in range(2))
        taken = []
        for _ in range(REPEATS):
            self._device.finish()
            start = self._now()
            self._device.launch("copy", "copy_map", (count // 16,), source, target)
            self._device.finish()
            taken.append(self._now() - start)
        source.release()
        target.release()
        return min(taken)


def middle_tiles(grid: TileGrid, udim: int) -> list[TileAddress]:
    """The four tiles in the middle of the map, or all where there are fewer."""
    count = grid.count(0)
    near = range(max(count // 2 - 1, 0), min(count // 2 + 1, count))
    return [TileAddress(udim, 0, row, column) for row in near for column in near]
