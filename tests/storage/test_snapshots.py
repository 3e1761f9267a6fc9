"""Snapshots: same bytes for the same asset, the same asset from them, and no other file taken."""

from __future__ import annotations

import hashlib
import io
import json
import tarfile
import tracemalloc
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.expressions import Expressions
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.painted_maps import Stiffness
from rhytid.domain.residual import Residual
from rhytid.errors import DiskFullError, SnapshotError, StorageError
from rhytid.formats.graphs import write_graph
from rhytid.storage.canonical import canonical, hashed
from rhytid.storage.records import StoredRequest, shape_files, write_overlay
from rhytid.storage.store import AssetStore
from storage.disk import Disk

ID = "00112233aabbccdd"
EXTRA = {"spacing": 0.5, "distance": 0.5, "uv_length": 10.0, "warnings": []}
STIFFNESS = Stiffness({1001: np.full((3, 3), 0.5)})
INDEX = "snapshot.json"


@pytest.fixture
def filled(
    store: AssetStore, mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings
) -> AssetStore:
    """A store with an asset whose settings were changed since it was built, with two shapes."""
    store.put_asset(ID, mesh, graph, settings, EXTRA, STIFFNESS)
    store.put_overlay(ID, settings.with_r_max(0.3))
    store.put_shapes(ID, shapes(len(mesh.positions)))
    return store


def shapes(vertices: int) -> Expressions:
    values = np.random.default_rng(1).normal(size=(2, vertices, 3))
    return Expressions.checked(values, vertices, ["jawOpen", "Lächeln"])


@pytest.fixture
def other(tmp_path: Path) -> Iterator[AssetStore]:
    with AssetStore(tmp_path / "other") as opened:
        yield opened


def taken(store: AssetStore, id: str = ID) -> bytes:
    with store.snapshots.of(id) as made:
        data = b"".join(made.pieces())
        assert len(data) == made.nbytes
    return data


def restored(store: AssetStore, data: bytes) -> bool:
    with store.snapshots.unpacked(io.BytesIO(data), len(data)) as unpacked:
        return store.snapshots.install(unpacked)


def files(store: AssetStore, id: str = ID) -> dict[str, bytes]:
    home = store._folders.assets / id
    found = (path for path in home.rglob("*") if path.is_file())
    return {str(path.relative_to(home)): path.read_bytes() for path in found}


def untouched(store: AssetStore) -> bool:
    return not any(store._folders.assets.iterdir()) and not any(store._folders.partial.iterdir())


def test_a_restored_asset_is_the_asset_byte_for_byte(filled: AssetStore, other: AssetStore) -> None:
    assert restored(other, taken(filled))
    assert files(other) == files(filled)
    assert other.overlay(ID) == filled.overlay(ID)
    assert other.asset(ID).extra == EXTRA
    assert other.shapes(ID).names == ("jawOpen", "Lächeln")
    assert not any(other._folders.partial.iterdir())


def test_without_shapes_it_is_of_the_format_that_older_versions_read(
    store: AssetStore, mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings, other: AssetStore
) -> None:
    store.put_asset(ID, mesh, graph, settings, EXTRA, STIFFNESS)
    data = taken(store)
    assert b'"format":1' in data[:4096]
    assert restored(other, data)
    assert files(other) == files(store)
    store.put_shapes(ID, shapes(len(mesh.positions)))
    assert b'"format":2' in taken(store)[:4096]


def test_the_same_asset_gives_the_same_bytes_anywhere(
    filled: AssetStore, other: AssetStore, mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings
) -> None:
    data = taken(filled)
    assert taken(filled) == data
    restored(other, data)
    assert taken(other) == data
    other.delete(ID)
    other.put_asset(ID, mesh, graph, settings.with_r_max(0.3), EXTRA, STIFFNESS)
    other.put_overlay(ID, settings)
    assert taken(other) != data


def test_any_tar_program_reads_it(filled: AssetStore) -> None:
    with tarfile.open(fileobj=io.BytesIO(taken(filled))) as tar:
        found = {entry.name: tar.extractfile(entry) for entry in tar}
        read = {name: file.read() for name, file in found.items() if file is not None}
    stored = files(filled)
    assert set(read) == {INDEX, *stored} - {"asset/manifest.json", "shapes/manifest.json"}
    assert all(stored[name] == data for name, data in read.items() if name != INDEX)


def test_what_is_there_stays_as_it_is(filled: AssetStore, settings: AssetSettings) -> None:
    data = taken(filled)
    filled.put_overlay(ID, settings.with_r_max(0.2))
    before = files(filled)
    assert not restored(filled, data)
    assert files(filled) == before


def test_a_request_for_it_is_answered(
    filled: AssetStore, other: AssetStore, mesh: Mesh, settings: AssetSettings
) -> None:
    other.put_request(ID, StoredRequest(mesh, settings, None))
    assert restored(other, taken(filled))
    assert (other.pending(), other.ids()) == ([], [ID])


@pytest.mark.parametrize("name", ["asset/mesh.safetensors", "asset/manifest.json", "overlay.json"])
def test_a_damaged_asset_is_healed_and_gives_no_snapshot(filled: AssetStore, name: str) -> None:
    data, whole = taken(filled), files(filled)
    path = filled._folders.assets / ID / name
    path.write_bytes(path.read_bytes()[:-1] + b"?")
    with pytest.raises(StorageError, match=Path(name).name):
        filled.snapshots.of(ID)
    assert restored(filled, data)
    assert files(filled) == whole


@pytest.mark.parametrize(
    "step", [61, pytest.param(1, marks=[pytest.mark.slow, pytest.mark.release])]
)
def test_every_byte_counts(filled: AssetStore, other: AssetStore, step: int) -> None:
    data = bytearray(taken(filled))
    for at in range(0, len(data), step):
        data[at] ^= 1
        with pytest.raises(SnapshotError):
            restored(other, bytes(data))
        data[at] ^= 1
    assert untouched(other)
    assert restored(other, bytes(data))


def test_every_length_counts(filled: AssetStore, other: AssetStore) -> None:
    data = taken(filled)
    for size in (*range(0, len(data), 97), len(data) - 1):
        with pytest.raises(SnapshotError, match="cut off"):
            restored(other, data[:size])
    for more in (b"\0", bytes(512), data):
        with pytest.raises(SnapshotError, match="goes on after its end"):
            restored(other, data + more)
    assert untouched(other)


def test_a_stream_that_ends_early_is_refused_where_it_ends(
    filled: AssetStore, other: AssetStore
) -> None:
    data = taken(filled)
    with (
        pytest.raises(SnapshotError, match="cut off at byte 3000, within asset/"),
        other.snapshots.unpacked(io.BytesIO(data[:3000]), len(data)),
    ):
        pass
    assert untouched(other)


def test_damage_is_named_with_its_place(filled: AssetStore, other: AssetStore) -> None:
    data = bytearray(taken(filled))
    at = data.index(b"asset/mesh.safetensors\0") + 512
    data[at + 3] ^= 4
    with pytest.raises(SnapshotError, match=rf"asset/mesh\.safetensors is damaged, bytes {at} to"):
        restored(other, bytes(data))


def changed(data: bytes, change: Callable[[dict[str, Any], dict[str, bytes]], None]) -> bytes:
    """A snapshot whose index and files were changed, its sizes and SHA-256 made to fit."""
    with tarfile.open(fileobj=io.BytesIO(data)) as tar:
        held = {e.name: tar.extractfile(e).read() for e in tar}  # type: ignore[union-attr]
    index = json.loads(held.pop(INDEX))["value"]
    change(index, held)
    for entry in index["files"] if isinstance(index["files"], list) else ():
        if (content := held.get(entry["name"])) is not None:
            entry.update(bytes=len(content), sha256=hashlib.sha256(content).hexdigest())
    return packed({INDEX: hashed(index), **held})


def packed(held: dict[str, bytes]) -> bytes:
    out = io.BytesIO()
    for name, content in held.items():
        about = tarfile.TarInfo(name)
        about.size = len(content)
        out.write(about.tobuf(tarfile.GNU_FORMAT))
        out.write(content + bytes(-len(content) % 512))
    return out.getvalue() + bytes(1024)


def _put(name: str, content: bytes) -> Callable[[Any, Any], None]:
    return lambda index, held: held.update({name: content})


def _set(**values: Any) -> Callable[[Any, Any], None]:
    return lambda index, held: index.update(values)


def _entry(**values: Any) -> Callable[[Any, Any], None]:
    return lambda index, held: index["files"][0].update(values)


def _without(name: str) -> Callable[[Any, Any], None]:
    def change(index: Any, held: Any) -> None:
        index["files"] = [entry for entry in index["files"] if entry["name"] != name]
        del held[name]

    return change


def _twice(index: Any, held: Any) -> None:
    index["files"].append(index["files"][-1])


def _backwards(index: Any, held: Any) -> None:
    index["files"].reverse()


BAD = {
    "newer": (_set(format=4), "a snapshot of format 4, and this version of rhytid reads 3"),
    "older": (_set(format=1), "holds more than format 1 has"),
    "names alone": (_without("shapes/shapes.safetensors"), "names one of shapes/"),
    "names": (_put("shapes/names.json", b"{}"), "shapes/"),
    "format of text": (_set(format="1"), "a snapshot of format 1"),
    "other kind": (_set(kind="something"), "no snapshot of rhytid"),
    "id": (_set(asset="../../../../etc"), "asset is '../../../../etc'"),
    "more in the index": (_set(note=1), "holds more than"),
    "files no list": (_set(files=7), "files are not listed"),
    "path": (_entry(name="../../evil"), "names '../../evil'"),
    "manifest": (_entry(name="asset/manifest.json"), "which is no file of an asset"),
    "no name": (_entry(name=None), "names 'None'"),
    "twice": (_twice, "in another order"),
    "order": (_backwards, "in another order"),
    "no overlay": (_without("overlay.json"), r"does not name overlay\.json"),
    "no graph": (_without("asset/graph.safetensors"), "does not name asset/graph"),
    "mesh": (_put("asset/mesh.safetensors", b"x"), r"asset/mesh\.safetensors is of another"),
    "graph": (_put("asset/graph.safetensors", b"{}" * 9), "asset/graph"),
    "facts": (_put("asset/facts.json", b"[1]"), r"asset/facts\.json"),
    "setting": (
        _put("asset/facts.json", canonical({"settings": {"colour": 1}, "extra": EXTRA})),
        "colour",
    ),
    "no spacing": (
        _put("asset/facts.json", canonical({"settings": AssetSettings().as_json(), "extra": {}})),
        "spacing",
    ),
    "overlay": (_put("overlay.json", b"{}"), r"overlay\.json is damaged"),
    "overlay of another": (
        _put("overlay.json", write_overlay("asset ffffffffffffffff", AssetSettings())),
        f"not the settings of asset {ID}",
    ),
}


@pytest.mark.parametrize("kind", BAD)
def test_what_is_no_snapshot_of_an_asset_is_refused(
    filled: AssetStore, other: AssetStore, kind: str
) -> None:
    change, why = BAD[kind]
    with pytest.raises(SnapshotError, match=why) as raised:
        restored(other, changed(taken(filled), change))
    assert untouched(other)
    assert str(other._folders.assets.parent) not in str(raised.value), "no path of this machine"


def test_sizes_that_are_none_are_refused(filled: AssetStore, other: AssetStore) -> None:
    data = taken(filled)
    for size in (-1, 10**30, "9", None, True):
        bad = changed(data, lambda index, held, size=size: _sized(index, held, size))
        with pytest.raises(SnapshotError):
            restored(other, bad)
    assert untouched(other)


def _sized(index: Any, held: Any, size: Any) -> None:
    del held[index["files"][0]["name"]]
    index["files"][0]["bytes"] = size


@pytest.mark.parametrize(
    "data",
    [b"", b"\0" * 4096, b"PK\3\4" + bytes(2000), bytes(range(256)) * 8, packed({"a": b"b" * 600})],
    ids=["empty", "zeros", "zip", "noise", "another tar"],
)
def test_other_files_are_refused(other: AssetStore, data: bytes) -> None:
    with pytest.raises(SnapshotError, match=r"no snapshot of rhytid|cut off"):
        restored(other, data)
    assert untouched(other)


def test_a_graph_beyond_its_mesh_is_refused(
    filled: AssetStore, other: AssetStore, graph: WrinkleGraph
) -> None:
    bad = write_graph(replace(graph, edge_triangle=np.array([0, -1, 2])))
    with pytest.raises(SnapshotError, match="edge_triangle of the graph"):
        restored(other, changed(taken(filled), _put("asset/graph.safetensors", bad)))


def test_shapes_of_another_mesh_are_refused(filled: AssetStore, other: AssetStore) -> None:
    bad = shape_files(shapes(7))["shapes.safetensors"]
    with pytest.raises(SnapshotError, match="its shapes have 7 vertices each, its mesh has"):
        restored(other, changed(taken(filled), _put("shapes/shapes.safetensors", bad)))
    assert untouched(other)


def test_a_full_disk_at_every_step_leaves_nothing(filled: AssetStore, other: AssetStore) -> None:
    data = taken(filled)
    with pytest.MonkeyPatch.context() as patch:
        disk = Disk(patch, fatal=10**9)
        restored(other, data)
    whole = files(other)
    other.delete(ID)
    refused = 0
    for fatal in range(1, disk.steps + 1):
        with pytest.MonkeyPatch.context() as patch:
            Disk(patch, fatal, full=True)
            try:
                restored(other, data)
            except DiskFullError:
                refused += 1
        if other.ids():
            assert files(other) == whole
            other.delete(ID)
        assert not any(other._folders.assets.iterdir())
    assert refused > 12


def test_a_snapshot_is_made_in_pieces(tmp_path: Path, mesh: Mesh, settings: AssetSettings) -> None:
    big = Stiffness({udim: np.full((2048, 2048), 0.5) for udim in range(1001, 1007)})
    graph = WrinkleGraph(
        node_uv=[[0.2, 0.2], [0.8, 0.4]], node_weight=[1, 1], node_radius=[0.1, 0.1],
        edge_nodes=[[0, 1]], edge_weight=[1], edge_half_width=[0.1],
    )  # fmt: skip
    with AssetStore(tmp_path / "big") as store:
        store.put_asset(ID, mesh, graph, settings, EXTRA, big)
        tracemalloc.start()
        with store.snapshots.of(ID) as made:
            size = sum(map(len, made.pieces()))
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert size > 20 << 20
    assert most < 4 << 20


@pytest.mark.parametrize(
    ("udim", "side", "error"),
    [(1001, 128, "has 128 texels a side, the asset has 256"), (1055, 256, "which has no mesh")],
)
def test_a_residual_that_does_not_fit_is_refused(
    store: AssetStore, other: AssetStore, mesh: Mesh, graph: WrinkleGraph, udim: int, side: int,
    error: str,
) -> None:  # fmt: skip
    """The device would read beside it."""
    settings = AssetSettings.parse({"resolution": 256, "tile_size": 64}).resolved(0.5)
    residual = Residual.of({udim: np.ones((side, side), np.float32)})
    store.put_asset(ID, mesh, graph, settings, EXTRA, residual=residual)
    with pytest.raises(SnapshotError, match=error):
        restored(other, taken(store))
    assert untouched(other)
