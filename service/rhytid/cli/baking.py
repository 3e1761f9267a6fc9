"""Baking: every frame of an animation as files of displacement, by an engine in this process."""

from __future__ import annotations

import time
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
from rhytid.engine.messages import ENDED_STATES, AssetInfo, JobInfo, MapQuery, NewAsset
from rhytid.errors import ConflictError
from rhytid.formats.exr import write_exr
from rhytid.formats.tile_header import TileHeader

if TYPE_CHECKING:
    from rhytid.engine.engine import Engine

_POLL_SECONDS = 0.05


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
            job = self.engine.calibrate(self.asset.id, self.frames.read(most))
            finish(self.engine, job, "bins")

    def run(self) -> None:
        """Write every map that is not done."""
        record = self.output.record()
        for place in counted(self.frames.places, "baking", "frame"):
            with self.watch.step("stretch"):
                self._put(place)
            for udim in self.asset.udims:
                self._map(record, place, udim)
            self.engine.delete_frame(self.asset.id, place.label)

    def _map(self, record: BakeRecord, place: FramePlace, udim: int) -> None:
        file, half = self.output.file(udim, place), self.output.half
        key = self.engine.map_key(self.asset.id, place.label, self.query, udim, 0)
        key = f"{key}-{'half' if half else 'single'}"
        if record.done(file, key):
            self.skipped += 1
            return
        with self.watch.step(self.query.method):
            texels = self.engine.map(self.asset.id, place.label, self.query, udim, 0)
        with self.watch.step("write"):
            header = self._header(place, udim)
            write_exr(file, texels.astype(np.float16) if half else texels, header)
            record.add(file, key)
        self.written += 1

    def _measure(self, place: FramePlace) -> float:
        """The 90th percentile of the absolute log stretch of a frame."""
        size = self._put(place)
        self.engine.delete_frame(self.asset.id, place.label)
        return size

    def _put(self, place: FramePlace) -> float:
        positions = self.frames.read(place)
        info = self.engine.put_frame(self.asset.id, place.label, positions)
        self.warned.frame(info.warnings, place.name)
        return info.log_stretch["abs_p90"]

    def _header(self, place: FramePlace, udim: int) -> TileHeader:
        return TileHeader(
            unit=str(self.asset.settings["unit"]),
            frame=place.label,
            asset=self.asset.id,
            method=self.query.method,
            stretch=self.query.stretch,
            sampling=self.query.sampling,
            udim=udim,
            level=0,
            row=0,
            column=0,
            scale=self.engine.displacement_scale(self.asset.id),
        )


def build(engine: Engine, new: NewAsset, warned: Warned) -> AssetInfo:
    """Have an asset built and return it ready; raises ConflictError with the reason if it fails."""
    asset = engine.create_asset(new)
    warned.settings(asset.warnings)
    with share_bar("building") as show:
        while asset.state == "building":
            time.sleep(_POLL_SECONDS)
            asset = engine.asset(asset.id)
            if asset.job is not None:
                job = engine.job(asset.job)
                show(job.progress, job.stage)
    if asset.state == "failed":
        raise ConflictError(f"the asset could not be built: {asset.reason}")
    if asset.job is not None:
        # What is left of the job makes maps ahead for a range that is not calibrated yet.
        engine.cancel_job(asset.job)
    if new.graph is None and asset.statistics is not None:
        settings = AssetSettings.parse(asset.settings)
        warned.lengths(settings, asset.statistics["spacing"])
    warned.notice(asset.notices)
    return asset


def finish(engine: Engine, job: JobInfo, what: str) -> None:
    """Wait until a job is done; raises ConflictError with the reason if it fails."""
    with share_bar(what) as show:
        while job.state not in ENDED_STATES:
            time.sleep(_POLL_SECONDS)
            job = engine.job(job.id)
            show(job.progress, job.stage)
    if job.state != "done":
        raise ConflictError(f"{what}: {job.detail or job.state}")
