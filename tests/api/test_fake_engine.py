"""The fake engine has the calls of the real one: names, parameters, defaults, types."""

from __future__ import annotations

import inspect
from types import SimpleNamespace
from typing import Any

import pytest

from api.fake_engine import FakeEngine
from rhytid.engine.assets.service import AssetService
from rhytid.engine.engine import Engine
from rhytid.engine.frame_service import FrameService
from rhytid.engine.jobs import Jobs
from rhytid.engine.packages import PackageService
from rhytid.engine.tiles.service import TileService

PARTS = {
    "assets": AssetService,
    "frames": FrameService,
    "tiles": TileService,
    "jobs": Jobs,
    "packages": PackageService,
}
FAKE = FakeEngine()
# Of the fake alone: tests replace it.
HELPERS = {"tile"}
CALLS = [
    f"{part}.{name}"
    for part in PARTS
    for name in vars(type(getattr(FAKE, part)))
    if not name.startswith("_") and name not in HELPERS
]
# What a server never calls.
OWN = {"close"}


def shape_of(call: Any) -> inspect.Signature:
    """Of a method, without `self`; types as they are written."""
    found = inspect.signature(call)
    given = [p for name, p in found.parameters.items() if name != "self"]
    return found.replace(parameters=given)


@pytest.mark.parametrize("call", CALLS)
def test_a_call_of_a_part_is_that_of_the_real_one(call: str) -> None:
    part, name = call.split(".")
    fake: SimpleNamespace = getattr(FAKE, part)
    assert shape_of(getattr(fake, name)) == shape_of(getattr(PARTS[part], name))


def test_the_engine_itself_is_that_of_the_real_one() -> None:
    public = {name for name in vars(Engine) if not name.startswith("_")} - OWN
    assert public == {"well", "ready", "devices", "waiting", "restarts"}
    for name in public:
        fake, real = getattr(FakeEngine, name), getattr(Engine, name)
        if isinstance(real, property):
            fake, real = fake.fget, real.fget
        assert shape_of(fake) == shape_of(real)


def test_the_real_parts_are_those_of_the_engine() -> None:
    made = inspect.getsource(Engine.__init__)
    for part, kind in PARTS.items():
        assert f"self.{part} = {kind.__name__}(" in made
