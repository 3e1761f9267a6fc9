"""Calibration: the range of the precomputed maps, from how much a frame stretches."""

from __future__ import annotations

from rhytid.engine.asset_builder import AssetBuilder
from rhytid.engine.assets import Asset
from rhytid.engine.device_assets import DeviceAssets
from rhytid.engine.frames import Frame
from rhytid.engine.job import Job
from rhytid.pipeline.stretch import r_max_of


class Calibration:
    """The work of a job: sets r_max of a ready asset from a frame (section 2.4), then makes its
    precomputed maps anew, which may give way to other jobs."""

    def __init__(
        self, asset: Asset, frame: Frame, on_device: DeviceAssets, builder: AssetBuilder
    ) -> None:
        self._asset, self._frame = asset, frame
        self._on_device, self._builder = on_device, builder
        self._changed = False

    def __call__(self, job: Job) -> None:
        """Measure, unless that was done before the job gave way; then make the maps."""
        if not self._changed:
            self._measure(job)
            self._changed = True
        self._builder.make_bins(job, self._asset)

    def _measure(self, job: Job) -> None:
        job.progress(0.0, "measuring stretch")
        asset = self._asset
        ratios, _ = self._on_device.use(
            asset, lambda resident: resident.frames.ratios(self._frame), patiently=True
        )
        job.check()
        with asset.kept():
            limit = asset.settings.response.log_stretch_limit
            self._builder.change(asset, asset.settings.with_r_max(r_max_of(ratios, limit)))
