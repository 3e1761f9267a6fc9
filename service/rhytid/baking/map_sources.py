"""What the files of a bake are made from: surfaces of frames, maps, and displaced surfaces."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from rhytid.baking.blood import BloodFlow
from rhytid.baking.frame_names import FramePlace
from rhytid.baking.frames import FrameFiles
from rhytid.baking.request import Lag
from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import MapAddress
from rhytid.engine.device_assets.slopes import neighbour_codes
from rhytid.engine.frames import Frame
from rhytid.engine.messages import AssetInfo, Halves, MapQuery
from rhytid.exports.displaced import Samples, Subdivided
from rhytid.exports.meshes import mesh_format
from rhytid.exports.textures.frame_map import Chart, Facts, FrameMap, Padding, VertexField
from rhytid.exports.textures.normals import NormalChart
from rhytid.exports.textures.stretch import corner_weights, vertex_stretch
from rhytid.exports.textures.tangents import Posed
from rhytid.formats.tile_header import TileHeader
from rhytid.support.atomic_files import atomic_write, write_hashed

if TYPE_CHECKING:
    from rhytid.engine.engine import Engine
    from rhytid.engine.messages import FrameStretch, TilePlan

T = TypeVar("T")
Texels = NDArray[np.float32]
# Of the digest of a frame, in keys of files.
_DIGITS = 16


def once(make: Callable[[], T]) -> Callable[[], T]:
    """A function that calls `make` the first time and then returns the same; safe from any thread,
    the others wait for the first."""
    lock = threading.Lock()
    made: list[T] = []

    def found() -> T:
        with lock:
            if not made:
                made.append(make())
            return made[0]

    return found


@dataclass(frozen=True, eq=False)
class FrameSurface:
    """The surface of one frame; each part is computed when it is first called, once.

    positions: (V, 3).  digest: 16 hex digits that name the positions.  measured: how it stretches.
    `digest` and `measured` ask the engine, which must hold the frame.  history, blood: key and
    values of `BloodFlow`; they read files, on the thread that reads the frames.  posed: the mesh in
    the frame, for normal maps.  weights: stretch as weights of corners.  stretch: the same as a
    tensor. These three are safe from any thread.
    """

    positions: NDArray[np.float32]
    digest: Callable[[], str]
    measured: Callable[[], FrameStretch]
    history: Callable[[], str]
    blood: Callable[[], VertexField]
    posed: Callable[[], Posed]
    weights: Callable[[], NDArray[np.float64]]
    stretch: Callable[[], VertexField]


class MapSources:
    """Makes the maps of an asset from its mesh and its frames.

    Charts are kept: 10 bytes per texel of each UDIM, 14 where there are cavity maps, and 5 more
    where there are normal maps. Paddings, which are small, are kept, too. Safe from any thread.
    """

    def __init__(
        self, engine: Engine, asset: AssetInfo, mesh: Mesh, frames: FrameFiles, lag: Lag
    ) -> None:
        self._engine, self._asset, self._mesh = engine, asset, mesh
        self._flow = once(lambda: BloodFlow(mesh, frames, lag))
        self._lag: Facts = {"blood_seconds": lag.seconds, "fps": lag.fps}
        self._depth = float(asset.settings["depth"] or 0.0)
        self._reach = int(asset.settings["padding"])
        charts = {udim: once(partial(self._found_chart, udim)) for udim in asset.udims}
        paddings = {udim: once(partial(self._found_padding, udim)) for udim in asset.udims}
        self._charts, self._paddings = charts, paddings
        self._normal_charts = {
            udim: once(partial(self._found_normal_chart, udim)) for udim in asset.udims
        }

    def surface(self, place: FramePlace, positions: NDArray[np.float32]) -> FrameSurface:
        """The surface of a frame that the engine holds.  positions: (V, 3)."""
        engine, asset, mesh, frame = self._engine, self._asset.id, self._mesh, place.label
        measured = once(lambda: engine.frames.stretch(asset, frame))
        posed = once(lambda: Posed.of(mesh, positions))
        return FrameSurface(
            positions,
            once(lambda: engine.frames.digest(asset, frame)[:_DIGITS]),
            measured,
            once(lambda: self._flow().key(place)),
            once(lambda: self._flow().field(place)),
            posed,
            once(lambda: corner_weights(mesh, measured().ratios)),
            once(lambda: vertex_stretch(mesh, posed(), measured().ratios, measured().axes)),
        )

    def map(
        self,
        surface: FrameSurface,
        plan: TilePlan,
        heights: Callable[[], Texels],
        halves: Callable[[], Halves] | None = None,
    ) -> FrameMap:
        """The map of a plan.

        heights: draws its displacement.  halves: draws it as half floats, where nothing needs more.
        """
        heights = once(heights)
        udim = plan.header.udim
        return FrameMap(
            plan.header,
            self._depth,
            heights,
            once(halves) if halves else heights,
            self._paddings[udim],
            self._charts[udim],
            surface.posed,
            surface.weights,
            surface.stretch,
            surface.blood,
            self._lag,
            partial(self._slopes, surface, plan.header, heights),
            partial(self._normals, surface, udim, heights),
        )

    def _normals(
        self, surface: FrameSurface, udim: int, heights: Callable[[], Texels], green: int
    ) -> NDArray[np.uint16]:
        chart, posed = self._normal_charts[udim](), surface.posed()
        return self._engine.tiles.normal_codes(chart, posed, heights(), green)

    def _slopes(
        self, surface: FrameSurface, header: TileHeader, heights: Callable[[], Texels], level: int
    ) -> tuple[Texels, Texels]:
        """Moments (n, n, 5) of a level, and coverage (n, n)."""
        query = MapQuery(header.method, header.stretch, header.sampling)
        frame, place = Frame.of(surface.positions), MapAddress(header.udim, level)
        return self._engine.tiles.slope_moments(self._asset.id, frame, query, place, heights())

    def _found_chart(self, udim: int) -> Chart:
        return Chart.of(self._mesh, udim, self._triangles(udim))

    def _found_normal_chart(self, udim: int) -> NormalChart:
        triangles, mesh = self._triangles(udim), self._mesh
        return NormalChart.of(mesh, udim, triangles, neighbour_codes(mesh, udim, triangles))

    def _found_padding(self, udim: int) -> Padding:
        return Padding.of(self._mesh, udim, self._triangles(udim), self._reach)

    def _triangles(self, udim: int) -> NDArray[np.int32]:
        return self._engine.tiles.triangles(self._asset.id, udim)


class Geometry:
    """Displaced surfaces of a mesh, each of whose triangles is cut in four `levels` times.

    format: `glb` or `ply`.  words: what makes these surfaces differ from others of the same maps.
    """

    def __init__(self, mesh: Mesh, format: str, levels: int) -> None:
        self.format, self.words = format, f"{format} {levels} padded"
        self._cut = Subdivided.of(mesh, levels)
        # By UDIM and shape of the map: the same in all frames.
        self._samples: dict[tuple[int, tuple[int, ...]], Samples] = {}

    def write(
        self,
        file: Path,
        positions: NDArray[np.float32],
        maps: Mapping[int, Texels],
        paddings: Mapping[int, Padding] = MappingProxyType({}),
        *,
        curved: bool = False,
    ) -> str:
        """Write the surface of a frame; the file appears when it is complete. Returns its SHA-256.

        positions: (V, 3).  maps: displacement by UDIM.  paddings: of these maps, unless they are
        padded, the same in all frames.  curved: as `Subdivided.moved` has it. Safe from any thread.
        """
        samples = {
            udim: self._samples_of(udim, map.shape, paddings.get(udim))
            for udim, map in maps.items()
        }
        moved = self._cut.moved(positions, maps, curved=curved, samples=samples)
        data = mesh_format(self.format).write(moved)
        with atomic_write(file) as aside:
            return write_hashed(aside, [data])

    def _samples_of(self, udim: int, shape: tuple[int, ...], padding: Padding | None) -> Samples:
        """Where a map is read: the few texels of a padding where they lie, not in a copy of it."""
        found = self._samples.get((udim, shape))
        if found is None:
            found = self._cut.samples(udim, shape)
            if padding is not None:
                found = replace(found, texels=padding.sources_of(found.texels))
            self._samples[udim, shape] = found
        return found
