"""Engines on a store of their own, and small assets to build in them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.scenes import random_graph, settings_of, sheet
from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import TileAddress
from rhytid.engine.engine import Engine
from rhytid.engine.messages import JobInfo, MapQuery, NewAsset
from rhytid.support.settings import ServiceSettings

QUERIES = tuple(MapQuery(method) for method in ("neutral", "redraw", "binned", "convolved"))
REDRAW, BINNED, CONVOLVED = QUERIES[1:]
MIB = 1 << 20


@contextmanager
def running(store: Path, **changes: Any) -> Iterator[Engine]:
    """An engine on the device of RHYTID_DEVICE with other service settings."""
    engine = Engine(replace(ServiceSettings.from_environment(), store=store, **changes))
    try:
        yield engine
    finally:
        engine.close()


def new_asset(mesh: Mesh | None = None, seed: int = 1, **settings: Any) -> NewAsset:
    """A bumpy sheet with 80 wrinkles and 160 pores at 256² texels in tiles of 64²."""
    mesh = mesh or sheet()
    span = float(np.ceil(mesh.uv.max()))
    return NewAsset(mesh, settings_of(**settings), random_graph(seed, span=span))


def built(engine: Engine, new: NewAsset) -> str:
    """The id of a new asset, once its build is done."""
    info = engine.assets.create(new)
    if info.job is not None:  # else it was taken out of the store
        job = finish(engine, info.job)
        assert job.state == "done", job
    assert engine.assets.info(info.id).state == "ready"
    rest(engine)
    return info.id


def draw(
    engine: Engine, asset: str, frame: str, query: MapQuery, address: TileAddress
) -> NDArray[np.float32]:
    """One tile, drawn."""
    return engine.tiles.plan(asset, frame, query, address).draw()


def rest(engine: Engine) -> None:
    """Wait until no job is left; fails where that takes a minute."""
    for job in engine.jobs._known():
        assert job.wait(60), job.info


def finish(engine: Engine, job: str | None) -> JobInfo:
    """A job that ended, in whatever way; fails where that takes a minute."""
    assert job is not None
    found = engine.jobs.get(job)
    assert found.wait(60), f"job hangs: {found.info}"
    return found.info


def settle(engine: Engine, asset: str) -> None:
    """Wait for the job that an asset names, such as a build that a restart goes on with."""
    if engine.assets.info(asset).job is not None:
        finish(engine, engine.assets.info(asset).job)


def assembled(
    engine: Engine, asset: str, frame: str, query: MapQuery, udim: int, level: int
) -> NDArray[np.float32]:
    """A map put together from its tiles."""
    grid = settings_of(**_cut(engine, asset)).grid
    count = grid.count(level)
    tiles = [engine.tiles.plan(asset, frame, query, a).draw() for a in grid.addresses(udim, level)]
    return np.block([tiles[i : i + count] for i in range(0, len(tiles), count)])


def _cut(engine: Engine, asset: str) -> dict[str, int]:
    settings = engine.assets.info(asset).settings
    return {key: settings[key] for key in ("resolution", "tile_size")}


def maps(engine: Engine, asset: str, frame: str, level: int = 0) -> list[NDArray[np.float32]]:
    """The maps of every method and UDIM."""
    udims = engine.assets.info(asset).udims
    return [
        engine.tiles.plan_map(asset, frame, query, udim, level).draw()
        for query in QUERIES
        for udim in udims
    ]


def same(one: list[NDArray[Any]], other: list[NDArray[Any]]) -> bool:
    """Bit for bit."""
    return all(a.tobytes() == b.tobytes() for a, b in zip(one, other, strict=True))
