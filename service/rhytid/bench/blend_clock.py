"""How long blending takes for a choice of bins, without the memory that a whole map would need."""

from __future__ import annotations

import statistics
import time
from dataclasses import dataclass, replace

import numpy as np

from rhytid.bench.subject import Grown, Subject
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import PRESETS, BinSettings
from rhytid.domain.tiles import TileAddress, TileGrid
from rhytid.pipeline.bins import BinMaker, BinTile
from rhytid.pipeline.blend import Blend
from rhytid.pipeline.elements import UdimElements, pore_arrays, wrinkle_arrays
from rhytid.pipeline.locate import UdimTriangles, locate_points
from rhytid.pipeline.stretch import StretchStage

REPEATS = 9
# Of the same tiles in one run, so that a run takes some milliseconds.
ROUNDS = 4


@dataclass(frozen=True)
class _Ready:
    """A choice of bins, its maps at hand."""

    blend: Blend
    maps: list[BinTile]

    def release(self) -> None:
        for tile in self.maps:
            tile.release()
        self.blend.release()


class BlendClock:
    """The frame of a subject that stretches most, at the size at which blending is timed.

    Times are of a whole map, from a few tiles in its middle, beside a copy of the same map. On a
    processor they are its own time, all cores together. Every choice of bins is timed in turn with
    the paper's, so that what else the machine does slows both.
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
        self._paper = self._made(PRESETS["paper"])
        shares = settings.grid.count(0) ** 2 / len(self._paper.maps * ROUNDS)
        self._paper_seconds = shares * min(self._blend(self._paper) for _ in range(REPEATS))

    def seconds(self, bins: BinSettings) -> float:
        """Of Alg. 3 for a whole map, its precomputed maps at hand: what the paper's choice took
        when the clock was made, times the median of how much longer these take."""
        made = self._made(bins)
        found = statistics.median(
            self._blend(made) / self._blend(self._paper) for _ in range(REPEATS)
        )
        made.release()
        return found * self._paper_seconds

    def _made(self, bins: BinSettings) -> _Ready:
        settings = replace(self._settings, bins=replace(bins, r_max=self._subject.r_max))
        elements = UdimElements(self._device, self._wrinkles, self._pores, bins.count)
        maker = BinMaker(self._device, elements, self._located, settings)
        side = settings.grid.tile_size
        places = middle_tiles(settings.grid, self._subject.udim)
        maps = [maker.tile(0, a.row * side, a.column * side, side) for a in places]
        elements.release()
        return _Ready(Blend(self._device, settings, len(self._subject.mesh.faces)), maps)

    def release(self) -> None:
        """Give the device memory back."""
        self._paper.release()
        self._located.release()
        self._stretch.release()
        self._stage.release()

    def _blend(self, made: _Ready) -> float:
        coefficients = made.blend.coefficients(self._stretch)
        self._device.finish()
        start = self._now()
        tiles = [made.blend.tile(one, coefficients) for one in made.maps * ROUNDS]
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
