"""The table of operations is what every engine has: the one here, those elsewhere, the fake one."""

from __future__ import annotations

import inspect
from typing import Any

import pytest

from api.fake_engine import FakeEngine
from rhytid.engine import engine, operations
from rhytid.engine.assets.service import AssetService
from rhytid.engine.frame_service import FrameService
from rhytid.engine.jobs import Jobs
from rhytid.engine.operation import Operation
from rhytid.engine.operations import OPERATIONS, Proxy
from rhytid.engine.packages import PackageService
from rhytid.engine.snapshots import SnapshotService
from rhytid.engine.tiles.service import TileService
from rhytid.fleet.ray_engine import RayEngine
from rhytid.processes.remote_engine import RemoteEngine

REAL = {
    "": engine.Engine,
    "assets": AssetService,
    "frames": FrameService,
    "tiles": TileService,
    "jobs": Jobs,
    "snapshots": SnapshotService,
    "packages": PackageService,
}
FAKE = FakeEngine()
# What a server asks for; the rest is for replicas of a fleet.
OF_SERVERS = [row for row in OPERATIONS.values() if row.effect != "drop"]
each_operation = pytest.mark.parametrize("row", OPERATIONS.values(), ids=lambda row: row.name)


def declared(row: Operation) -> list[tuple[Any, ...]]:
    protocol = getattr(operations, row.part.capitalize() or "Engine")
    return parameters_of(getattr(protocol, row.method))


def parameters_of(method: Any) -> list[tuple[Any, ...]]:
    """Names, kinds and defaults, without `self`."""
    found = inspect.signature(method).parameters.values()
    return [(p.name, p.kind, p.default) for p in found if p.name != "self"]


@each_operation
def test_the_engine_has_what_is_declared(row: Operation) -> None:
    assert parameters_of(getattr(REAL[row.part], row.method)) == declared(row)


@pytest.mark.parametrize("row", OF_SERVERS, ids=lambda row: row.name)
def test_the_fake_engine_has_what_is_declared(row: Operation) -> None:
    assert parameters_of(row.of(FAKE)) == declared(row)


def test_a_proxy_makes_each_operation_by_its_row() -> None:
    asked: list[tuple[Any, ...]] = []
    proxy = Proxy(lambda row, *positional, **named: asked.append((row.name, positional, named)))
    for row in OPERATIONS.values():
        if row.part:
            row.of(proxy)("an argument", strict=True)
    assert asked == [
        (name, ("an argument",), {"strict": True}) for name in OPERATIONS if "." in name
    ]


@pytest.mark.parametrize("elsewhere", [RemoteEngine, RayEngine])
def test_an_engine_elsewhere_has_what_a_part_does_not(elsewhere: type) -> None:
    own = {name for name in vars(operations.Engine) if not name.startswith("_")}
    parts = {row.part for row in OPERATIONS.values()}
    assert issubclass(elsewhere, Proxy)
    assert own - parts - {"memory", "figures"} <= set(dir(elsewhere))


@each_operation
def test_an_operation_names_what_it_addresses_first(row: Operation) -> None:
    first = [name for name, *_ in declared(row)]
    expected = {
        "engine": [], "assets": [], "asset": ["asset"], "frames": ["asset"],
        "frame": ["asset", "frame"], "job": ["id"],
    }  # fmt: skip
    if row.addresses != "content":
        wanted = expected[row.addresses]
        assert first[: len(wanted)] == wanted
