"""The cost of a bake: its kernels alone, its files alone, both in turn, and the bake itself.

A bake draws the next frames while others are written, so that at best it takes the processor time
of its kernels and of its files, over the cores. Seconds are of one frame; processor seconds are of
all threads of this process, those of an OpenCL runtime on the processor included. On a GPU the
kernels take little of the processor, and the ratio to them means nothing.

Windows has no `resource`: this does not run there.
"""

from __future__ import annotations

import resource
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from statistics import median

import numpy as np
from numpy.typing import NDArray

from rhytid.baking.assets import build
from rhytid.baking.baker import Baker
from rhytid.baking.frame_names import FramePlace
from rhytid.baking.frames import FrameFiles
from rhytid.baking.map_sources import Geometry, MapSources
from rhytid.baking.output import Output
from rhytid.baking.request import Lag
from rhytid.baking.run_warnings import RunWarnings
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.mesh import Mesh
from rhytid.engine.engine import Engine
from rhytid.engine.messages import AssetInfo, MapQuery, NewAsset
from rhytid.exports.textures.frame_map import FrameMap
from rhytid.exports.textures.profiles import PROFILES, halves_are_enough
from rhytid.formats.meshes import MeshFile
from rhytid.support.console import Stopwatch
from rhytid.support.cores import core_count
from rhytid.support.settings import ServiceSettings
from rhytid.support.temporary_folders import temporary_folder

METHODS = ("redraw", "binned")
# What is written of each frame, by the number of UDIMs: profiles, and the format of surfaces where
# there are some.
WRITTEN: Mapping[int, tuple[tuple[str, ...], ...]] = {
    1: (
        ("half",), ("float",), ("half", "glb"), ("half", "png16", "cavity"), ("half", "normal-gl"),
    ),
    4: (("half",), ("float",)),
}  # fmt: skip
# Frames that are drawn before time is taken: what a device keeps of one frame for the next is there
# then.
BEFORE = 2
# Frames that `--bake` needs, at least: kernels and files are timed in each of them, and the median
# counts; the bake itself is timed in those after BEFORE.
LEAST_FRAMES = 5
_SUBDIVIDED = 1


@dataclass(frozen=True)
class Spent:
    """Seconds of a frame: medians of the wall clock and of the processor, all cores together."""

    seconds: float
    processor: float


@dataclass(frozen=True)
class BakeCost:
    """What a frame of a bake costs.

    kernels: level 0 of all maps, left on the device.  drawn: the same, read to the host.  files:
    the files of the frame, of maps that are drawn.  bake: the bake itself. `drawn` and `files` one
    after the other are a bake without threads.
    """

    method: str
    written: str
    udims: int
    kernels: Spent
    drawn: Spent
    files: Spent
    bake: Spent

    @property
    def ratio(self) -> float:
        """Wall clock of the bake to the processor time of kernels and files over the cores."""
        return self.bake.seconds / (self._least / core_count())

    @property
    def work(self) -> float:
        """Processor time of the bake to that of kernels and files."""
        return self.bake.processor / self._least

    @property
    def _least(self) -> float:
        return self.kernels.processor + self.files.processor


class BakeBench:
    """An engine with one asset, whose frames are baked.

    frames: (N, V, 3) float32 positions that all differ, N of 3 or more; more make the figures
    steadier.
    """

    def __init__(
        self, engine: Engine, mesh: Mesh, frames: NDArray[np.float32], settings: AssetSettings
    ) -> None:
        self._engine, self._mesh = engine, mesh
        self._warnings = RunWarnings("bench", False)
        self._frames = FrameFiles(MeshFile(mesh, frames), [])
        self.asset: AssetInfo = build(engine, NewAsset(mesh, settings), self._warnings)
        self._sources = MapSources(engine, self.asset, mesh, self._frames, Lag())

    def cost(self, method: str, written: Sequence[str]) -> BakeCost:
        """Measure what files of a frame cost, drawn by a method."""
        profiles = [name for name in written if name in PROFILES]
        formats = [name for name in written if name not in PROFILES]
        geometry = Geometry(self._mesh, formats[0], _SUBDIVIDED) if formats else None
        query = MapQuery(method)
        with (
            temporary_folder("rhytid-bench-") as folder,
            temporary_folder("rhytid-bench-") as baked,
        ):
            output = Output(folder, "face", tuple(PROFILES[name] for name in profiles))
            maker = _Maker(self._engine, self.asset, self._sources, query, output, geometry)
            places = self._frames.places
            kernels = _middle([maker.kernels(place, self._frames) for place in places])
            apart = [maker.drawn_and_written(place, self._frames) for place in places]
            drawn, files = (_middle(each) for each in zip(*apart, strict=True))
            # A bake looks for files that are there: none of those that were just written.
            baker = Baker(
                self._engine, self.asset, self._mesh, query, self._frames,
                replace(output, folder=baked), Stopwatch(), self._warnings, geometry,
            )  # fmt: skip
            udims = len(self.asset.udims)
            return BakeCost(method, " ".join(written), udims, kernels, drawn, files, _bake(baker))


def that_differ(frames: NDArray[np.float32]) -> NDArray[np.float32]:
    """The frames that differ from all before them: a bake copies the files of the others."""
    first: dict[bytes, int] = {}
    for index, frame in enumerate(frames):
        first.setdefault(frame.tobytes(), index)
    kept: NDArray[np.float32] = frames[list(first.values())]
    return kept


def four_udims(mesh: Mesh, frames: NDArray[np.float32]) -> tuple[Mesh, NDArray[np.float32]]:
    """Four copies of a mesh beside one another, each on a UDIM of its own, and their frames."""
    count, points = len(mesh.positions), len(mesh.uv)
    wide = np.array([1.1 * np.ptp(mesh.positions[:, 0]), 0.0, 0.0])
    four = Mesh(
        np.concatenate([mesh.positions + i * wide for i in range(4)]),
        np.concatenate([mesh.faces + i * count for i in range(4)]),
        np.concatenate([mesh.uv + np.array([i, 0.0]) for i in range(4)]),
        np.concatenate([mesh.face_uv + i * points for i in range(4)]),
    )
    moved = [frames + (i * wide).astype(np.float32) for i in range(4)]
    return four, np.concatenate(moved, axis=1)


@contextmanager
def bake_bench(
    service: ServiceSettings, mesh: Mesh, frames: NDArray[np.float32], settings: AssetSettings
) -> Iterator[BakeBench]:
    """A bench with an engine of its own, which lasts as long as the block."""
    with temporary_folder("rhytid-bench-") as folder:
        own = replace(service, store=folder / "store", build_seconds=None)
        with closing(Engine(own)) as engine:
            yield BakeBench(engine, mesh, frames, settings)


@dataclass(frozen=True)
class _Maker:
    """Makes the parts of a frame one after the other."""

    engine: Engine
    asset: AssetInfo
    sources: MapSources
    query: MapQuery
    output: Output
    geometry: Geometry | None

    def kernels(self, place: FramePlace, frames: FrameFiles) -> Spent:
        """What the kernels of a frame take, that of its stretch included."""
        asset, label, positions = self.asset.id, place.label, frames.read(place)

        def draw() -> None:
            self.engine.frames.put(asset, label, positions)
            for udim in self.asset.udims:
                self.engine.tiles.draw_unread(asset, label, self.query, udim)
            self.engine.frames.delete(asset, label)

        return _timed(draw)

    def drawn_and_written(self, place: FramePlace, frames: FrameFiles) -> tuple[Spent, Spent]:
        """What drawing of a frame takes with the read of its maps, and what its files take. The
        frame before is another one: the maps of the last frame are kept."""
        asset, label, positions = self.asset.id, place.label, frames.read(place)
        maps: list[FrameMap] = []
        enough = self.geometry is None and halves_are_enough(self.output.profiles)

        def draw() -> None:
            self.engine.frames.put(asset, label, positions)
            surface = self.sources.surface(place, positions)
            for udim in self.asset.udims:
                plan = self.engine.tiles.plan_map(asset, label, self.query, udim, 0)
                halves = plan.draw_halves if enough else None
                maps.append(self.sources.map(surface, plan, plan.draw, halves))
                maps[-1].halves()

        drawn = _timed(draw)
        files = _timed(partial(self._write, place, positions, maps))
        self.engine.frames.delete(asset, label)
        return drawn, files

    def _write(
        self, place: FramePlace, positions: NDArray[np.float32], maps: Sequence[FrameMap]
    ) -> None:
        for map in maps:
            for profile in self.output.profiles:
                file = self.output.file(profile, map.header.udim, place)
                profile.write(file, map, profile.all_facts(map))
        if self.geometry is not None:
            heights = {map.header.udim: map.heights() for map in maps}
            paddings = {map.header.udim: map.padding() for map in maps}
            file = self.output.geometry_file(place, self.geometry.format)
            self.geometry.write(file, positions, heights, paddings)


def _bake(baker: Baker) -> Spent:
    """What a bake takes of a frame. The files of other runs are in its folder, without a record, so
    that all are written anew."""
    first, rest = baker.frames.places[:BEFORE], baker.frames.places[BEFORE:]
    baker.write(first, first)
    whole = _timed(lambda: baker.write(rest, rest))
    return Spent(whole.seconds / len(rest), whole.processor / len(rest))


def _timed(work: Callable[[], object]) -> Spent:
    start, used = time.perf_counter(), _processor()
    work()
    return Spent(time.perf_counter() - start, _processor() - used)


def _processor() -> float:
    """Processor seconds of all threads of this process, those of the kernel for it included."""
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def _middle(frames: Sequence[Spent]) -> Spent:
    """The median of what some frames took, but for the first ones."""
    after = frames[BEFORE:]
    return Spent(median(one.seconds for one in after), median(one.processor for one in after))
