"""The part of a cluster bake that draws: a job as plain data, and the session of a worker."""

from __future__ import annotations

import hashlib
import pickle
import shutil
import zlib
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from pathlib import Path
from threading import RLock

import numpy as np
from tqdm import tqdm  # type: ignore[import-untyped]

from rhytid.baking.assets import stored
from rhytid.baking.baker import Baker
from rhytid.baking.farm.chunks import Chunk
from rhytid.baking.frame_names import FramePlace, FrameRange
from rhytid.baking.frames import FrameFiles, frame_sources
from rhytid.baking.input_files import mesh_file
from rhytid.baking.inputs import BakeInputs
from rhytid.baking.map_sources import Geometry
from rhytid.baking.output import Output
from rhytid.baking.request import BakeRequest, Lag
from rhytid.baking.run_warnings import RunWarnings
from rhytid.domain.mesh import Mesh
from rhytid.domain.warnings import InputWarning
from rhytid.engine.engine import Engine
from rhytid.engine.messages import MapQuery
from rhytid.errors import InputError
from rhytid.exports.textures import Shine
from rhytid.exports.textures.profiles import profiles_of
from rhytid.formats.frame_set import Clip
from rhytid.storage.store import AssetStore
from rhytid.support.atomic_files import prepared_in
from rhytid.support.build_identity import check_drawing, drawing_version
from rhytid.support.console import Stopwatch, Verbosity, use_verbosity
from rhytid.support.settings import ServiceSettings

_SILENT = Verbosity(quiet=True)


@dataclass(frozen=True)
class WorkerJob:
    """All that a worker needs to bake some of the frames. It can be pickled.

    mesh_digest: SHA-256 of the arrays of the mesh.  frames: all frames, with absolute paths.
    files: of the frames that are baked.  snapshot: of the built asset, whose id is `asset`.  out:
    folder of the maps.  geometry: format of displaced surfaces, if there are any.  drawing:
    `drawing_version` of the machine that made the job.
    """

    mesh: SharedFile
    mesh_digest: str
    frames: tuple[FramePlace, ...]
    files: tuple[SharedFile, ...]
    clip: Clip
    snapshot: SharedFile
    asset: str
    out: str
    name: str
    profiles: tuple[str, ...]
    compression: str
    blood_seconds: float
    shine: Shine
    geometry: str | None
    subdivide: int
    query: MapQuery
    strict: bool
    allow: tuple[str, ...]
    drawing: str

    @classmethod
    def of(
        cls,
        request: BakeRequest,
        inputs: BakeInputs,
        baker: Baker,
        snapshot: Path,
        baked: Sequence[FramePlace],
    ) -> WorkerJob:
        """The job of a bake.  snapshot: file with its asset.  baked: frames that are baked."""
        return cls(
            mesh=SharedFile.of(request.mesh),
            mesh_digest=mesh_digest(baker.mesh),
            frames=tuple(map(_resolved, baker.frames.places)),
            files=tuple(map(SharedFile.of, frame_sources(baked))),
            clip=request.clip,
            snapshot=SharedFile.of(snapshot),
            asset=baker.asset.id,
            out=str(request.out.resolve()),
            name=inputs.name,
            profiles=tuple(profile.name for profile in request.profiles),
            compression=request.compression,
            blood_seconds=request.blood_seconds,
            shine=request.shine,
            geometry=request.geometry,
            subdivide=request.subdivide,
            query=baker.query,
            strict=request.strict,
            allow=tuple(request.allow),
            drawing=drawing_version(),
        )

    def session(self, folder: Path) -> BakeSession:
        """Open a session for this job.  folder: where it keeps its store; must not exist."""
        return BakeSession(self, folder)

    def check(self) -> None:
        """Raise InputError where the mesh or the snapshot is missing here, or where this release
        draws differently."""
        check_drawing(self.drawing)
        self.mesh.check()
        self.snapshot.check()

    def check_mesh(self, mesh: Mesh) -> None:
        """Raise InputError where the file of the mesh holds another mesh here."""
        if mesh_digest(mesh) != self.mesh_digest:
            raise InputError(
                f"{self.mesh.path} holds another mesh than on the machine that began the bake"
            )

    def check_frames(self, places: Iterable[FramePlace]) -> None:
        """Raise InputError where the file of one of these frames is missing here, or has another
        size."""
        paths = set(map(str, frame_sources([*places])))
        for file in self.files:
            if file.path in paths:
                file.check()


def packed(job: WorkerJob) -> bytes:
    """A job as it is sent with each task. It is compressed, since names of frames are alike."""
    return zlib.compress(pickle.dumps(job))


def unpacked(job: bytes) -> WorkerJob:
    """The inverse of `packed`."""
    found: WorkerJob = pickle.loads(zlib.decompress(job))
    return found


class BakeSession:
    """An engine with the asset of a job, which bakes chunk after chunk. One thread uses it at a
    time.

    folder: where the store of the engine is made, removed when the session is closed. Raises what
    `WorkerJob.check`, `WorkerJob.check_mesh` and `stored` do.
    """

    def __init__(self, job: WorkerJob, folder: Path) -> None:
        job.check()
        self._job = job
        # In place of a semaphore of the system, which a process that is killed would leave behind.
        tqdm.set_lock(RLock())
        folder.mkdir(mode=0o700)  # what is removed is ours then
        with ExitStack() as opened, use_verbosity(_SILENT):
            opened.callback(shutil.rmtree, folder, ignore_errors=True)
            with AssetStore(folder) as store:
                store.snapshots.restore(Path(job.snapshot.path))
            self._engine = opened.enter_context(closing(Engine(_settings(folder))))
            self._baker = self._made()
            # The client removes it when the bake ends, also where this process has been killed.
            opened.enter_context(prepared_in(Path(job.snapshot.path).parent, Path(job.out)))
            self._opened = opened.pop_all()

    def bake(self, chunk: Chunk, done: Callable[[str, bool], None]) -> ChunkReport:
        """Write the files of a chunk that are missing, and return a report that can be pickled.

        done: called with the label of each frame when its files are there, and whether one was
        written. An exception that it raises ends the chunk between two frames. Raises what
        `Baker.write` does.
        """
        watch, job = Stopwatch(), self._job
        warnings = UnprintedWarnings("bake", job.strict, job.allow)
        part = FrameRange(chunk.numbers)
        baker = self._baker
        baker.output = replace(baker.output, part=part)
        baker.watch, baker.warnings = watch, warnings
        baker.written = baker.skipped = baker.replaced = 0
        with use_verbosity(_SILENT):
            places = baker.output.places(baker.frames.places)
            job.check_frames(places)
            # The machine that began the bake has looked at the files of all frames.
            baker.write(places, _reporting(baker, places, done), checked=True)
        counts = baker.written, baker.skipped, baker.replaced
        return ChunkReport(*counts, tuple(warnings.found), watch.seconds)

    def close(self) -> None:
        """Close the engine, and remove its store."""
        self._opened.close()

    def _made(self) -> Baker:
        job = self._job
        file = mesh_file(Path(job.mesh.path), job.clip)
        job.check_mesh(file.mesh)
        frames = FrameFiles(file, job.frames if job.files else [], job.clip)
        asset = stored(self._engine, job.asset, file.mesh)
        geometry = Geometry(file.mesh, job.geometry, job.subdivide) if job.geometry else None
        profiles = profiles_of([*job.profiles], job.compression, job.shine)
        output = Output(Path(job.out), job.name, profiles)
        warnings = UnprintedWarnings("bake", job.strict, job.allow)
        return Baker(
            self._engine,
            asset,
            file.mesh,
            job.query,
            frames,
            output,
            Stopwatch(),
            warnings,
            geometry,
            Lag(job.blood_seconds, job.clip.fps),
        )


@dataclass(frozen=True)
class ChunkReport:
    """The result of a chunk.

    written, skipped, replaced: numbers of files.  warnings: of its frames.  seconds: of each call,
    by step.
    """

    written: int
    skipped: int
    replaced: int
    warnings: tuple[InputWarning, ...]
    seconds: dict[str, list[float]]


class UnprintedWarnings(RunWarnings):
    """Warnings that are sent to the machine that began the bake, which prints them."""

    def __init__(self, command: str, strict: bool, allow: Collection[str] = ()) -> None:
        super().__init__(command, strict, allow)
        self._done = "and files of other frames may be written"

    def add(self, warnings: Iterable[InputWarning]) -> None:
        """Add warnings, each once."""
        self.found += [one for one in dict.fromkeys(warnings) if one not in self.found]


def _settings(store: Path) -> ServiceSettings:
    """The settings of this machine, with another store and no shared one."""
    here = ServiceSettings.from_environment()
    return replace(here, store=store, shared_store=None, build_seconds=None)


def _reporting(
    baker: Baker, places: Iterable[FramePlace], done: Callable[[str, bool], None]
) -> Iterator[FramePlace]:
    """Yield the frames. The label of each is reported when the next is asked for: its files are
    there by then."""
    for place in places:
        yield place
        done(place.label, baker.worked)


@dataclass(frozen=True)
class SharedFile:
    """A file that several machines read at the same path.

    path: absolute.  nbytes: its size, by which another file of this name is noticed.
    """

    path: str
    nbytes: int

    @classmethod
    def of(cls, path: Path) -> SharedFile:
        """The file at a path of this machine."""
        place = path.resolve()
        return cls(str(place), place.stat().st_size)

    def check(self) -> Path:
        """Return the path. Raises InputError naming it where the file is missing here, or has
        another size."""
        path = Path(self.path)
        if not path.is_file():
            raise InputError(f"no such file: {path}; paths of a cluster are the same everywhere")
        if path.stat().st_size != self.nbytes:
            raise InputError(f"{path} has {path.stat().st_size} bytes, not {self.nbytes}")
        return path


def mesh_digest(mesh: Mesh) -> str:
    """SHA-256 of the arrays of a mesh. Its file would not do: it may hold the frames of a film."""
    digest = hashlib.sha256()
    for array in (mesh.positions, mesh.faces, mesh.uv, mesh.face_uv, mesh.centre):
        digest.update(f"{array.dtype.str} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _resolved(place: FramePlace) -> FramePlace:
    """The same frame with an absolute path."""
    return place if place.file is None else replace(place, file=place.file.resolve())
