"""Named shapes beside an asset: kept, replaced, noticed where they are damaged."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.expressions import Expressions
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.errors import NotFoundError, StorageError
from rhytid.storage.records import StoredRequest
from rhytid.storage.store import AssetStore

ID = "00112233aabbccdd"


def shapes(seed: int = 1, names: tuple[str, ...] = ("jawOpen", "Lächeln")) -> Expressions:
    values = np.random.default_rng(seed).normal(size=(len(names), 4, 3))
    return Expressions.checked(values, 4, names)


def same(a: Expressions, b: Expressions) -> bool:
    return a.names == b.names and a.positions.tobytes() == b.positions.tobytes()


@pytest.fixture
def kept(store: AssetStore, mesh: Mesh, settings: AssetSettings) -> AssetStore:
    store.put_request(ID, StoredRequest(mesh, settings, None))
    return store


def test_they_come_back_and_stay_when_the_asset_is_built(
    kept: AssetStore, folder: Path, mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings
) -> None:
    kept.put_shapes(ID, shapes())
    kept.put_asset(ID, mesh, graph, settings, {})
    kept.close()
    with AssetStore(folder) as store:
        assert same(store.shapes(ID), shapes())
        store.delete(ID)
        assert not list((folder / "assets").iterdir())


def test_others_replace_them_and_the_same_are_not_written(kept: AssetStore, folder: Path) -> None:
    kept.put_shapes(ID, shapes())
    assert 0 <= kept.shapes_nbytes(ID) - shapes().positions.nbytes < 1000
    manifest = folder / "assets" / ID / "shapes" / "manifest.json"
    written = manifest.stat().st_mtime_ns
    kept.put_shapes(ID, shapes())
    assert manifest.stat().st_mtime_ns == written
    kept.put_shapes(ID, shapes(2, ("jawOpen",)))
    assert same(kept.shapes(ID), shapes(2, ("jawOpen",)))


@pytest.mark.parametrize("file", ["shapes.safetensors", "names.json", "manifest.json"])
def test_damage_is_noticed_and_healed(kept: AssetStore, folder: Path, file: str) -> None:
    kept.put_shapes(ID, shapes())
    path = folder / "assets" / ID / "shapes" / file
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    with pytest.raises(StorageError, match=file):
        kept.shapes(ID)
    kept.put_shapes(ID, shapes())
    assert same(kept.shapes(ID), shapes())


def test_without_an_asset_there_are_none(kept: AssetStore) -> None:
    with pytest.raises(NotFoundError):
        kept.shapes(ID)
    with pytest.raises(NotFoundError):
        kept.put_shapes("f" * 16, shapes())
