"""Baking: every frame of an animation as files of displacement, by an engine in this process."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache, cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rhytid.baking.assets import finish
from rhytid.baking.frame_names import FramePlace
from rhytid.baking.frames import FrameFiles
from rhytid.baking.output import BakeRecord, Output
from rhytid.baking.run_warnings import RunWarnings
from rhytid.domain.mesh import Mesh
from rhytid.engine.messages import AssetInfo, MapQuery
from rhytid.exports.displaced import Subdivided
from rhytid.exports.meshes import mesh_format
from rhytid.exports.textures.frame_map import Chart, FrameMap, Padding
from rhytid.exports.textures.profiles import Profile
from rhytid.exports.textures.tangents import Posed
from rhytid.exports.textures.writers import corner_weights
from rhytid.support.atomic_files import atomic_write, write_file
from rhytid.support.console import Stopwatch, counted, detail

if TYPE_CHECKING:
    from rhytid.engine.engine import Engine
    from rhytid.engine.messages import TilePlan

Texels = NDArray[np.float32]
# Of the digest of a frame, in keys of files.
_DIGITS = 16


@dataclass
class Baker:
    """Draws the frames of one asset and writes them as files, by the engine of this process.

    written, skipped: number of files that were written, or were there already.
    """

    engine: Engine
    asset: AssetInfo
    mesh: Mesh
    query: MapQuery
    frames: FrameFiles
    output: Output
    watch: Stopwatch
    warnings: RunWarnings
    geometry: Geometry | None = None
    written: int = 0
    skipped: int = 0

    def calibrate(self) -> None:
        """Set the range of the precomputed maps from the frame that stretches most. All frames
        count, also where only some are baked, so that parts fit together."""
        places = counted(self.frames.places, "measuring", "frame")
        most = max(places, key=lambda place: self._measure(place))
        with self.watch.step("bins"):
            job = self.engine.assets.calibrate(self.asset.id, self.frames.read(most))
            finish(self.engine, job, "bins")

    def run(self) -> None:
        """Write every file that is missing or out of date."""
        places = self.output.places(self.frames.places)
        self.write(counted(places, "baking", "frame"))

    def write(self, places: Iterable[FramePlace]) -> None:
        """Write the files of these frames that are missing or out of date. A frame is done when the
        next one is taken from `places`."""
        record = self.output.record(self.engine.tiles.drawn_by)
        for place in places:
            with self.watch.step("stretch"):
                self._put(place)
            self._frame(record, place)
            self.engine.frames.delete(self.asset.id, place.label)
        if self.written:
            self.warnings.drawn_by(self.output.drawn_by(self.engine.tiles.drawn_by))

    def _frame(self, record: BakeRecord, place: FramePlace) -> None:
        """Write the maps and the surface of a frame that the engine holds."""
        surface = self._sources.surface(place.label, partial(self.frames.read, place))
        plans, heights = {}, {}
        for udim in self.asset.udims:
            plan = plans[udim] = self._plan(place, udim)
            drawn = self._sources.map(surface, plan, cache(partial(self._draw, plan)))
            self.output.describe(drawn)
            for profile in self.output.profiles:
                file = self.output.file(profile, udim, place)
                self._map(record, profile, file, plan, drawn, surface)
            if self.geometry is not None:  # else each map is let go after its UDIM
                heights[udim] = drawn.bordered
        if self.geometry is not None:
            self._surface(self.geometry, record, place, plans, heights, surface)

    @cached_property
    def _sources(self) -> MapSources:
        return MapSources(self.engine, self.asset, self.mesh)

    def _plan(self, place: FramePlace, udim: int) -> TilePlan:
        return self.engine.tiles.plan_map(self.asset.id, place.label, self.query, udim, 0)

    def _draw(self, plan: TilePlan) -> Texels:
        with self.watch.step(self.query.method):
            return plan.draw()

    def _map(
        self,
        record: BakeRecord,
        profile: Profile,
        file: Path,
        plan: TilePlan,
        drawn: FrameMap,
        surface: FrameSurface,
    ) -> None:
        """Write one map in one profile, unless it is done."""
        # A map of the neutral is the same in all frames, what is made of positions is not.
        key = f"{plan.key}-{profile.key}{surface.digest() if profile.posed else ''}"
        if record.done(file, key):
            detail(f"{file.name} is already there")
            self.skipped += 1
            return
        if profile.drawn:
            drawn.heights()
        with self.watch.step("write"):
            profile.write(file, drawn, profile.all_facts(drawn))
            record.add(file, key)
        detail(f"wrote {file.name}")
        self.written += 1

    def _surface(
        self,
        geometry: Geometry,
        record: BakeRecord,
        place: FramePlace,
        plans: Mapping[int, TilePlan],
        heights: Mapping[int, Callable[[], Texels]],
        surface: FrameSurface,
    ) -> None:
        """Write the surface that the maps of a frame displace, unless it is done."""
        file = self.output.geometry_file(place, geometry.format)
        keys = [surface.digest(), *(plan.key for plan in plans.values())]
        key = hashlib.sha256("\n".join([*keys, geometry.words]).encode()).hexdigest()
        if record.done(file, key):
            self.skipped += 1
            return
        maps = {udim: draw() for udim, draw in heights.items()}
        with self.watch.step("geometry"):
            geometry.write(file, self.frames.read(place), maps)
            record.add(file, key)
        detail(f"wrote {file.name}")
        self.written += 1

    def _measure(self, place: FramePlace) -> float:
        """The 90th percentile of the absolute log stretch of a frame."""
        size = self._put(place)
        self.engine.frames.delete(self.asset.id, place.label)
        return size

    def _put(self, place: FramePlace) -> float:
        positions = self.frames.read(place)
        info = self.engine.frames.put(self.asset.id, place.label, positions)
        self.warnings.frame(info.warnings, place.name)
        return info.log_stretch["abs_p90"]


@dataclass(frozen=True, eq=False)
class FrameSurface:
    """The surface of one frame; each part is computed when it is first called.

    digest: 16 hex digits that name the positions.  posed: the mesh in the frame, for normal maps.
    weights: stretch as weights of corners.
    """

    digest: Callable[[], str]
    posed: Callable[[], Posed]
    weights: Callable[[], NDArray[np.float64]]


class MapSources:
    """Makes the maps of an asset from its mesh and its frames.

    Charts are kept, 10 bytes per texel of each UDIM, and so are paddings, which are small.
    """

    def __init__(self, engine: Engine, asset: AssetInfo, mesh: Mesh) -> None:
        self._engine, self._asset, self._mesh = engine, asset, mesh
        self._depth = float(asset.settings["depth"] or 0.0)
        self._reach = int(asset.settings["padding"])
        self._charts: dict[int, Chart] = {}
        self._paddings: dict[int, Padding] = {}

    def surface(self, frame: str, positions: Callable[[], NDArray[np.float32]]) -> FrameSurface:
        """The surface of a frame that the engine holds.  positions: reads (V, 3) positions."""
        engine, asset, mesh = self._engine, self._asset.id, self._mesh
        return FrameSurface(
            cache(lambda: engine.frames.digest(asset, frame)[:_DIGITS]),
            cache(lambda: Posed.of(mesh, positions())),
            cache(lambda: corner_weights(mesh, engine.frames.stretch(asset, frame).ratios)),
        )

    def map(
        self, surface: FrameSurface, plan: TilePlan, heights: Callable[[], NDArray[np.float32]]
    ) -> FrameMap:
        """The map of a plan.  heights: draws its displacement."""
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


class Geometry:
    """Displaced surfaces of a mesh, each of whose triangles is cut in four `levels` times.

    format: `glb` or `ply`.  words: what makes these surfaces differ from others of the same maps.
    """

    def __init__(self, mesh: Mesh, format: str, levels: int) -> None:
        self.format, self.words = format, f"{format} {levels} padded"
        self._cut = Subdivided.of(mesh, levels)

    def write(self, file: Path, positions: NDArray[np.float32], maps: Mapping[int, Texels]) -> None:
        """Write the surface of a frame; the file appears when it is complete.  positions: (V, 3).
        maps: displacement by UDIM."""
        data = mesh_format(self.format).write(self._cut.moved(positions, maps))
        with atomic_write(file) as aside:
            write_file(aside, data)
