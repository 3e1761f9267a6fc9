"""A changed, shortened, missing or foreign byte is reported with its file and never served."""

from __future__ import annotations

import ctypes
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.painted_maps import Stiffness
from rhytid.errors import StorageError
from rhytid.storage.canonical import canonical
from rhytid.storage.records import StoredAsset, StoredRequest
from rhytid.storage.store import AssetStore

ID = "00112233aabbccdd"
FILES = (
    "manifest.json",
    "facts.json",
    "mesh.safetensors",
    "graph.safetensors",
    "stiffness.safetensors",
)
STIFFNESS = Stiffness({1001: np.full((3, 3), 0.5)})


def flip(path: Path, at: int) -> None:
    data = bytearray(path.read_bytes())
    data[at] ^= 1
    path.write_bytes(data)


@pytest.fixture(params=["request", "asset"])
def stored(
    request: pytest.FixtureRequest,
    store: AssetStore,
    folder: Path,
    mesh: Mesh,
    graph: WrinkleGraph,
    settings: AssetSettings,
) -> tuple[Path, Callable[[], object]]:
    """The sealed folder and the call that reads it."""
    if request.param == "asset":
        store.put_asset(ID, mesh, graph, settings, {"spacing": 1.5}, STIFFNESS)
    else:
        store.put_request(ID, StoredRequest(mesh, settings, graph, STIFFNESS))
    read = getattr(store, request.param)
    return folder / "assets" / ID / request.param, lambda: read(ID)


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("at", [0, 9, -1])
def test_flipped_bit(stored: tuple[Path, Callable[[], object]], name: str, at: int) -> None:
    place, read = stored
    flip(place / name, at)
    with pytest.raises(StorageError, match=name):
        read()


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("keep", [0, 20, -1])
def test_truncated(stored: tuple[Path, Callable[[], object]], name: str, keep: int) -> None:
    place, read = stored
    (place / name).write_bytes((place / name).read_bytes()[:keep])
    with pytest.raises(StorageError, match=name):
        read()


@pytest.mark.parametrize("name", FILES)
def test_missing_file(stored: tuple[Path, Callable[[], object]], name: str) -> None:
    place, read = stored
    (place / name).unlink()
    with pytest.raises(StorageError, match=name):
        read()


def test_file_that_nobody_wrote(stored: tuple[Path, Callable[[], object]]) -> None:
    place, read = stored
    (place / "extra.bin").write_bytes(b"x")
    with pytest.raises(StorageError, match=r"extra\.bin"):
        read()


def test_every_byte_of_the_manifest_counts(stored: tuple[Path, Callable[[], object]]) -> None:
    place, read = stored
    manifest = place / "manifest.json"
    for at in range(len(manifest.read_bytes())):
        flip(manifest, at)
        with pytest.raises(StorageError):
            read()
        flip(manifest, at)
    read()


def test_every_byte_of_an_overlay_counts(
    store: AssetStore, folder: Path, mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings
) -> None:
    store.put_asset(ID, mesh, graph, settings, {})
    store.put_overlay(ID, settings)
    overlay = folder / "assets" / ID / "overlay.json"
    for at in range(len(overlay.read_bytes())):
        flip(overlay, at)
        with pytest.raises(StorageError, match=r"overlay\.json"):
            store.overlay(ID)
        flip(overlay, at)
    assert store.overlay(ID) == settings


@pytest.mark.parametrize("text", [b"[" * 100_000, b"null", b"[]", b"{}", b'{"files":1}', b"\xff"])
def test_manifest_of_anything(stored: tuple[Path, Callable[[], object]], text: bytes) -> None:
    place, read = stored
    (place / "manifest.json").write_bytes(text)
    with pytest.raises(StorageError, match=r"manifest\.json"):
        read()


def test_asset_in_the_place_of_another(
    store: AssetStore, folder: Path, mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings
) -> None:
    store.put_asset(ID, mesh, graph, settings, {})
    other = "f" * 16
    (folder / "assets" / ID).rename(folder / "assets" / other)
    with pytest.raises(StorageError, match=f"not a manifest of asset {other}"):
        store.asset(other)


def test_damaged_asset_can_be_deleted_and_put_again(
    store: AssetStore, folder: Path, mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings
) -> None:
    store.put_asset(ID, mesh, graph, settings, {})
    flip(folder / "assets" / ID / "asset" / "mesh.safetensors", -1)
    assert store.ids() == [ID]
    store.delete(ID)
    store.put_asset(ID, mesh, graph, settings, {})
    assert store.asset(ID).settings == settings


def test_names_that_are_not_ids_are_not_assets(folder: Path, store: AssetStore) -> None:
    (folder / "assets" / "lost+found" / "asset").mkdir(parents=True)
    assert store.ids() == []


def test_a_deleted_overlay_is_noticed(
    store: AssetStore, folder: Path, mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings
) -> None:
    store.put_asset(ID, mesh, graph, settings, {})
    store.put_overlay(ID, settings.with_r_max(0.3))
    (folder / "assets" / ID / "overlay.json").unlink()
    with pytest.raises(StorageError, match=r"overlay\.json is damaged: the file is missing"):
        store.overlay(ID)
    store.put_overlay(ID, settings)
    assert store.overlay(ID) == settings


def test_an_asset_of_an_older_version_needs_no_overlay(
    store: AssetStore,
    folder: Path,
    mesh: Mesh,
    graph: WrinkleGraph,
    settings: AssetSettings,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    plain = {"settings": settings.as_json(), "extra": {}}
    files = {**StoredAsset(mesh, graph, settings, {}).files(), "facts.json": canonical(plain)}
    monkeypatch.setattr(StoredAsset, "files", lambda self: files)
    store.put_asset(ID, mesh, graph, settings, {})
    (folder / "assets" / ID / "overlay.json").unlink()
    assert store.overlay(ID) is None
    assert store.asset(ID).settings == settings


# Of <linux/capability.h>: read, write and search whatever the permission bits say.
_CAPABILITY_VERSION, _DAC_OVERRIDE, _DAC_READ_SEARCH = 0x20080522, 1 << 1, 1 << 2


def _bind_root_to_permissions(bound: bool) -> None:
    """Whether permission bits apply to this thread, where it is of root."""
    libc = ctypes.CDLL(None, use_errno=True)
    header = (ctypes.c_uint32 * 2)(_CAPABILITY_VERSION, 0)
    sets = (ctypes.c_uint32 * 6)()  # effective, permitted, inheritable; then of higher numbers
    assert libc.capget(header, sets) == 0
    without = sets[1] & ~(_DAC_OVERRIDE | _DAC_READ_SEARCH)
    sets[0] = without if bound else sets[1]
    assert libc.capset(header, sets) == 0


@pytest.fixture
def locked_out() -> Iterator[Path]:
    """A folder where permission bits apply, to root too."""
    folder = Path(tempfile.mkdtemp())
    root = os.geteuid() == 0
    if root:
        _bind_root_to_permissions(True)
    yield folder
    if root:
        _bind_root_to_permissions(False)
    for path in folder.rglob("*"):
        path.chmod(0o700)
    shutil.rmtree(folder)


@pytest.mark.parametrize("kind", ["built", "requested", "empty", "link to itself"])
def test_a_folder_that_cannot_be_read_does_not_keep_the_store_from_opening(
    locked_out: Path, mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings, kind: str
) -> None:
    folder, bad = locked_out / "store", "f" * 16
    home = folder / "assets" / bad
    with AssetStore(folder) as store:
        store.put_asset(ID, mesh, graph, settings, {})
        if kind == "built":
            store.put_asset(bad, mesh, graph, settings, {})
        elif kind == "requested":
            store.put_request(bad, StoredRequest(mesh, settings, graph))
    if kind == "empty":
        home.mkdir()
    if kind == "link to itself":
        home.symlink_to(home)
    else:
        home.chmod(0)
    with AssetStore(folder) as store:
        assert store.asset(ID).settings == settings
        assert (store.ids(), store.pending()) == ([ID, bad], [])
        for call in (store.asset, store.request, store.overlay):
            with pytest.raises(StorageError, match=f"{bad}.* cannot be read"):
                call(bad)
        with pytest.raises(StorageError):
            store.put_request(bad, StoredRequest(mesh, settings, graph))
    if kind == "link to itself":
        home.unlink()
    else:
        home.chmod(0o700)
    with AssetStore(folder) as store:
        assert (bad in store.ids(), bad in store.pending()) == (
            kind == "built",
            kind == "requested",
        )
