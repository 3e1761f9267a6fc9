"""What a connection holds of its asset."""

from __future__ import annotations

import json
from contextlib import nullcontext
from typing import Any

import numpy as np
import pytest

from live.gated import TILE, GatedEngine
from rhytid.api.live.drawing import LiveDrawing, has_changed
from rhytid.api.live.wire import LiveClosed, read_opening


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


def test_memory_for_shapes_is_held_before_they_are_read(
    engine: GatedEngine, asset: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    read, before, held = engine.assets.shapes, engine.memory.used, []

    def reading(asset: str) -> Any:
        held.append(engine.memory.used - before)
        return read(asset)

    monkeypatch.setattr(engine.assets, "shapes", reading)
    monkeypatch.setattr(engine.assets, "shapes_nbytes", lambda _: 1_000_000)
    drawing = drawing_of(engine, asset, tiles=[TILE])
    assert held[0] >= 3_000_000
    assert engine.memory.used - before < 1_000_000
    drawing.close()
    monkeypatch.setattr(engine.assets, "shapes_nbytes", lambda _: engine.memory.limit)
    with pytest.raises(LiveClosed, match="RHYTID_HOST_MEMORY_MB"):
        drawing_of(engine, asset, tiles=[TILE])
    assert (len(held), engine.memory.used) == (1, before)


@pytest.mark.parametrize("kind", [np.float32, np.float16])
@pytest.mark.parametrize("side", [8, 64, 96])
@pytest.mark.parametrize("row", [0, 3, 4, 7, 31, 32, 47, 48, 63, 95])
def test_one_texel_makes_a_changed_tile(side: int, row: int, kind: Any) -> None:
    before = np.full((side, side), 0.25, kind)
    now = before.copy()
    now[row % side, row % side] = 0.125
    assert has_changed(before, now, 0.124)
    assert has_changed(now, before, 0.124)
    assert not has_changed(before, now, 0.125)
    assert not has_changed(before, before.copy(), 0.0)


@pytest.mark.parametrize("kind", [np.float32, np.float16])
def test_zeros_of_either_sign_are_the_same(kind: Any) -> None:
    before = np.zeros((8, 8), kind)
    assert not has_changed(before, -before, 0.0)


def test_half_floats_are_compared_as_numbers_of_more_bits() -> None:
    """Their difference is no half float."""
    before, now = np.full((8, 8), 1.0, np.float16), np.full((8, 8), -0.00049, np.float16)
    step = float(before[0, 0]) - float(now[0, 0])
    assert float(before[0, 0] - now[0, 0]) != step
    assert has_changed(before, now, np.nextafter(step, 0.0))
    assert not has_changed(before, now, step)
