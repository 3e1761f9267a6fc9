"""The engine in another process has the calls of the one in this: names, parameters, types."""

from __future__ import annotations

import inspect
from typing import Any

import pytest

from api.test_fake_engine import CALLS, PARTS, shape_of
from rhytid.engine.engine import Engine
from rhytid.engine.snapshots import SnapshotService
from rhytid.engine_process.remote_assets import RemoteAssets
from rhytid.engine_process.remote_engine import RemoteEngine
from rhytid.engine_process.remote_frames import RemoteFrames
from rhytid.engine_process.remote_jobs import RemoteJobs
from rhytid.engine_process.remote_packages import RemotePackages
from rhytid.engine_process.remote_snapshots import RemoteSnapshots
from rhytid.engine_process.remote_tiles import RemoteTiles

REMOTE = {
    "assets": RemoteAssets,
    "frames": RemoteFrames,
    "tiles": RemoteTiles,
    "jobs": RemoteJobs,
    "packages": RemotePackages,
}


@pytest.mark.parametrize("call", CALLS)
def test_a_call_that_the_server_makes_is_there(call: str) -> None:
    part, name = call.split(".")
    real: Any = PARTS[part]
    assert shape_of(getattr(REMOTE[part], name)) == shape_of(getattr(real, name))


@pytest.mark.parametrize("name", ["of", "restore"])
def test_snapshots_are_those_of_the_real_one(name: str) -> None:
    assert shape_of(getattr(RemoteSnapshots, name)) == shape_of(getattr(SnapshotService, name))


def test_the_engine_itself_is_that_of_the_real_one() -> None:
    names = {name for name in vars(Engine) if not name.startswith("_")}
    assert {name for name in vars(RemoteEngine) if not name.startswith("_")} == names
    for name in names:
        remote, real = getattr(RemoteEngine, name), getattr(Engine, name)
        if isinstance(real, property):
            remote, real = remote.fget, real.fget
        assert shape_of(remote) == shape_of(real)


def test_the_parts_are_those_of_the_engine() -> None:
    made = inspect.getsource(RemoteEngine.__init__)
    for part, kind in REMOTE.items():
        assert f"self.{part} = {kind.__name__}(" in made
