"""What goes into the store comes out of it, in this process and in the next."""

from __future__ import annotations

import subprocess
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from rhytid.domain.asset_settings import PRESETS, AssetSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.painted_maps import Stiffness
from rhytid.errors import NotFoundError, StorageError
from rhytid.formats.graphs import write_graph
from rhytid.storage.canonical import hashed
from rhytid.storage.records import StoredRequest, read_overlay, write_overlay
from rhytid.storage.store import AssetStore
from rhytid.support import atomic_files

ID, OTHER = "00112233aabbccdd", "ffffffffffffffff"


def same_mesh(a: Mesh, b: Mesh) -> bool:
    return all(
        np.array_equal(getattr(a, name), getattr(b, name))
        and getattr(a, name).dtype == getattr(b, name).dtype
        for name in ("positions", "faces", "uv", "face_uv")
    )


def same_graph(a: WrinkleGraph, b: WrinkleGraph) -> bool:
    left, right = a.arrays(), b.arrays()
    return left.keys() == right.keys() and all(np.array_equal(left[k], right[k]) for k in left)


def test_asset_comes_back_after_reopening(
    folder: Path, mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings
) -> None:
    with AssetStore(folder) as store:
        store.put_asset(ID, mesh, graph, settings, {"spacing": 0.1, "note": "é"})
    with AssetStore(folder) as store:
        assert store.ids() == [ID]
        kept = store.asset(ID)
    assert same_mesh(kept.mesh, mesh)
    assert same_graph(kept.graph, graph)
    assert kept.settings == settings
    assert kept.extra == {"spacing": 0.1, "note": "é"}


def test_a_large_graph_is_stored_without_a_copy_of_it(
    folder: Path, mesh: Mesh, settings: AssetSettings
) -> None:
    nodes = np.arange(1 << 18)
    graph = WrinkleGraph(
        node_uv=np.random.default_rng(5).uniform(0, 1, (len(nodes), 2)),
        node_weight=np.full(len(nodes), 0.5),
        node_radius=np.full(len(nodes), 1e-3),
        edge_nodes=np.stack([nodes, np.roll(nodes, 1)], axis=1),
        edge_weight=np.full(len(nodes), 0.5),
        edge_half_width=np.full(len(nodes), 1e-3),
    )
    content, nbytes = write_graph(graph), sum(array.nbytes for array in graph.arrays().values())
    with AssetStore(folder) as store:
        tracemalloc.start()
        try:
            store.put_request(OTHER, StoredRequest(mesh, settings, graph))
            store.put_asset(ID, mesh, graph, settings, {})
            peak = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
    written = {path.read_bytes() for path in folder.rglob("graph.safetensors")}
    assert written == {content}
    assert peak < nbytes / 8


def test_stiffness_comes_back_of_requests_and_assets(
    folder: Path, mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings
) -> None:
    maps = {1002: np.linspace(0, 1, 12, dtype=np.float32).reshape(3, 4), 1001: np.ones((1, 1))}
    with AssetStore(folder) as store:
        store.put_request(ID, StoredRequest(mesh, settings, graph, Stiffness(maps)))
        store.put_asset(OTHER, mesh, graph, settings, {}, Stiffness(maps))
    with AssetStore(folder) as store:
        for kept in (store.request(ID).stiffness, store.asset(OTHER).stiffness):
            assert kept is not None
            assert list(kept.maps) == [1001, 1002]
            for udim, map in kept.maps.items():
                np.testing.assert_array_equal(map, maps[udim])


@pytest.mark.parametrize("given", [True, False])
def test_request_is_pending_until_the_asset_is_put(
    folder: Path, mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings, given: bool
) -> None:
    with AssetStore(folder) as store:
        store.put_request(ID, StoredRequest(mesh, settings, graph if given else None))
    with AssetStore(folder) as store:
        assert store.pending() == [ID]
        assert store.ids() == []
        kept = store.request(ID)
        assert same_mesh(kept.mesh, mesh)
        assert kept.settings == settings
        assert (kept.graph is not None) == given
        store.put_asset(ID, kept.mesh, graph, kept.settings, {})
        assert (store.pending(), store.ids()) == ([], [ID])
        with pytest.raises(NotFoundError, match=ID):
            store.request(ID)


def test_repeated_request_changes_nothing(
    store: AssetStore, mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings
) -> None:
    store.put_request(ID, StoredRequest(mesh, settings, None))
    store.put_request(ID, StoredRequest(mesh, settings, graph))
    assert store.request(ID).graph is None
    store.put_asset(ID, mesh, graph, settings, {})
    store.put_request(ID, StoredRequest(mesh, settings, None))
    assert store.pending() == []


def test_stored_asset_does_not_change(
    store: AssetStore, mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings
) -> None:
    store.put_asset(ID, mesh, graph, settings, {"build": 1})
    with pytest.raises(StorageError, match=f"asset {ID} is stored already"):
        store.put_asset(ID, mesh, graph, settings, {"build": 2})
    assert store.asset(ID).extra == {"build": 1}


def test_overlay_is_replaced_and_survives(
    folder: Path, mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings
) -> None:
    with AssetStore(folder) as store:
        store.put_asset(ID, mesh, graph, settings, {})
        assert store.overlay(ID) == settings
        store.put_overlay(ID, settings.with_r_max(0.3))
        store.put_overlay(ID, settings.with_r_max(0.1234567890123))
    with AssetStore(folder) as store:
        assert store.overlay(ID) == settings.with_r_max(0.1234567890123)
        assert store.asset(ID).settings == settings


def test_deleted_asset_leaves_nothing(
    folder: Path, mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings
) -> None:
    with AssetStore(folder) as store:
        store.put_asset(ID, mesh, graph, settings, {})
        store.put_overlay(ID, settings.with_r_max(0.3))
        store.put_request(OTHER, StoredRequest(mesh, settings, None))
        store.delete(ID)
        store.delete(OTHER)
        assert (store.ids(), store.pending()) == ([], [])
        assert not any((folder / "assets").iterdir())
        assert not any((folder / "partial").iterdir())
        with pytest.raises(NotFoundError, match=ID):
            store.delete(ID)
        store.put_asset(ID, mesh, graph, settings, {})
        assert store.overlay(ID) == settings


def test_others_do_not_wait_until_a_deleted_asset_is_gone_from_the_disk(
    folder: Path,
    mesh: Mesh,
    graph: WrinkleGraph,
    settings: AssetSettings,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with AssetStore(folder) as store:
        store.put_asset(ID, mesh, graph, settings, {})
        (folder / "packages" / ID).mkdir(parents=True)
        (folder / "packages" / ID / f"{'0' * 32}.zip").touch()
        removed: list[tuple[Path, bool]] = []

        def look(gone: Path) -> None:
            removed.append((gone, store._folders._changing.locked()))

        monkeypatch.setattr(atomic_files, "remove_tree", look)
        store.delete(ID)
        assert len(removed) == 2
        assert not any(locked for _, locked in removed)
        assert store.ids() == []


BAD_IDS = ["", "..", "../../etc/passwd0", "ABCDEF0123456789", "0" * 15, "0" * 17, "0" * 16 + "\n"]


@pytest.mark.parametrize("bad", [*BAD_IDS, "０" * 16])
def test_only_ids_touch_paths(
    store: AssetStore, mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings, bad: str
) -> None:
    calls = (
        lambda: store.asset(bad),
        lambda: store.request(bad),
        lambda: store.overlay(bad),
        lambda: store.delete(bad),
        lambda: store.put_overlay(bad, settings),
        lambda: store.put_request(bad, StoredRequest(mesh, settings, None)),
        lambda: store.put_asset(bad, mesh, graph, settings, {}),
    )
    for call in calls:
        with pytest.raises(NotFoundError, match="16 hexadecimal digits"):
            call()


def test_unknown_ids_are_not_found(store: AssetStore, settings: AssetSettings) -> None:
    for call in (store.asset, store.request, store.overlay, store.delete):
        with pytest.raises(NotFoundError, match=ID):
            call(ID)
    with pytest.raises(NotFoundError, match=ID):
        store.put_overlay(ID, settings)


def test_second_holder_is_refused(folder: Path, store: AssetStore) -> None:
    with pytest.raises(StorageError, match="in use by another rhytid serve") as refused:
        AssetStore(folder)
    assert str(folder) in str(refused.value)
    store.close()
    AssetStore(folder).close()


def test_second_process_is_refused(folder: Path, store: AssetStore) -> None:
    text = "import sys, pathlib, rhytid.storage.store as s; s.AssetStore(pathlib.Path(sys.argv[1]))"
    child = subprocess.run(
        [sys.executable, "-c", text, str(folder)], capture_output=True, text=True, check=False
    )
    assert child.returncode == 1
    assert f"StorageError: store {folder} is in use" in child.stderr


def test_refused_holder_sweeps_nothing(folder: Path, store: AssetStore) -> None:
    (folder / "partial" / "in-work").mkdir()
    with pytest.raises(StorageError):
        AssetStore(folder)
    assert (folder / "partial" / "in-work").is_dir()


def test_folder_that_is_a_file(tmp_path: Path) -> None:
    (tmp_path / "store").write_text("")
    with pytest.raises(StorageError, match="cannot be opened"):
        AssetStore(tmp_path / "store")


def test_settings_from_before_new_keys_draw_as_they_did(settings: AssetSettings) -> None:
    """A record that says nothing of arcs, knees, cushions and grain has none of them."""
    stored, new = settings.as_json(), PRESETS["paper"]
    later = {"grain_size", "undulation_size", "cushion_width", "cushion_sharpness"}
    later |= new.shape.keys()
    later -= {"wrinkle_bulge"}
    assert later < stored["shape"].keys()
    assert new.response.keys() < stored["response"].keys()
    old = {
        **stored,
        "shape": {k: v for k, v in stored["shape"].items() if k not in later},
        "response": {k: v for k, v in stored["response"].items() if k not in new.response},
    }
    overlay = hashed({"label": "a", "settings": old})
    found = read_overlay("a", overlay, Path("overlay.json"))
    for name in later & new.shape.keys():
        assert getattr(found.shape, name) == new.shape[name]
    for name, value in new.response.items():
        assert getattr(found.response, name) == value
    assert found.shape.wrinkle_bulge == settings.shape.wrinkle_bulge
    again = read_overlay("a", write_overlay("a", settings), Path("overlay.json"))
    assert again == settings
