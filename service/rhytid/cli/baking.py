"""Baking: every frame of an animation as files of displacement, by an engine in this process."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rhytid.cli.bake_record import BakeRecord
from rhytid.cli.frame_files import FrameFiles, FramePlace
from rhytid.cli.reporting import counted, share_bar
from rhytid.cli.timing import Stopwatch
from rhytid.cli.warned import Warned
from rhytid.domain.asset_settings import AssetSettings
from rhytid.engine.jobs import Job
from rhytid.engine.messages import AssetInfo, JobInfo, MapQuery, NewAsset
from rhytid.errors import ConflictError
from rhytid.formats.exr import write_exr

if TYPE_CHECKING:
    from rhytid.engine.engine import Engine

# Between two looks at how far a job is.
_SHOWN_SECONDS = 0.2


@dataclass(frozen=True)
class Output:
    """Where maps go: `folder`/NAME.<UDIM>.<FRAME>.exr, as half or single floats."""

    folder: Path
    name: str
    half: bool

    def file(self, udim: int, frame: FramePlace) -> Path:
        """The file of one map."""
        return self.folder / f"{self.name}.{udim}.{frame.label}.exr"

    def record(self) -> BakeRecord:
        """What is done already."""
        return BakeRecord(self.folder / f"{self.name}.bake.json")


@dataclass
class Baker:
    """One asset, its frames and what is to be drawn of them."""

    engine: Engine
    asset: AssetInfo
    query: MapQuery
    frames: FrameFiles
    output: Output
    watch: Stopwatch
    warned: Warned
    written: int = 0
    skipped: int = 0

    def calibrate(self) -> None:
        """Set the range of the precomputed maps from the frame that stretches most."""
        places = counted(self.frames.places, "measuring", "frame")
        most = max(places, key=lambda place: self._measure(place))
        with self.watch.step("bins"):
            job = self.engine.assets.calibrate(self.asset.id, self.frames.read(most))
            finish(self.engine, job, "bins")

    def run(self) -> None:
        """Write every map that is not done."""
        record = self.output.record()
        for place in counted(self.frames.places, "baking", "frame"):
            with self.watch.step("stretch"):
                self._put(place)
            for udim in self.asset.udims:
                self._map(record, place, udim)
            self.engine.frames.delete(self.asset.id, place.label)

    def _map(self, record: BakeRecord, place: FramePlace, udim: int) -> None:
        file, half = self.output.file(udim, place), self.output.half
        plan = self.engine.tiles.plan_map(self.asset.id, place.label, self.query, udim, 0)
        key = f"{plan.key}-{'half' if half else 'single'}"
        if record.done(file, key):
            self.skipped += 1
            return
        with self.watch.step(self.query.method):
            texels = plan.draw()
        with self.watch.step("write"):
            write_exr(file, texels.astype(np.float16) if half else texels, plan.header)
            record.add(file, key)
        self.written += 1

    def _measure(self, place: FramePlace) -> float:
        """The 90th percentile of the absolute log stretch of a frame."""
        size = self._put(place)
        self.engine.frames.delete(self.asset.id, place.label)
        return size

    def _put(self, place: FramePlace) -> float:
        positions = self.frames.read(place)
        info = self.engine.frames.put(self.asset.id, place.label, positions)
        self.warned.frame(info.warnings, place.name)
        return info.log_stretch["abs_p90"]


def build(engine: Engine, new: NewAsset, warned: Warned) -> AssetInfo:
    """Have an asset built and return it ready; raises ConflictError with the reason if it fails."""
    asset = engine.assets.create(new)
    warned.settings(asset.warnings)
    if asset.job is not None:
        _wait(engine.jobs.get(asset.job), "building")
        asset = engine.assets.info(asset.id)
    if asset.state == "failed":
        raise ConflictError(f"the asset could not be built: {asset.reason}")
    # Maps that are made ahead would be for a range that is not calibrated yet.
    engine.jobs.cancel_all(asset.id)
    if new.graph is None and asset.statistics is not None:
        settings = AssetSettings.parse(asset.settings)
        warned.lengths(settings, asset.statistics["spacing"])
    warned.notice(asset.notices)
    return asset


def finish(engine: Engine, job: JobInfo, what: str) -> None:
    """Wait until a job is done; raises ConflictError with the reason if it fails."""
    ended = _wait(engine.jobs.get(job.id), what)
    if ended.state != "done":
        raise ConflictError(f"{what}: {ended.detail or ended.state}")


def _wait(job: Job, what: str) -> JobInfo:
    """How a job ended; shows how far it is."""
    with share_bar(what) as show:
        while not job.wait(_SHOWN_SECONDS):
            show(job.info.progress, job.info.stage)
    return job.info
