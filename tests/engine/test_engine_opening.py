"""Stores with folders that cannot be used: they open, the rest is served, and nothing is lost."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest

from engine.engines import REDRAW, built, new_asset, running
from rhytid.domain.tiles import TileAddress
from rhytid.errors import StorageError, StoreFormatError
from rhytid.storage.canonical import canonical, hashed
from rhytid.storage.manifest import FORMAT, StoredFile
from rhytid.storage.records import FACTS

ADDRESS = TileAddress(1001, 0, 0, 0)
DAMAGED = "damaged in the store: send it again"


class Kept(NamedTuple):
    """A store of two assets."""

    store: Path
    good: str
    bad: str


@pytest.fixture(scope="module")
def template(tmp_path_factory: pytest.TempPathFactory) -> Kept:
    store = tmp_path_factory.mktemp("template") / "store"
    with running(store) as engine:
        return Kept(store, built(engine, new_asset()), built(engine, new_asset(seed=2)))


@pytest.fixture
def kept(template: Kept, tmp_path: Path) -> Kept:
    shutil.copytree(template.store, tmp_path / "store")
    return template._replace(store=tmp_path / "store")


def resealed(folder: Path, **files: bytes) -> None:
    """Write files into a sealed folder so that its manifest fits."""
    for name, data in files.items():
        (folder / name).write_bytes(data)
    label = json.loads((folder / "manifest.json").read_bytes())["label"]
    names = sorted(path.name for path in folder.iterdir() if path.name != "manifest.json")
    facts = {name: StoredFile.of((folder / name).read_bytes()).as_json() for name in names}
    manifest = {"format": FORMAT, "label": label, "files": facts}
    (folder / "manifest.json").write_bytes(canonical(manifest))


def _file_for_home(home: Path) -> None:
    shutil.rmtree(home)
    home.write_bytes(b"a file")


def _file_for_asset(home: Path) -> None:
    shutil.rmtree(home / "asset")
    (home / "asset").write_bytes(b"a file")


def _folder_for_file(home: Path) -> None:
    (home / "asset" / FACTS).unlink()
    (home / "asset" / FACTS).mkdir()


def _folder_for_overlay(home: Path) -> None:
    (home / "overlay.json").unlink()
    (home / "overlay.json").mkdir()


def _json(text: bytes) -> Callable[[Path], None]:
    return lambda home: (home / "asset" / "manifest.json").write_bytes(text) and None


def _request(home: Path) -> None:
    """A request that nobody can read, of an asset that was not built."""
    (home / "asset").rename(home / "request")


BROKEN: dict[str, Callable[[Path], None]] = {
    "file in place of the home": _file_for_home,
    "file in place of the asset": _file_for_asset,
    "folder in place of a file": _folder_for_file,
    "folder in place of the overlay": _folder_for_overlay,
    "manifest empty": _json(b""),
    "manifest no JSON": _json(b"{nonsense"),
    "manifest nested": _json(b"[" * 100_000),
    "manifest of numbers": _json(b'{"files":{"a":1},"format":1,"label":"x"}'),
    "manifest gone": lambda home: (home / "asset" / "manifest.json").unlink(),
    "asset empty": lambda home: [p.unlink() for p in (home / "asset").iterdir()] and None,
    "request": _request,
}


@pytest.mark.parametrize("kind", BROKEN)
def test_one_folder_that_cannot_be_used_keeps_nothing_from_opening(kept: Kept, kind: str) -> None:
    BROKEN[kind](kept.store / "assets" / kept.bad)
    with running(kept.store) as engine:
        states = {info.id: (info.state, info.reason) for info in engine.assets.all()}
        assert states.pop(kept.good) == ("ready", None)
        assert set(states.values()) <= {("failed", DAMAGED)}
        engine.tiles.plan(kept.good, "neutral", REDRAW, ADDRESS).draw()
        assert built(engine, new_asset(seed=2)) == kept.bad, "healed by sending again"
    with running(kept.store) as engine:
        assert [info.state for info in engine.assets.all()] == ["ready", "ready"]
    assert not any((kept.store / "partial").iterdir())


def _newer_manifest(home: Path) -> None:
    path = home / "asset" / "manifest.json"
    path.write_bytes(canonical({**json.loads(path.read_bytes()), "format": 2, "more": []}))


def _newer_settings(home: Path) -> None:
    facts = json.loads((home / "asset" / FACTS).read_bytes())
    facts["settings"]["invented"] = 1
    resealed(home / "asset", **{FACTS: canonical(facts)})


def _newer_overlay(home: Path) -> None:
    value = json.loads((home / "overlay.json").read_bytes())["value"]
    value["settings"]["invented"] = 1
    (home / "overlay.json").write_bytes(hashed(value))


def _newer_facts(home: Path) -> None:
    facts = json.loads((home / "asset" / FACTS).read_bytes())
    facts["extra"] = {"distances": [1]}
    resealed(home / "asset", **{FACTS: canonical(facts)})


def _newer_mesh(home: Path) -> None:
    resealed(home / "asset", **{"mesh.safetensors": b"another format"})


NEWER = (_newer_manifest, _newer_settings, _newer_overlay, _newer_facts, _newer_mesh)


@pytest.mark.parametrize("change", NEWER)
def test_what_a_newer_version_wrote_is_said_to_be_that_and_left_alone(
    kept: Kept, change: Callable[[Path], None]
) -> None:
    home = kept.store / "assets" / kept.bad
    change(home)
    before = {path: path.read_bytes() for path in home.rglob("*") if path.is_file()}
    with running(kept.store) as engine:
        assert engine.assets.info(kept.good).state == "ready"
        info = engine.assets.info(kept.bad)
        assert info.state == "failed"
        assert (info.reason or "").startswith("another version of rhytid stored this")
        with pytest.raises(StoreFormatError):
            engine.assets.create(new_asset(seed=2))
        assert {p: p.read_bytes() for p in home.rglob("*") if p.is_file()} == before
        engine.assets.delete(kept.bad)
        assert built(engine, new_asset(seed=2)) == kept.bad


def test_the_store_of_a_newer_version_is_refused_and_left_alone(kept: Kept) -> None:
    marked = kept.store / "format.json"
    ours = {"format": 1, "kind": "rhytid store"}
    assert json.loads(marked.read_bytes()) == ours
    marked.write_bytes(b'{"format": 2}')
    text = r"was made by a newer release of rhytid \(format 2, this one reads up to 1\)"
    with pytest.raises(StoreFormatError, match=text), running(kept.store):
        pass
    marked.write_bytes(b"{")
    with pytest.raises(StorageError, match=r"format\.json is damaged"), running(kept.store):
        pass
    marked.unlink()  # as a version wrote it that knew no formats of stores
    with running(kept.store) as engine:
        assert {info.state for info in engine.assets.all()} == {"ready"}
    assert json.loads(marked.read_bytes()) == ours
