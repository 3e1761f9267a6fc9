"""Frames: put, list, read, forget, and their stretch."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rhytid.domain.frame import NEUTRAL, check_frame_name, check_positions
from rhytid.engine.assets import Asset
from rhytid.engine.core import EngineCore
from rhytid.engine.frames import Frame, refuse_neutral
from rhytid.engine.log_stretch import LogStretch
from rhytid.engine.messages import FrameInfo, FrameStretch


class FrameCalls(EngineCore):
    """The calls about the frames of an asset."""

    def put_frame(self, asset: str, frame: str, positions: ArrayLike) -> FrameInfo:
        """Store positions (V, 3) under a name, in place of what had that name.

        Raises FrameError naming the count or the vertex, ReadOnlyError for `neutral`,
        FrameMemoryError where the memory for frames is full.
        """
        check_frame_name(frame)
        refuse_neutral(frame)
        found = self._assets.get(asset)
        return put_frame(self._on_device, found, frame, positions)

    def frames(self, asset: str) -> list[FrameInfo]:
        """Every frame of an asset, `neutral` first."""
        found = self._assets.get(asset)
        found.ready()
        return found.frames.infos(_limit(found))

    def frame(self, asset: str, frame: str) -> FrameInfo:
        """What is known of a frame."""
        found = self._assets.get(asset)
        found.ready()
        return found.frames.info(frame, _limit(found))

    def frame_positions(self, asset: str, frame: str) -> NDArray[np.float32]:
        """(V, 3) positions of a frame; those of the neutral mesh for `neutral`."""
        found = self._assets.get(asset)
        if frame == NEUTRAL:
            return found.ready().neutral
        positions = found.frames.get(frame).positions
        assert positions is not None
        return positions

    def delete_frame(self, asset: str, frame: str) -> None:
        """Forget a frame."""
        found = self._assets.get(asset)
        found.ready()
        found.frames.delete(frame)

    def stretch(self, asset: str, frame: str) -> FrameStretch:
        """Axes and unclamped ratios of every triangle in a frame (section 2.2)."""
        found = self._assets.get(asset)
        ratios, axes = self._on_device(found.ready().stretch, found.frame(frame))
        return FrameStretch(axes, ratios)


def put_frame(
    on_device: Callable[..., Any], asset: Asset, name: str, positions: ArrayLike
) -> FrameInfo:
    """Measure a frame and store it; see FrameCalls.put_frame."""
    resident = asset.ready()
    frame = Frame.of(check_positions(positions, asset.vertices))
    ratios, _ = on_device(resident.stretch, frame)
    measured = LogStretch.of(ratios)
    asset.frames.put(name, frame, measured)
    return FrameInfo(name, measured.percentiles(_limit(asset)))


def _limit(asset: Asset) -> float:
    return asset.settings.response.log_stretch_limit
