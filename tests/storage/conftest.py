"""A small mesh, a graph on it and settings: enough to fill a store."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.storage.store import AssetStore


@pytest.fixture
def mesh() -> Mesh:
    uv = np.array([[0.1, 0.1], [0.9, 1 / 3], [0.1, 0.9], [9.0000000001, 0.9]])
    faces = np.array([[0, 1, 2], [1, 3, 2]])
    positions = np.random.default_rng(3).normal(size=(4, 3)).astype(np.float32)
    return Mesh(positions, faces, uv, faces)


@pytest.fixture
def graph() -> WrinkleGraph:
    rng = np.random.default_rng(4)
    return WrinkleGraph(
        node_uv=rng.uniform(0, 1, (5, 2)),
        node_weight=rng.uniform(0, 1, 5),
        node_radius=np.full(5, 1e-3),
        edge_nodes=[[0, 1], [1, 2], [4, 0]],
        edge_weight=rng.uniform(0, 1, 3),
        edge_half_width=np.full(3, 1e-3),
        edge_triangle=[0, -1, 1],
    )


@pytest.fixture
def settings() -> AssetSettings:
    return AssetSettings.parse({"resolution": 1024, "depth": 0.1, "response": {"alpha_d": 1 / 3}})


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "store"


@pytest.fixture
def store(folder: Path) -> Iterator[AssetStore]:
    with AssetStore(folder) as opened:
        yield opened
