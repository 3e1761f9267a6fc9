"""A package of the small sheet, made once."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from engine.engines import built, new_asset, running
from meshes import deform
from rhytid.domain.expressions import Expressions
from rhytid.domain.mesh import Mesh
from rhytid.engine.engine import Engine
from rhytid.exports.skin_package.maps import SkinMaps
from rhytid.exports.skin_package.package import PackageWriter


@dataclass(frozen=True)
class Written:
    """A package, and the engine with the asset that it is of."""

    folder: Path
    engine: Engine
    asset: str
    mesh: Mesh
    shapes: Expressions


@pytest.fixture(scope="session")
def written(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Written]:
    """By the preset `best`, which has every layer."""
    new = new_asset(preset="best", tile_size=128)
    moved = np.stack([deform(new.mesh.positions, seed, 0.05) for seed in (1, 2)])
    shapes = Expressions.checked(moved, len(new.mesh.positions), ["smile", "frown"])
    with running(tmp_path_factory.mktemp("store")) as engine:
        asset = built(engine, new)
        folder = tmp_path_factory.mktemp("packages") / "skin"
        write_package(engine, asset, folder, shapes)
        yield Written(folder, engine, asset, new.mesh, shapes)


def write_package(
    engine: Engine,
    asset: str,
    folder: Path,
    shapes: Expressions | None = None,
    levels: int | None = None,
) -> None:
    maps = SkinMaps.of(engine, asset)
    for step in PackageWriter(maps, engine.assets.mesh(asset), shapes, folder, levels).steps():
        step()
