"""A bake on a worker of a cluster: one engine with one asset, for chunk after chunk."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from pathlib import Path
from threading import RLock

from tqdm import tqdm  # type: ignore[import-untyped]

from rhytid.cli.bake_output import Output
from rhytid.cli.baking import Baker, Geometry
from rhytid.cli.dask_job import WorkerJob
from rhytid.cli.frame_files import FrameFiles, FramePlace
from rhytid.cli.frame_range import FrameRange
from rhytid.cli.input_files import mesh_file
from rhytid.cli.ready_assets import stored
from rhytid.cli.serve import chosen
from rhytid.cli.timing import Stopwatch
from rhytid.cli.voice import Voice, speaking
from rhytid.cli.warned import Warned
from rhytid.domain.warnings import InputWarning
from rhytid.engine.engine import Engine
from rhytid.exports.textures.profiles import profiles_of
from rhytid.farm.chunks import Chunk
from rhytid.storage.store import AssetStore

_SILENT = Voice(quiet=True)


@dataclass(frozen=True)
class BakeReport:
    """What a chunk came to.

    written, skipped: files.  warnings: of its frames.  seconds: of each call, by step.
    """

    written: int
    skipped: int
    warnings: tuple[InputWarning, ...]
    seconds: dict[str, list[float]]


class Gathered(Warned):
    """Warnings that are not printed, but sent to where they are."""

    def tell(self, warnings: Iterable[InputWarning]) -> None:
        """Keep what is new."""
        self.warnings += [one for one in dict.fromkeys(warnings) if one not in self.warnings]


class BakeSession:
    """The engine of a worker with the asset of a job, out of its snapshot.

    folder: for the store, new; it is removed when the session is closed. Raises InputError naming
    the file where one is missing or another than the job says, and what `stored` does.
    """

    def __init__(self, job: WorkerJob, folder: Path) -> None:
        job.check()
        self._job = job
        # In place of a semaphore of the system, which a process that is killed would leave behind.
        tqdm.set_lock(RLock())
        folder.mkdir(mode=0o700)  # what is removed is ours then
        with ExitStack() as opened, speaking(_SILENT):
            opened.callback(shutil.rmtree, folder, ignore_errors=True)
            with AssetStore(folder) as store:
                store.snapshots.restore(Path(job.snapshot.path))
            settings = chosen(folder, None)
            self._engine = opened.enter_context(closing(Engine(settings)))
            self._baker = self._made()
            self._opened = opened.pop_all()

    def bake(self, chunk: Chunk, done: Callable[[str], None]) -> BakeReport:
        """Write the files of a chunk that are not there; calls `done` with the label of each frame
        whose files are. Raises what `Baker` does."""
        watch, job = Stopwatch(), self._job
        warned = Gathered("bake", job.strict, job.allow)
        part = FrameRange(chunk.numbers)
        baker = self._baker
        baker.output = replace(baker.output, part=part)
        baker.watch, baker.warned, baker.written, baker.skipped = watch, warned, 0, 0
        with speaking(_SILENT):
            places = baker.output.places(baker.frames.places)
            job.check_frames(places)
            baker.write(_telling(places, done))
        return BakeReport(baker.written, baker.skipped, tuple(warned.warnings), watch.seconds)

    def close(self) -> None:
        """End the engine, and remove the store."""
        self._opened.close()

    def _made(self) -> Baker:
        job = self._job
        file = mesh_file(Path(job.mesh.path), job.clip)
        job.check_mesh(file.mesh)
        frames = FrameFiles(file, job.frames if job.files else [], job.clip)
        asset = stored(self._engine, job.asset, file.mesh)
        geometry = Geometry(file.mesh, job.geometry, job.subdivide) if job.geometry else None
        output = Output(Path(job.out), job.name, profiles_of([*job.profiles]))
        warned = Gathered("bake", job.strict, job.allow)
        return Baker(
            self._engine, asset, file.mesh, job.query, frames, output, Stopwatch(), warned, geometry
        )


def _telling(places: Iterable[FramePlace], done: Callable[[str], None]) -> Iterator[FramePlace]:
    """The frames, each told when the next is asked for: then its files are there."""
    for place in places:
        yield place
        done(place.label)
