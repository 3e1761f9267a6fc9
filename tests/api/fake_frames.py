"""Frames of the fake engine."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import ArrayLike, NDArray

from api.fake_state import Part
from rhytid.domain.frame import NEUTRAL, check_frame_name, check_positions
from rhytid.domain.warnings import InputWarning
from rhytid.engine.frames import Frame
from rhytid.engine.messages import (
    FrameInfo,
    FrameStretch,
)
from rhytid.errors import ReadOnlyError

PERCENTILES = ("p1", "p10", "p50", "p90", "p99", "abs_p90")


class FakeFrames(Part):
    """Frames stretch as far as they are from the neutral."""

    def put(
        self,
        asset: str,
        frame: str,
        positions: ArrayLike | Frame,
        *,
        strict: bool = False,
        allow: Collection[str] = (),
    ) -> FrameInfo:
        found = self.state.built(asset)
        positions = positions.positions if isinstance(positions, Frame) else positions
        self.warnings(asset, positions, strict=strict, allow=allow)
        if check_frame_name(frame) == NEUTRAL:
            raise ReadOnlyError("frame 'neutral' cannot be written")
        found.frames[frame] = check_positions(positions, len(found.new.mesh.positions))
        return self.info(asset, frame)

    def all(self, asset: str) -> list[FrameInfo]:
        return [self.info(asset, name) for name in (NEUTRAL, *self.state.built(asset).frames)]

    def info(self, asset: str, frame: str) -> FrameInfo:
        positions = self.state.positions(asset, frame)
        moved = self.state.moved(asset, positions)
        doubts = self.state.doubts(positions, f"frame {frame}") if frame != NEUTRAL else ()
        return FrameInfo(frame, dict.fromkeys(PERCENTILES, moved), doubts)

    def warnings(
        self,
        asset: str,
        positions: ArrayLike | Frame,
        *,
        strict: bool = False,
        allow: Collection[str] = (),
    ) -> tuple[InputWarning, ...]:
        positions = positions.positions if isinstance(positions, Frame) else positions
        return self.state.judged(positions, "the positions", strict, allow)

    def positions(self, asset: str, frame: str) -> NDArray[np.float32]:
        return self.state.positions(asset, frame)

    def delete(self, asset: str, frame: str) -> None:
        self.state.positions(asset, frame)
        if frame == NEUTRAL:
            raise ReadOnlyError("frame 'neutral' cannot be deleted")
        del self.state.find(asset).frames[frame]

    def stretch(self, asset: str, frame: str) -> FrameStretch:
        self.state.positions(asset, frame)
        count = len(self.state.built(asset).new.mesh.faces)
        axes = np.broadcast_to(np.eye(2, dtype=np.float32), (count, 2, 2))
        return FrameStretch(axes, np.ones((count, 2), np.float32), np.zeros(count, np.float32))
