"""Tiles as half floats: those that the device converts, and the others."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from engine.conftest import Made
from engine.engines import BINNED, QUERIES, REDRAW, draw
from rhytid.domain.tiles import TileAddress
from rhytid.engine.device_assets.levels import DeviceFinest, DeviceLevels
from rhytid.errors import NotFoundError, QueryError

AT = TileAddress(1002, 0, 1, 2)


def halves(made: Made, query: Any, at: TileAddress) -> np.ndarray:
    found = made.engine.tiles.draw_half(made.asset, "bent", query, at)
    assert (found.header.udim, found.header.level) == (at.udim, at.level)
    assert (found.header.row, found.header.column) == (at.row, at.column)
    assert found.tile.dtype == np.float16
    return found.tile.view(np.uint16)


def wanted(made: Made, query: Any, at: TileAddress) -> np.ndarray:
    whole = draw(made.engine, made.asset, "bent", query, at)
    assert len(np.unique(whole)) > 100
    return whole.astype(np.float16).view(np.uint16)


@pytest.mark.parametrize("query", QUERIES, ids=str)
@pytest.mark.parametrize("at", [AT, TileAddress(1001, 0, 0, 0), TileAddress(1001, 1, 0, 1)])
def test_halves_are_those_of_the_tile(made: Made, query: Any, at: TileAddress) -> None:
    first = halves(made, query, at)
    assert np.array_equal(first, wanted(made, query, at))
    assert np.array_equal(halves(made, query, at), first)  # kept by now


def test_a_tile_that_takes_long_is_converted_once_it_is_whole(
    made: Made, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(DeviceLevels, "is_long", lambda *_: True)
    assert np.array_equal(halves(made, REDRAW, AT), wanted(made, REDRAW, AT))


def test_a_level_0_tile_leaves_the_device_as_half_floats(
    made: Made, monkeypatch: pytest.MonkeyPatch
) -> None:
    def reads(*_: Any) -> Any:
        raise AssertionError("it was read as float32")

    expected = wanted(made, BINNED, AT)
    monkeypatch.setattr(DeviceFinest, "_read", reads)
    monkeypatch.setattr(DeviceFinest, "cropped", reads)
    assert np.array_equal(halves(made, BINNED, AT), expected)


def test_what_half_floats_cannot_hold_is_refused_by_its_size(
    made: Made, monkeypatch: pytest.MonkeyPatch
) -> None:
    def large(resident: Any) -> None:
        device, squares = resident.mesh.device, resident.finest._drawing.squares

        def instead(*arguments: Any) -> Any:
            found = squares(*arguments)
            texels = np.zeros(found[0].nbytes // 4, np.float32)
            texels[5] = -70000
            return [device.upload(texels)]

        monkeypatch.setattr(resident.finest._drawing, "squares", instead)

    found = made.engine.tiles._assets.get(made.asset)
    made.engine.tiles._on_device.use(found, large)
    at = TileAddress(1001, 0, 3, 3)
    with pytest.raises(QueryError, match="displacement 70000 does not fit half floats"):
        made.engine.tiles.draw_half(made.asset, "bent", REDRAW, at)


def test_a_tile_that_is_not_there_is_refused(made: Made) -> None:
    with pytest.raises(NotFoundError):
        made.engine.tiles.draw_half(made.asset, "bent", REDRAW, TileAddress(1001, 0, 4, 0))
