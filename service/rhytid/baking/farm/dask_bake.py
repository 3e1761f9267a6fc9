"""A bake on the workers of a Dask cluster: `rhytid bake --dask`."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from rhytid.baking.baker import Baker
from rhytid.baking.farm.bake_session import ChunkReport, WorkerJob
from rhytid.baking.farm.chunks import Chunk, Event, FrameDone, WorkerLost, WorkerUnable
from rhytid.baking.farm.dask_cluster import (
    Cluster,
    check_installed,
    local_cluster,
    running_cluster,
)
from rhytid.baking.farm.dask_run import DaskRun
from rhytid.baking.frame_names import FramePlace, FrameRange
from rhytid.baking.inputs import BakeInputs
from rhytid.baking.request import LOCAL, BakeRequest
from rhytid.device.select import candidates
from rhytid.support.atomic_files import READABLE, shared_working_folder, sweep, write_pieces
from rhytid.support.console import counted, detail, note, verbosity, working
from rhytid.support.temporary_folders import temporary_folder

# Tasks for each worker, where nothing says how large they are: so many that none waits long for the
# last of the others.
_TASKS = 4
# And so small that a worker that comes later gets some, too.
_LARGEST = 50
# Processes on one device: while one writes, the other draws.
_ON_ONE = 2
# Until the first frame is there.
_OPENING = "workers start and open the skin"


@dataclass
class DaskFigures:
    """Figures of a bake on a cluster.

    workers: number that baked a frame.  lost: number of these that left before the end.
    snapshot_bytes: size of the asset that each worker reads.
    """

    workers: int = 0
    lost: int = 0
    tasks: int = 0
    snapshot_bytes: int = 0


class DaskBake:
    """Bakes the frames of a Baker on a cluster. The Baker counts the files, too.

    figures: of the run.
    """

    def __init__(self, request: BakeRequest, inputs: BakeInputs, baker: Baker) -> None:
        self._request, self._inputs, self._baker = request, inputs, baker
        self._out = request.out.resolve()
        self._numbers = inputs.numbers
        self._chunks: list[FrameRange] = []
        self._worked = self._wrote = False
        self.figures = DaskFigures()

    def run(self) -> None:
        """Bake every frame. Raises what `Baker.run` does, with the address of the worker where that
        is the cause, and FarmError where the cluster does not work."""
        self._baker.refuse_replaced()
        before = self._baker.output.records()
        try:
            self._on_cluster()
        except BaseException:
            if self._chunks:  # one that fails does not say what it has written
                self._tell_origins()
            raise
        self._baker.output.drop_replaced(before, self._chunks)
        self._tell_origins()
        self._baker.warnings.refuse()

    def _on_cluster(self) -> None:
        mine, ended = self._request.dask == LOCAL, False
        # The snapshot is beside the maps, where all workers find it.
        with shared_working_folder(self._out) as shared:
            try:
                with bake_cluster(self._request) as cluster:
                    self._bake(cluster, self._job(shared))
                ended = True
            finally:
                # After an error, workers of others may still write; those from here are dead.
                if ended or mine:
                    sweep(self._out, self._names().__contains__)

    def _job(self, shared: Path) -> WorkerJob:
        baker = self._baker
        snapshot = shared / f"{baker.asset.id}.rhytid.tar"
        with working("writing the snapshot"), baker.engine.snapshots.of(baker.asset.id) as made:
            write_pieces(snapshot, made.pieces())
        snapshot.chmod(READABLE)
        self.figures.snapshot_bytes = made.nbytes
        return WorkerJob.of(self._request, self._inputs, baker, snapshot, self._places())

    def _bake(self, cluster: Cluster, job: WorkerJob) -> None:
        many = len(self._numbers.numbers)
        with DaskRun(cluster, job) as run:
            each = self._request.chunk or chunk_size(many, run.workers.slots())
            self._chunks = self._numbers.chunks(each)
            events = run.bake([Chunk(one.numbers, one.text()) for one in self._chunks])
            for _ in counted(range(many), "baking", "frame", _OPENING, lambda: self._worked):
                self._until_frame(events)
                with suppress(OSError):  # so that no other bake takes the snapshot for abandoned
                    os.utime(Path(job.snapshot.path).parent)
            self._until_frame(events)  # the last chunk ends after its last frame
        self.figures.tasks = len(self._chunks)
        self.figures.workers = len(run.used)
        self.figures.lost = len(run.used & run.workers.lost)

    def _until_frame(self, events: Iterator[Event]) -> None:
        """Handle events until one more frame is done."""
        for event in events:
            if isinstance(event, FrameDone):
                detail(f"frame {event.label} is there, by {event.worker}")
                self._worked = event.worked
                if event.worked and not self._wrote:
                    self._wrote = True
                    self._baker.warnings.files_follow()
                return
            if isinstance(event, WorkerLost):
                note(f"rhytid: worker {event.address} has left; its frames go to another")
            elif isinstance(event, WorkerUnable):
                note(f"rhytid: {event.error}; its frames go to another")
            else:
                self._count(event.report)

    def _count(self, report: ChunkReport) -> None:
        baker = self._baker
        baker.written += report.written
        baker.skipped += report.skipped
        baker.replaced += report.replaced
        for step, seconds in report.seconds.items():
            for one in seconds:
                baker.watch.add(step, one)
        baker.warnings.add(report.warnings)

    def _tell_origins(self) -> None:
        """Warn of several devices or methods. A chunk would do so too early: those after it may
        replace the files of others."""
        self._baker.tell_origins(self._baker.output.recorded())

    def _places(self) -> list[FramePlace]:
        """The frames that are baked."""
        return self._numbers.select(self._baker.frames.places)

    def _names(self) -> set[str]:
        """Names of all files that no other bake writes."""
        name, asset = self._inputs.name, self._baker.asset
        output, geometry = self._baker.output, self._request.geometry
        records = {f"{name}.bake.{chunk.file_text()}.json" for chunk in self._chunks}
        return records | output.names(self._places(), asset.udims, geometry)


def chunk_size(frames: int, slots: int) -> int:
    """Frames per task where the request does not say.  slots: tasks that run at once by now."""
    return min(math.ceil(frames / (slots * _TASKS)), _LARGEST)


def check_cluster(address: str) -> None:
    """Check before an asset is built that the cluster can be used. Raises InputError where Dask is
    not installed, and FarmError where no scheduler answers."""
    check_installed()
    if address != LOCAL:
        with running_cluster(address):
            pass


@contextmanager
def bake_cluster(request: BakeRequest) -> Iterator[Cluster]:
    """The cluster of a request: one that runs already, or processes of this machine that end with
    the block. Raises FarmError where no scheduler answers."""
    if request.dask is not None and request.dask != LOCAL:
        with running_cluster(request.dask) as cluster:
            yield cluster
        return
    quiet = not verbosity().verbose
    with (
        temporary_folder("rhytid-dask-") as folder,
        local_cluster(worker_devices(request), folder, quiet) as cluster,
    ):
        yield cluster


def worker_devices(request: BakeRequest) -> list[str | None]:
    """The value of RHYTID_DEVICE for each process of a local cluster; None leaves it as it is."""
    named = request.service.device
    gpus = [str(one.index) for one in candidates() if one.kind == "gpu"]
    devices: list[str | None] = [*gpus] if gpus and named is None else [named]
    each = len(gpus) if named is None else 0
    count = request.dask_workers or each or _ON_ONE
    return [devices[i % len(devices)] for i in range(count)]
