"""`rhytid bake --dask`: the frames of a bake on the workers of a Dask cluster."""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from rhytid.cli.bake_cluster import bake_cluster
from rhytid.cli.bake_inputs import BakeInputs
from rhytid.cli.dask_job import WorkerJob
from rhytid.cli.dask_options import LOCAL
from rhytid.cli.dask_session import BakeReport, BakeSession
from rhytid.cli.frame_files import FramePlace
from rhytid.cli.frame_range import FrameRange, frame_numbers
from rhytid.cli.progress import counted, working
from rhytid.cli.snapshot import SUFFIX
from rhytid.cli.voice import detail, note
from rhytid.farm.chunks import Chunk, Event, FrameDone, Unable, WorkerLost
from rhytid.farm.dask_cluster import Cluster
from rhytid.farm.dask_run import DaskRun
from rhytid.support.atomic_files import READABLE, shared_working_folder, sweep, write_pieces

if TYPE_CHECKING:
    from rhytid.cli.baking import Baker

# Tasks for each worker, where nothing says how large they are: so many that none waits long for the
# last of the others.
_TASKS = 4
# And so small that a worker that comes later gets some, too.
_LARGEST = 50
# Until the first frame is there.
_OPENING = "workers start and open the skin"


@dataclass
class DaskFigures:
    """How a bake went on a cluster.

    workers: that baked a frame.  lost: of these, that left before the end.  snapshot_bytes: that
    each worker reads.
    """

    workers: int = 0
    lost: int = 0
    tasks: int = 0
    snapshot_bytes: int = 0


class DaskBake:
    """Bakes the frames of a Baker on a cluster, and counts in the Baker what is written there."""

    def __init__(self, arguments: argparse.Namespace, given: BakeInputs, baker: Baker) -> None:
        self._arguments, self._given, self._baker = arguments, given, baker
        self._out: Path = arguments.out.resolve()
        places = baker.frames.places
        self._numbers = given.part or FrameRange.of(frame_numbers(places))
        self._chunks: list[FrameRange] = []
        self.figures = DaskFigures()

    def run(self) -> None:
        """Bake every frame. Raises what a single bake does, with the name of the worker where the
        reason is there, and FarmError where the cluster does not work."""
        mine, ended = self._arguments.dask == LOCAL, False
        # The snapshot is beside the maps, where all workers find it.
        with shared_working_folder(self._out) as shared:
            try:
                with bake_cluster(self._arguments) as cluster:
                    self._bake(cluster, self._job(shared))
                ended = True
            finally:
                # After an error, workers of others may still write; those from here are dead.
                if ended or mine:
                    sweep(self._out, self._names().__contains__)

    def _job(self, shared: Path) -> WorkerJob:
        baker = self._baker
        snapshot = shared / f"{baker.asset.id}{SUFFIX}"
        with working("writing the snapshot"), baker.engine.snapshots.of(baker.asset.id) as made:
            write_pieces(snapshot, made.pieces())
        snapshot.chmod(READABLE)
        self.figures.snapshot_bytes = made.nbytes
        return WorkerJob.of(self._arguments, self._given, baker, snapshot, self._places())

    def _bake(self, cluster: Cluster, job: WorkerJob) -> None:
        many = len(self._numbers.numbers)
        with DaskRun(cluster, partial(BakeSession, job)) as run:
            each = self._arguments.chunk or chunk_size(many, run.roster.slots())
            self._chunks = self._numbers.chunks(each)
            events = run.bake([Chunk(one.numbers, one.text()) for one in self._chunks])
            for _ in counted(range(many), "baking", "frame", _OPENING):
                self._until_frame(events)
                with suppress(OSError):  # so that no other bake takes the snapshot for abandoned
                    os.utime(Path(job.snapshot.path).parent)
            self._until_frame(events)  # the last chunk ends after its last frame
        self.figures.tasks = len(self._chunks)
        took = run.took
        self.figures.workers, self.figures.lost = len(took), len(took & run.roster.lost)

    def _until_frame(self, events: Iterator[Event]) -> None:
        """Take in what happens until one more frame is there."""
        for event in events:
            if isinstance(event, FrameDone):
                detail(f"frame {event.label} is there, by {event.worker}")
                return
            if isinstance(event, WorkerLost):
                note(f"rhytid: worker {event.address} has left; its frames go to another")
            elif isinstance(event, Unable):
                note(f"rhytid: {event.error}; its frames go to another")
            else:
                self._count(event.report)

    def _count(self, report: BakeReport) -> None:
        baker = self._baker
        baker.written += report.written
        baker.skipped += report.skipped
        for step, seconds in report.seconds.items():
            for one in seconds:
                baker.watch.add(step, one)
        baker.warned.tell(report.warnings)

    def _places(self) -> list[FramePlace]:
        """Of the frames that are baked."""
        return self._numbers.select(self._baker.frames.places)

    def _names(self) -> set[str]:
        """The names of all files that this bake writes for itself alone."""
        name, asset = self._given.name, self._baker.asset
        output, geometry = self._baker.output, self._arguments.geometry
        records = {f"{name}.bake.{chunk.file_text()}.json" for chunk in self._chunks}
        return records | output.names(self._places(), asset.udims, geometry)


def chunk_size(frames: int, slots: int) -> int:
    """Frames per task where nothing says how many.  slots: tasks that run at once by now."""
    return min(math.ceil(frames / (slots * _TASKS)), _LARGEST)
