"""What a connection holds of its asset."""

from __future__ import annotations

import json
from contextlib import nullcontext
from typing import Any

import numpy as np

from live.gated import TILE, GatedEngine
from rhytid.api.live.drawing import LiveDrawing
from rhytid.api.live.wire import read_opening


def drawing_of(engine: Any, asset: str, **header: Any) -> LiveDrawing:
    opening = read_opening(json.dumps({"message": "open", **header}))
    counter: Any = None
    return LiveDrawing(engine, engine.assets.info(asset), opening, nullcontext, counter)


def test_nothing_of_the_engine_is_kept(engine: GatedEngine, asset: str) -> None:
    """What an engine in another process answers is in its memory for as long as it is kept."""
    engines, drawing = engine.assets.mesh(asset), drawing_of(engine, asset, tiles=[TILE])
    assert drawing.blendshapes is not None
    for array in (drawing._mesh.positions, drawing._mesh.faces, drawing._mesh.uv):
        of_engine = (engines.positions, engines.faces, engines.uv)
        assert not any(np.shares_memory(array, one) for one in of_engine)
    assert not np.shares_memory(drawing.blendshapes._neutral, engines.positions)
    drawing.close()
