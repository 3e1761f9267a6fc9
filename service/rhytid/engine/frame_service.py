"""Frames: store, list, read, delete, and their stretch."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import ArrayLike, NDArray
from typing_extensions import override

from rhytid.domain.frame import NEUTRAL, check_frame_name
from rhytid.domain.warnings import InputWarning, check_codes, refuse
from rhytid.engine.assets.asset import Asset, AssetRegistry
from rhytid.engine.assets.on_device import DeviceAssets
from rhytid.engine.frames import Frame, LogStretch, refuse_neutral
from rhytid.engine.messages import FrameInfo, FrameStretch
from rhytid.engine.operations import Frames


class FrameService(Frames):
    """Stores, lists, reads and deletes the frames of assets."""

    def __init__(self, registry: AssetRegistry, on_device: DeviceAssets) -> None:
        self._assets, self._on_device = registry, on_device

    @override
    def put(
        self,
        asset: str,
        frame: str,
        positions: ArrayLike | Frame,
        *,
        strict: bool = False,
        allow: Collection[str] = (),
    ) -> FrameInfo:
        check_frame_name(frame)
        refuse_neutral(frame)
        found = self._assets.get(asset)
        found.check_ready()
        checked, warnings = checked_frame(found, positions, f"frame {frame}", strict, allow)
        return self.store(found, frame, checked, warnings)

    def store(
        self,
        asset: Asset,
        name: str,
        frame: Frame,
        warnings: tuple[InputWarning, ...],
        *,
        patiently: bool = False,
        since: int | None = None,
    ) -> FrameInfo:
        """Measure a checked frame and store it.  patiently: wait for a place in the queue of the
        device, in place of raising BusyError.  since: as in `Frames.put`."""
        ratios, _ = self._on_device.use(
            asset, lambda resident: resident.frames.ratios(frame), patiently=patiently
        )
        measured = LogStretch.of(ratios)
        asset.frames.put(name, frame, measured, warnings, since=since)
        return FrameInfo(name, measured.percentiles(_limit(asset)), warnings)

    @override
    def warnings(
        self,
        asset: str,
        positions: ArrayLike | Frame,
        *,
        strict: bool = False,
        allow: Collection[str] = (),
    ) -> tuple[InputWarning, ...]:
        found = self._assets.get(asset)
        # Kept for a while: most of the time they are drawn next.
        frame = found.frames.recent(found.checked(positions))
        return checked_frame(found, frame, "the positions", strict, allow)[1]

    @override
    def all(self, asset: str) -> list[FrameInfo]:
        found = self._assets.get(asset)
        found.check_ready()
        return found.frames.infos(_limit(found))

    @override
    def info(self, asset: str, frame: str) -> FrameInfo:
        found = self._assets.get(asset)
        found.check_ready()
        return found.frames.info(frame, _limit(found))

    @override
    def positions(self, asset: str, frame: str) -> NDArray[np.float32]:
        found = self._assets.get(asset)
        if frame == NEUTRAL:
            return self._on_device.loaded(found).mesh.neutral
        positions = found.frames.get(frame).positions
        assert positions is not None
        return positions

    def digest(self, asset: str, frame: str) -> str:
        """32 hex digits that name the positions of a frame; `neutral` for the neutral mesh."""
        return self._assets.get(asset).frames.get(frame).digest

    @override
    def delete(self, asset: str, frame: str) -> None:
        found = self._assets.get(asset)
        found.check_ready()
        found.frames.delete(frame)

    @override
    def stretch(self, asset: str, frame: str) -> FrameStretch:
        found = self._assets.get(asset)
        stored = found.frame(frame)
        return self._on_device.use(found, lambda resident: resident.frames.measured(stored))


def checked_frame(
    asset: Asset,
    positions: ArrayLike | Frame,
    name: str,
    strict: bool,
    allow: Collection[str],
    calibrates: bool = False,
) -> tuple[Frame, tuple[InputWarning, ...]]:
    """Positions (V, 3) as a frame, and warnings of what is probably wrong with it; strict: raise
    StrictError where the code of one is not in `allow`.  calibrates: whether precomputed maps are
    to reach as far as it."""
    check_codes(allow)
    frame = asset.checked(positions)
    assert frame.positions is not None
    warnings = asset.frame_warnings(frame.positions, name)
    if calibrates:
        warnings += asset.calibration_warnings(frame.positions, name)
    if strict:
        refuse(warnings, allow)
    return frame, warnings


def _limit(asset: Asset) -> float:
    return asset.settings.response.log_stretch_limit
