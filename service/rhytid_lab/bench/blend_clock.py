"""Times of blending by the choice of bins. They do not depend on the codes, so no maps are
drawn."""

from __future__ import annotations

import statistics
import time
from dataclasses import dataclass, replace

import numpy as np

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import PRESETS, BinSettings
from rhytid.pipeline.bin_maker import BinTile
from rhytid.pipeline.bins import map_count
from rhytid.pipeline.blend import Blend
from rhytid.pipeline.locate import UdimTriangles
from rhytid.pipeline.stretch import StretchStage
from rhytid.pipeline.vectors import VectorTriangles
from rhytid_lab.bench.subject import Grown, Subject

REPEATS = 9
# Bytes of codes that are blended in one run: several times what any cache holds.
MOST_CODES = 256 << 20


@dataclass(frozen=True)
class _Ready:
    """A choice of bins, with some codes in tiles spread over the map."""

    blend: Blend
    tiles: list[BinTile]

    def release(self) -> None:
        for tile in self.tiles:
            tile.codes.release()
        self.blend.release()


class BlendClock:
    """Times blending for the frame of a subject that stretches most.

    Times are of a whole map, beside a copy of the same map. On a processor they are processor time,
    of all cores together. Every choice of bins is timed in turn with the paper's, so that other
    work of the machine slows both.
    """

    def __init__(self, device: Device, subject: Subject, grown: Grown, resolution: int) -> None:
        self._device, self._subject = device, subject
        self._now = time.process_time if device.info.kind == "cpu" else time.perf_counter
        self._settings = settings = subject.settings(grown, resolution)
        self._vectors = self._placed(resolution)
        self._stage = StretchStage(device, subject.mesh, settings.length_unit)
        positions, response = subject.frames[subject.strongest].positions, settings.response
        self._stretch = self._stage.run(
            positions,
            response.log_stretch_limit,
            soft=response.soft_limits,
            folds=response.folds,
        )
        self.copy_seconds = self._copy()
        self._paper = self._made(PRESETS["paper"].bins)
        self._paper_seconds = min(self._blend(self._paper) for _ in range(REPEATS))

    def seconds(self, bins: BinSettings) -> float:
        """Return the seconds of Alg. 3 for a whole map whose precomputed maps are at hand: the time
        of the paper's choice when the clock was made, times the median ratio of both times."""
        made = self._made(bins)
        found = statistics.median(
            self._blend(made) / self._blend(self._paper) for _ in range(REPEATS)
        )
        made.release()
        return found * self._paper_seconds

    def release(self) -> None:
        """Give the device memory back."""
        self._paper.release()
        self._stretch.release()
        self._stage.release()
        for vectors in self._vectors:
            vectors.release()

    def _placed(self, resolution: int) -> list[VectorTriangles]:
        """Triangles of every tile of the map."""
        subject, settings, found = self._subject, self._settings, []
        located = UdimTriangles(
            self._device, subject.mesh, subject.udim, resolution, settings.padding
        )
        side = settings.grid.tile_size
        for row in range(0, resolution, side):
            for column in range(0, resolution, side):
                triangles = located.texels(resolution, row, column, side)
                found.append(VectorTriangles.of(self._device, triangles, side * side))
                triangles.release()
        located.release()
        return found

    def _made(self, bins: BinSettings) -> _Ready:
        settings = replace(self._settings, bins=replace(bins, r_max=self._subject.r_max))
        texels = settings.grid.tile_size**2
        codes = map_count(bins) * texels
        most = max(MOST_CODES * 8 // (codes * bins.bits), 1)
        each = -(-len(self._vectors) // most)
        value = np.dtype(f"i{bins.bits // 8}").type(-40)
        place = (np.int32(settings.grid.tile_size),) + 3 * (np.int32(0),)
        tiles = [
            BinTile(vectors, self._device.full(codes, value), texels, place)
            for vectors in self._vectors[::each]
        ]
        return _Ready(Blend(self._device, settings, len(self._subject.mesh.faces)), tiles)

    def _blend(self, made: _Ready) -> float:
        """Blend some tiles; returns the seconds of a whole map."""
        coefficients = made.blend.coefficients(self._stretch)
        self._device.finish()
        start = self._now()
        for tile in made.blend.tiles(made.tiles, coefficients):
            tile.release()
        self._device.finish()
        taken = self._now() - start
        coefficients.release()
        return taken * len(self._vectors) / len(made.tiles)

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
