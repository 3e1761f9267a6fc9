"""The cost of one frame on a device: stretch, redraw, blend, convolution, and the maps made ahead.

Every case but `stretch` starts from the stretch of the triangles, which is on the device already:
the paper times the two apart, and other implementations start there, too. Times come with their
ratio to *one map copy* taken in the same run: a kernel that reads and writes R² float32.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import mesh_udims
from rhytid.engine.assets.graphs import graph_lengths, mean_spacing
from rhytid.pipeline.bin_maker import BinMaker, BinTile
from rhytid.pipeline.blend import Blend
from rhytid.pipeline.convolve import Convolve, NeutralTile
from rhytid.pipeline.element_arrays import pore_arrays, wrinkle_arrays
from rhytid.pipeline.elements import UdimElements
from rhytid.pipeline.grain import (
    Grain,
    GrainPlace,
    GrainPlanes,
    fill_gains,
    grain_codes,
    grain_place,
    relief,
    relief_shares,
    tiles_of_square,
)
from rhytid.pipeline.line_stretches import LineStretches
from rhytid.pipeline.locate import UdimTriangles, locate_points
from rhytid.pipeline.redraw import (
    R_ALONE,
    redrawing,
    respond,
    wrinkle_responder,
)
from rhytid.pipeline.stretch import StretchBuffers, StretchStage
from rhytid.pipeline.waves import wrinkle_waves
from rhytid_lab.bench.scene import Floats, Scene
from rhytid_lab.bench.skin import Skin

# What a report shows of a frame; a bench knows `neutral` and `tile` as well.
REPORTED = ("copy", "stretch", "redraw", "precompute", "binned", "convolved")
CASES = (*REPORTED[1:], "neutral", "tile")
Square = tuple[int, int, int]


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
        # The others draw round lines alone, each where it answers to stretch, and flat ones that
        # all answer alike.
        graph = graph.without_copies()
        if is_flat(settings):
            graph = replace(graph, edge_share=None)
        self.device, self.wrinkles = device, graph.counts()[1]
        self.mesh, self.graph, self.deformed = mesh, graph, deformed
        self.udim = udim = mesh_udims(mesh)[0]
        size, padding = settings.resolution, settings.padding
        pore = locate_points(device, mesh, graph.node_uv, size, padding)
        wrinkle = locate_points(device, mesh, graph.centres(), size, padding)
        lengths = graph_lengths(graph, settings, mean_spacing(mesh, graph, pore))
        self.settings, self.spacing = settings.with_lengths(lengths), lengths.spacing
        settings = self.settings
        waves = wrinkle_waves(mesh, graph, wrinkle, settings.shape)
        self._wrinkles = wrinkle_arrays(graph, wrinkle, settings, udim, waves=waves)
        self._pores = pore_arrays(graph, pore, settings, udim)
        self._elements = UdimElements(device, self._wrinkles, self._pores, settings.bins.count)
        self._located = UdimTriangles(device, mesh, udim, size, padding)
        self._stage = StretchStage(device, mesh, settings.length_unit)
        self._limit = settings.response.log_stretch_limit
        self._soft = settings.response.soft_limits
        self._folds = settings.response.folds
        self._frame = self._stage.run(
            deformed, self._limit, angles=settings.angles, soft=self._soft, folds=self._folds
        )
        self._blend = Blend(device, settings, len(mesh.faces), self._wrinkles.share_range)
        self._convolve = Convolve(device, mesh)
        shares = relief_shares(mesh, graph, pore)
        self._grains = Grains(device, mesh, self._located, settings, shares)
        self._bins: list[BinTile] = []
        self._neutral: list[NeutralTile] = []
        self._lines: LineStretches | None = None
        self._copied = tuple(device.full(size * size, np.float32(1.0)) for _ in range(2))

    def run(self, case: str) -> None:
        """Run one case of CASES, or `copy`, and wait for its end."""
        if case == "copy":
            vectors = self.settings.resolution**2 // 16
            self.device.launch("copy", "copy_map", (vectors,), *self._copied)
        else:
            _release(*self._make(case))
        self.device.finish()

    def ready(self, case: str) -> None:
        """Make what the case keeps from frame to frame."""
        if case == "binned" and not self._bins:
            self._precompute()
        if case == "convolved" and not self._neutral:
            self._draw_neutral()

    def cost(self, case: str, repeats: int) -> Cost:
        """The median time of a case, or of `copy`, after one run that does not count."""
        self.ready(case)
        rounds = range(1 + (1 if case == "precompute" else repeats))
        seconds = [[self.seconds(of) for of in ("copy", case)] for _ in rounds]
        copy, own = (statistics.median(column) for column in zip(*seconds[1:], strict=True))
        return Cost(case, own, own / copy)

    def seconds(self, case: str) -> float:
        """Seconds of one run."""
        self.device.finish()
        start = time.perf_counter()
        self.run(case)
        return time.perf_counter() - start

    def tile_seconds(self, case: str) -> float:
        """Return the mean seconds of one tile of `redraw` or `binned`. Tiles are drawn one after
        the other; work that is done once per frame is not counted."""
        self.ready(case)
        if case == "binned":
            held: Any = self._blend.coefficients(self._frame)
            work = [partial(self._blend.tile, maps, held) for maps in self._bins]
        else:
            held = respond(self.device, self._elements, self.settings, self._frame)
            draw = redrawing(self.device, self._elements, self.settings, held)
            work = [partial(draw, *corner) for corner in self._tile_corners()]
        work[0]().release()
        self.device.finish()
        start = time.perf_counter()
        for one in work:
            one().release()
            self.device.finish()
        seconds = (time.perf_counter() - start) / len(work)
        held.release()
        return seconds

    def result(self, case: str) -> Floats:
        """Return the map (R, R) of a case, or its tile, mesh units; of `stretch` ratios and axes
        (F, 6)."""
        self.ready(case)
        if case == "stretch":
            ratios, axes = self._stage.read(self._frame)
            return np.concatenate([ratios, axes.reshape(-1, 4)], axis=1)
        made = self._make(case)
        side = round((made[0].nbytes // 4) ** 0.5)
        maps = [self.device.read(tile, (side, side), np.float32) for tile in made]
        _release(*made)
        count = round(len(maps) ** 0.5)
        return np.block([maps[i : i + count] for i in range(0, len(maps), count)])

    def scene(self) -> Scene:
        """Return the same frame for other implementations."""
        count, read = self._frame.count, self.device.read
        return Scene(
            self.mesh,
            self.deformed,
            self.settings,
            read(self._frame.axes, (count, 4), np.float32),
            read(self._frame.logs, (count, 2), np.float32),
            self._wrinkles,
            self._pores,
            self.device.info.kind == "cpu",
            self._read_triangles,
            self._read_codes,
            lambda: self.result("neutral"),
        )

    def release(self) -> None:
        """Give the device memory back."""
        made = (*self._bins, *self._neutral, *self._copied, self._frame)
        self._grains.release()
        if self._lines is not None:
            self._lines.release()
            self._lines = None
        stages = (self._elements, self._located, self._stage, self._blend, self._convolve)
        _release(*made, *stages)
        self._bins.clear()
        self._neutral.clear()

    def _tile_corners(self) -> list[tuple[int, int, int]]:
        """(row, column, side) of every tile of level 0."""
        side = self.settings.tile_size
        starts = range(0, self.settings.resolution, side)
        return [(row, column, side) for row in starts for column in starts]

    def _make(self, case: str) -> list[Buffer]:
        """Run a case; returns the buffers of its result."""
        work: dict[str, Callable[[], list[Buffer]]] = {
            "stretch": self._stretch,
            "redraw": lambda: self._drawn(self._frame, 0, 0, self.settings.resolution),
            "neutral": self._neutral_map,
            "tile": lambda: self._drawn(self._frame, *self._middle()),
            "precompute": self._precompute,
            "binned": self._binned,
            "convolved": self._convolved,
        }
        return work[case]()

    def _stretch(self) -> list[Buffer]:
        run = self._stage.run
        run(self.deformed, self._limit, soft=self._soft, folds=self._folds).release()
        return []

    def _middle(self) -> tuple[int, int, int]:
        """The tile that holds the middle of the map, at its upper left corner."""
        side = self.settings.tile_size
        start = self.settings.resolution // 2 // side * side
        return start, start, side

    def _drawn(self, stretch: StretchBuffers, row: int, column: int, side: int) -> list[Buffer]:
        scales = respond(self.device, self._elements, self.settings, stretch)
        draw = redrawing(self.device, self._elements, self.settings, scales)
        out = draw(row, column, side)
        scales.release()
        self._grains.add(out, stretch, (row, column, side))
        return [out]

    def _neutral_map(self) -> list[Buffer]:
        stretch = self._stage.run(None, self._limit)
        made = self._drawn(stretch, 0, 0, self.settings.resolution)
        stretch.release()
        return made

    def _precompute(self) -> list[Buffer]:
        _release(*self._bins)
        self._bins.clear()
        maker = BinMaker(self.device, self._elements, self._located, self.settings)
        self._bins = [maker.tile(*corner) for corner in self._tile_corners()]
        return []

    def _binned(self) -> list[Buffer]:
        coefficients = self._blend.coefficients(self._frame)
        grains = self._grains.codes(self._tile_corners())
        tiles = self._blend.tiles(self._bins, coefficients, grains, self._line_stretches())
        coefficients.release()
        return tiles

    def _line_stretches(self) -> Buffer | None:
        """Log stretch of the lines that own samples of cushions, found anew as for each frame."""
        if self._elements.cushion is None:
            return None
        if self._lines is None:
            self._lines = LineStretches.allocate(self.device, self._elements)
        responder = wrinkle_responder(self.device, self.settings, self._frame, R_ALONE)
        self._lines.fill(self.device, self._elements, self.settings, responder)
        return self._lines.ends

    def _draw_neutral(self) -> None:
        stretch = self._stage.run(None, self._limit)
        scales = respond(self.device, self._elements, self.settings, stretch)
        draw = redrawing(self.device, self._elements, self.settings, scales)
        self._neutral = [
            self._convolve.neutral_tile(draw, self._located, self.settings, self.udim, *corner)
            for corner in self._tile_corners()
        ]
        _release(stretch, scales)

    def _convolved(self) -> list[Buffer]:
        kernels = self._convolve.kernels(self._frame, self.settings)
        tiles = [self._convolve.tile(n, kernels, self.settings) for n in self._neutral]
        kernels.release()
        return tiles

    def _read_triangles(self) -> NDArray[np.int32]:
        size = self.settings.resolution
        held = self._located.texels(size, 0, 0, size)
        found: NDArray[np.int32] = self.device.read(held, (size, size), np.int32)
        held.release()
        return found

    def _read_codes(self) -> NDArray[np.integer[Any]]:
        skin = Skin(self.device, self.mesh, self.graph, self.settings, self.udim)
        bins, grid = self.settings.bins, self.settings.grid
        maps, side, size = (bins.count + 1) * bins.samples, grid.tile_size, grid.resolution
        codes = np.empty((maps, size, size), f"i{bins.bits // 8}")
        for address in grid.addresses(self.udim, 0):
            y, x = address.row * side, address.column * side
            for index in range(maps):
                codes[index, y : y + side, x : x + side] = skin.bin_map(address, index)
        skin.release()
        return codes.reshape(bins.count + 1, bins.samples, size, size)


def is_flat(settings: AssetSettings) -> bool:
    """Whether wrinkles are drawn as in the paper: straight, of one width, each by itself."""
    shape = settings.shape
    return shape.curvature == shape.taper == shape.cushion == settings.response.ends == 0.0


def _release(*things: object) -> None:
    for thing in things:
        thing.release()  # type: ignore[attr-defined]


class Grains:
    """Codes and triangles of the grain in the tiles of one UDIM, made on first use; none where the
    settings have no grain."""

    def __init__(
        self,
        device: Device,
        mesh: Mesh,
        located: UdimTriangles,
        settings: AssetSettings,
        shares: NDArray[np.float32] | None = None,
    ) -> None:
        self._device, self._located, self._settings = device, located, settings
        self._codes: dict[Square, Buffer] = {}
        self._places: dict[Square, GrainPlace] = {}
        self._planes: GrainPlanes | None = None
        if relief(settings) > 0.0:
            self._planes = GrainPlanes(device, mesh, settings, shares)

    def codes(self, squares: Sequence[Square]) -> list[Buffer] | None:
        """Return codes of tiles (row, column, texels per side) of level 0; None without grain."""
        if self._planes is None:
            return None
        for square in squares:
            if square not in self._codes:
                self._codes[square] = grain_codes(
                    self._device, self._planes, self._located, self._settings, square
                )
        return [self._codes[square] for square in squares]

    def add(self, out: Buffer, stretch: StretchBuffers, square: Square) -> None:
        """Add grain to the heights of a square of level 0 in a frame."""
        if self._planes is None:
            return
        side = self._settings.tile_size
        tiles = [(*at, side) for at in tiles_of_square(*square, side)]
        gains = self._device.empty(stretch.count, np.float32)
        fill_gains(self._device, self._settings, stretch, gains, None)
        grain = Grain(self._device, self._settings, self._located, stretch, gains)
        for tile, codes in zip(tiles, self.codes(tiles) or (), strict=True):
            grain.add(out, square, self._place(tile), codes)
        gains.release()

    def release(self) -> None:
        """Give the device memory back."""
        for held in (*self._codes.values(), *self._places.values(), self._planes):
            if held is not None:
                held.release()
        self._codes.clear()
        self._places.clear()

    def _place(self, square: Square) -> GrainPlace:
        if square not in self._places:
            self._places[square] = grain_place(
                self._device, self._located, self._settings, None, square
            )
        return self._places[square]
