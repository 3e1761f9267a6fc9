"""Engines for tests: one to itself, and one that a module of read-only tests shares."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from engine.engines import built, new_asset, running
from meshes import deform
from pipeline.scenes import sheet
from rhytid.engine.engine import Engine


class Made(NamedTuple):
    """An engine with a ready asset of four UDIMs and its frame `bent`."""

    engine: Engine
    asset: str


@pytest.fixture
def engine(tmp_path: Path) -> Iterator[Engine]:
    with running(tmp_path / "store") as engine:
        yield engine


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Made]:
    with running(tmp_path_factory.mktemp("made")) as engine:
        mesh = sheet(udims=2)
        asset = built(engine, new_asset(mesh))
        engine.frames.put(asset, "bent", deform(mesh.positions, 3, 0.15))
        yield Made(engine, asset)
