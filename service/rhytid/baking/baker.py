"""Baking: every frame of an animation as files of displacement, by an engine in this process.

One thread draws frame after frame, and others write the maps that it has drawn. How many maps wait
or are written is limited by the bytes that they take until then, `RHYTID_HOST_MEMORY_MB`. What is
kept for all frames, and the mesh of a displaced surface, are not counted.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from rhytid.baking.assets import finish
from rhytid.baking.due_files import DueMap, FileKeys, FrameInWork
from rhytid.baking.file_writers import FileWriters, all_written, release_after
from rhytid.baking.frame_names import FramePlace
from rhytid.baking.frames import FrameFiles
from rhytid.baking.map_sources import Geometry, MapSources, Texels, once
from rhytid.baking.output import BakeRecord, Origin, Output, mesh_facts
from rhytid.baking.request import Lag
from rhytid.baking.run_warnings import RunWarnings
from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import MapAddress
from rhytid.domain.warnings import FILES_REPLACED, METHODS_MIXED
from rhytid.engine.byte_budget import Hold
from rhytid.engine.messages import AssetInfo, MapQuery
from rhytid.exports.textures.frame_map import Facts, FrameMap
from rhytid.exports.textures.profiles import halves_are_enough
from rhytid.exports.textures.writers import write_parts
from rhytid.support.atomic_files import before_naming
from rhytid.support.build_identity import drawing_version
from rhytid.support.console import Stopwatch, counted, detail

if TYPE_CHECKING:
    from rhytid.engine.engine import Engine
    from rhytid.engine.messages import MapPlan

T = TypeVar("T")
# Bytes of the displacement of a texel.
_DISPLACEMENT = 4


@dataclass
class Baker:
    """Draws the frames of one asset and writes them as files, by the engine of this process.

    written, skipped: number of files that were written, or were there already.  replaced: of those
    written, how many took the place of a file that was not what is asked for.  worked: whether a
    file of the last frame that is done was written.
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
    lag: Lag = field(default_factory=Lag)
    written: int = 0
    skipped: int = 0
    replaced: int = 0
    worked: bool = False

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
        self.write(places, counted(places, "baking", "frame", worked=lambda: self.worked))
        output = self.output
        self.tell_origins(output.origins(self._origin) if self.written else output.left_origins())
        self.warnings.refuse()

    def tell_origins(self, found: Collection[Origin]) -> None:
        """Warn where several devices or methods drew the maps, once all parts are written."""
        self.warnings.origins(found, partial(self.output.by_method, self.frames.places))

    def refuse_replaced(self) -> None:
        """Where warnings are errors, raise StrictError if a file of any frame that is baked would
        be replaced, or if maps by another method stay; for a bake whose frames are written
        elsewhere, part by part. Which devices these parts have is not known: files of any device
        count as done."""
        self._refuse_mixed(self.output.places(self.frames.places))
        if self.warnings.refuses(FILES_REPLACED):
            places, record = self.output.places(self.frames.places), self._record()
            alike = {one for one in record.devices() if one.endswith(f"/{drawing_version()}")}
            with FileWriters(self.engine.memory.limit) as writers:
                self._refuse_replaced(record, writers, places, alike)

    def write(
        self,
        places: Sequence[FramePlace],
        shown: Iterable[FramePlace],
        *,
        checked: bool = False,
    ) -> None:
        """Write the files of these frames that are missing or out of date.

        shown: the same frames. A frame is done, its files are there, when the next one is taken
        from `shown`; those after it may be drawn by then. Where this raises, files that are being
        written are written to their end first, others that were drawn are not begun.  checked:
        whether `refuse_replaced` has gone over all frames, on whatever machine.
        """
        record = self._record()
        if not checked:
            self._refuse_mixed(places)
        with self.engine.tiles.memory_kept(), FileWriters(self.engine.memory.limit) as writers:
            if self.warnings.refuses(FILES_REPLACED) and not checked:
                self._refuse_replaced(record, writers, places)
            upcoming, ahead = iter(places), deque[list[Future[int]]]()
            for _ in shown:
                while len(ahead) < writers.ahead and not (ahead and all_written(ahead[0])):
                    if (place := next(upcoming, None)) is None:
                        break
                    ahead.append(self._frame(record, writers, place))
                written = sum(done.result() for done in ahead.popleft())
                self.written, self.worked = self.written + written, written > 0
        record.drop_replaced()

    def first_maps(self) -> tuple[Texels, Iterator[tuple[int, Texels]]]:
        """The first frame that is baked: its positions, and its maps by UDIM, each drawn when it is
        taken."""
        place = self.output.places(self.frames.places)[0]

        def drawn() -> Iterator[tuple[int, Texels]]:
            self._put(place)
            for udim in self.asset.udims:
                yield udim, self._draw(self._plan(place, udim).draw)
            self.engine.frames.delete(self.asset.id, place.label)

        return self.frames.read(place), drawn()

    def _frame(
        self, record: BakeRecord, writers: FileWriters, place: FramePlace
    ) -> list[Future[int]]:
        """Draw a frame, and have its files written. Each result is a number of files."""
        frame, plans = self._begun(record, writers, place)
        surface = self._due_surface(frame, plans)
        due = {udim: self._due_maps(frame, plan) for udim, plan in plans.items()}
        if surface or any(due.values()):
            # By now, for a bake that is killed has files of this device, too; and for each frame,
            # since a part that ends takes marks away that no record names yet.
            self.warnings.files_follow()
            self.output.leave_mark(self._origin)
        together = sum(self._map_bytes(one) for one in due.values())
        held = writers.hold(together) if surface else None
        found, drawn = [], {}
        for udim, plan in plans.items():
            halves = None
            if not surface and halves_are_enough(one.profile for one in due[udim]):
                halves = partial(self._draw, plan.draw_halves)
            map = self._sources.map(frame.surface, plan, partial(self._draw, plan.draw), halves)
            self.output.describe(map, self._mesh_facts)
            if due[udim]:
                found.append(self._begin(frame, map, due[udim], held))
            if surface:  # else each map is let go after its UDIM
                map.heights()
                drawn[udim] = map
        if surface:
            work = partial(self._write_surface, frame, surface, drawn)
            found.append(writers.submit(work))
        if held:
            release_after(held, found)
        self.engine.frames.delete(self.asset.id, place.label)
        return found

    def _begun(
        self, record: BakeRecord, writers: FileWriters, place: FramePlace
    ) -> tuple[FrameInWork, dict[int, MapPlan]]:
        """Give a frame to the engine; the plans of its maps by UDIM."""
        with self.watch.step("stretch"):
            positions, _ = self._put(place)
        frame = FrameInWork(place, self._sources.surface(place, positions), record, writers)
        return frame, {udim: self._plan(place, udim) for udim in self.asset.udims}

    def _refuse_mixed(self, places: Sequence[FramePlace]) -> None:
        """Where that is an error, raise StrictError if maps by another method will be beside those
        of these frames, before one is written."""
        if not self.warnings.refuses(METHODS_MIXED):
            return
        drawn = replace(self.output, profiles=tuple(p for p in self.output.profiles if p.drawn))
        format = self.geometry.format if self.geometry else None
        if own := drawn.names(places, self.asset.udims, format):
            now = dict.fromkeys(own, self._origin)
            self.warnings.methods(self.output.by_method(self.frames.places, now), "would be")
            self.warnings.refuse()

    def _refuse_replaced(
        self,
        record: BakeRecord,
        writers: FileWriters,
        places: Sequence[FramePlace],
        others: Collection[str] = (),
    ) -> None:
        """Raise StrictError where a file of any frame would be replaced, before one is written.
        others: devices whose files are not replaced either."""
        format = self.geometry.format if self.geometry else None
        there = {file.name for file in self.output.folder.iterdir()}
        held = [p for p in places if there & self.output.names([p], self.asset.udims, format)]
        for place in counted(held, "checking", "frame"):
            frame, plans = self._begun(record, writers, place)
            wanted = self._files.of_frame(frame, _keys(plans))
            for one in others:
                for file, keys in self._files.of_frame(frame, self._keys_by(one, place)).items():
                    wanted[file] |= keys
            for file, keys in wanted.items():
                if file.exists() and not any(record.done(file, key) for key in keys):
                    self.warnings.replaces(file, record.knows(file))
            self.engine.frames.delete(self.asset.id, place.label)

    def _keys_by(self, drawn_by: str, place: FramePlace) -> dict[int, str]:
        """The keys of the maps of a frame where another device draws them."""
        key = partial(self.engine.tiles.key, self.asset.id, place.label, self.query)
        return {udim: key(MapAddress(udim, 0), drawn_by) for udim in self.asset.udims}

    def _record(self) -> BakeRecord:
        return self.output.record(self.engine.tiles.drawn_by)

    @cached_property
    def _sources(self) -> MapSources:
        return MapSources(self.engine, self.asset, self.mesh, self.frames, self.lag)

    @property
    def _files(self) -> FileKeys:
        return FileKeys(self.output, self.geometry)

    @property
    def _origin(self) -> Origin:
        return Origin(self.engine.tiles.drawn_by, self.query.method)

    @cached_property
    def _mesh_facts(self) -> Callable[[], Facts]:
        return once(partial(mesh_facts, self.mesh))

    def _map_bytes(self, due: Sequence[DueMap]) -> int:
        """Bytes of a map until its files, one after another, are written. Those that are copied
        may have to be drawn."""
        working = max((one.profile.working_bytes for one in due), default=0)
        return (_DISPLACEMENT + working) * int(self.asset.settings["resolution"]) ** 2

    def _plan(self, place: FramePlace, udim: int) -> MapPlan:
        return self.engine.tiles.plan_map(self.asset.id, place.label, self.query, udim, 0)

    def _draw(self, draw: Callable[[], T]) -> T:
        with self.watch.step(self.query.method):
            return draw()

    def _due_maps(self, frame: FrameInWork, plan: MapPlan) -> list[DueMap]:
        """The files of one map that are not done."""
        return [
            DueMap(file, key, profile, frame.source(profile, file, key))
            for file, key, profile in self._files.of_map(frame, plan.header.udim, plan.key)
            if not self._is_done(frame, file, key)
        ]

    def _due_surface(
        self, frame: FrameInWork, plans: Mapping[int, MapPlan]
    ) -> tuple[Path, str] | None:
        """The file of the surface of a frame, and its key, unless it is done."""
        one = self._files.of_surface(frame, _keys(plans))
        return None if one is None or self._is_done(frame, *one) else one

    def _is_done(self, frame: FrameInWork, file: Path, key: str) -> bool:
        done = frame.record.done(file, key)
        if done:
            detail(f"{file.name} is already there")
            self.skipped += 1
        elif file.exists():
            if not self.replaced:  # told once, before the first of them is written
                self.warnings.replaces(file, frame.record.knows(file))
            self.replaced += 1
        return done

    def _begin(
        self, frame: FrameInWork, map: FrameMap, due: Sequence[DueMap], held: Hold | None
    ) -> Future[int]:
        """Draw a map, unless its files are copies, and have them written.  held: bytes of the
        frame; None to hold those of this map."""
        alone = None if held else frame.writers.hold(self._map_bytes(due))
        if any(one.profile.drawn and one.source is None for one in due):
            map.halves()
        if any(one.profile.posed and not one.profile.drawn for one in due):
            frame.surface.measured()  # which the engine has only while it holds the frame
        if any(one.profile.lagging for one in due):
            frame.surface.blood()  # frames are read on this thread alone
        future = frame.writers.submit(partial(self._write_maps, frame, map, due))
        if alone:
            release_after(alone, [future])
        frame.writers.note({one.key: one.file for one in due}, future)
        return future

    def _write_maps(self, frame: FrameInWork, map: FrameMap, due: Sequence[DueMap]) -> int:
        """Write the files of a map; on any thread."""
        for one in due:
            frame.writers.check()
            with self.watch.step("write"):
                method = self.query.method if one.profile.drawn else ""
                with before_naming(partial(frame.record.add, one.file, one.key, method)):
                    if not self._copied(frame, one):
                        # By which readers know maps of another mesh.
                        facts = {"triangles": len(self.mesh.faces), **one.profile.all_facts(map)}
                        one.profile.write(one.file, map, facts)
            detail(f"wrote {one.file.name}")
        return len(due)

    def _copied(self, frame: FrameInWork, one: DueMap) -> bool:
        """Write a file as a copy of one with the same key, with the name of its own frame;
        whether that was possible. The bytes that are copied have the hash that the record has of
        them. Raises what the writing of the other one did."""
        if one.source is None or one.profile.renamed is None:
            return False
        file, written = one.source
        if written is not None:
            written.result()
        data = frame.record.contents(file, one.key)
        if data is None:
            return False
        try:
            parts = one.profile.renamed(data, "frame", frame.place.label)
        except (KeyError, ValueError):
            return False
        write_parts(one.file, parts)
        return True

    def _write_surface(
        self, frame: FrameInWork, one: tuple[Path, str], drawn: Mapping[int, FrameMap]
    ) -> int:
        """Write a displaced surface; on any thread."""
        assert self.geometry is not None
        file, key = one
        maps = {udim: map.heights() for udim, map in drawn.items()}
        paddings = {udim: map.padding() for udim, map in drawn.items()}
        add = partial(frame.record.add, file, key, self.query.method)
        with self.watch.step("geometry"), before_naming(add):
            self.geometry.write(file, frame.surface.positions, maps, paddings)
        detail(f"wrote {file.name}")
        return 1

    def _measure(self, place: FramePlace) -> float:
        """The 90th percentile of the absolute log stretch of a frame."""
        _, size = self._put(place)
        self.engine.frames.delete(self.asset.id, place.label)
        return size

    def _put(self, place: FramePlace) -> tuple[Texels, float]:
        """Give a frame to the engine; its positions, and how it stretches."""
        positions = self.frames.read(place)
        info = self.engine.frames.put(self.asset.id, place.label, positions)
        self.warnings.frame(info.warnings, place.name)
        return positions, info.log_stretch["abs_p90"]


def _keys(plans: Mapping[int, MapPlan]) -> dict[int, str]:
    return {udim: plan.key for udim, plan in plans.items()}
