"""Frames: put, list, read, forget, and their stretch."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rhytid.domain.frame import NEUTRAL, check_frame_name, check_positions
from rhytid.domain.warnings import InputWarning, check_codes, refuse
from rhytid.engine.assets import Asset
from rhytid.engine.core import EngineCore
from rhytid.engine.frames import Frame, refuse_neutral
from rhytid.engine.log_stretch import LogStretch
from rhytid.engine.messages import FrameInfo, FrameStretch


class FrameCalls(EngineCore):
    """The calls about the frames of an asset."""

    def put_frame(
        self,
        asset: str,
        frame: str,
        positions: ArrayLike,
        *,
        strict: bool = False,
        allow: Collection[str] = (),
    ) -> FrameInfo:
        """Store positions (V, 3) under a name, in place of what had that name.

        The answer warns of what is probably wrong; strict: raise StrictError instead, and store
        nothing, unless its code is in `allow`.

        Raises QueryError for a code that there is not, FrameError naming the count or the vertex,
        ReadOnlyError for `neutral`, FrameMemoryError where the memory for frames is full.
        """
        check_frame_name(frame)
        refuse_neutral(frame)
        found = self._assets.get(asset)
        return put_frame(self._on_device, found, frame, positions, strict=strict, allow=allow)

    def frame_warnings(
        self,
        asset: str,
        positions: ArrayLike,
        *,
        strict: bool = False,
        allow: Collection[str] = (),
    ) -> tuple[InputWarning, ...]:
        """What is probably wrong with positions (V, 3) that are not stored.

        strict: raise StrictError where there is something whose code is not in `allow`.
        """
        found = self._assets.get(asset)
        return checked_frame(found, positions, "the positions", strict, allow)[1]

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
    on_device: Callable[..., Any],
    asset: Asset,
    name: str,
    positions: ArrayLike,
    *,
    strict: bool = False,
    allow: Collection[str] = (),
) -> FrameInfo:
    """Measure a frame and store it; see FrameCalls.put_frame."""
    resident = asset.ready()
    frame, warnings = checked_frame(asset, positions, f"frame {name}", strict, allow)
    ratios, _ = on_device(resident.stretch, frame)
    measured = LogStretch.of(ratios)
    asset.frames.put(name, frame, measured, warnings)
    return FrameInfo(name, measured.percentiles(_limit(asset)), warnings)


def checked_frame(
    asset: Asset, positions: ArrayLike, name: str, strict: bool, allow: Collection[str]
) -> tuple[Frame, tuple[InputWarning, ...]]:
    """Positions as a frame, and what is probably wrong with it; strict: raises StrictError for what
    is not in `allow`."""
    check_codes(allow)
    checked = check_positions(positions, asset.vertices)
    warnings = asset.frame_warnings(checked, name)
    if strict:
        refuse(warnings, allow)
    return Frame.of(checked), warnings


def _limit(asset: Asset) -> float:
    return asset.settings.response.log_stretch_limit
