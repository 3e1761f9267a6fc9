"""An engine that can be held while it draws, and an asset with named shapes."""

from __future__ import annotations

import io
import threading
from typing import Any

import numpy as np

from api.fake_engine import FakeEngine
from api.patch import positions
from rhytid.engine.call_context import is_live
from rhytid.engine.messages import HalfTile
from rhytid.formats.tiles import half_tile

TILE = [1001, 0, 1, 2]
NAMES = ["browInnerUp_L", "browInnerUp_R", "jawOpen"]


class GatedEngine(FakeEngine):
    """A fake engine that draws while `gate` is set."""

    def __init__(self) -> None:
        super().__init__()
        self.gate = threading.Event()
        self.gate.set()
        self.began = threading.Semaphore(0)
        self.error: Exception | None = None
        self.drawing, self.most = 0, 0
        # Of each tile whether it was drawn for a live connection.
        self.live: list[bool] = []
        self._draw = self.tiles.draw
        self.tiles.draw = self._gated  # type: ignore[method-assign]
        self.tiles.draw_half = self._half  # type: ignore[method-assign]

    def _gated(self, *arguments: Any) -> Any:
        if self.error is not None:
            raise self.error
        self.drawing += 1
        self.most = max(self.most, self.drawing)
        self.live.append(is_live())
        self.began.release()
        try:
            assert self.gate.wait(10)
            return self._draw(*arguments)
        finally:
            self.drawing -= 1

    def _half(self, *arguments: Any) -> HalfTile:
        drawn = self._gated(*arguments)
        return HalfTile(half_tile(drawn.tile), drawn.description.header)


def shapes() -> Any:
    """(3, 25, 3) what the named shapes of the asset do."""
    moves = np.zeros((3, 25, 3), np.float32)
    moves[0, :12, 2], moves[1, 12:, 2], moves[2, :, 1] = 0.25, 0.5, -0.125
    return positions() + moves


def packed() -> bytes:
    file = io.BytesIO()
    np.savez(file, shapes=shapes(), names=np.array(NAMES))
    return file.getvalue()
