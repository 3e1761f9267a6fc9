"""The engine of a fleet has the calls of the one in this process: names, parameters, types."""

from __future__ import annotations

from typing import Any

import pytest

from api.test_fake_engine import CALLS, PARTS, shape_of
from engine_process.test_remote_signatures import REMOTE
from rhytid.engine.engine import Engine
from rhytid.engine.snapshots import SnapshotService
from rhytid.fleet.fleet_assets import FleetAssets, FleetSnapshots
from rhytid.fleet.ray_engine import RayEngine

OURS = {**REMOTE, "assets": FleetAssets}


@pytest.mark.parametrize("call", CALLS)
def test_a_call_that_the_server_makes_is_there(call: str) -> None:
    part, name = call.split(".")
    real: Any = PARTS[part]
    assert shape_of(getattr(OURS[part], name)) == shape_of(getattr(real, name))


@pytest.mark.parametrize("name", ["of", "restore"])
def test_snapshots_are_those_of_the_real_one(name: str) -> None:
    assert shape_of(getattr(FleetSnapshots, name)) == shape_of(getattr(SnapshotService, name))


def test_the_engine_itself_is_that_of_the_real_one() -> None:
    names = {name for name in vars(Engine) if not name.startswith("_")}
    assert {name for name in vars(RayEngine) if not name.startswith("_")} == names | {"figures"}
    for name in names:
        ours, real = getattr(RayEngine, name), getattr(Engine, name)
        if isinstance(real, property):
            ours, real = ours.fget, real.fget
        assert shape_of(ours) == shape_of(real)
