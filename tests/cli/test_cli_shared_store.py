"""`--shared-store`: assets that commands on several machines share."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from cli.running import only_asset, write_animation
from meshes import SmallMesh
from rhytid.baking.assets import fetch
from rhytid.cli import main
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.engine.assets.builder import AssetBuilder
from rhytid.errors import SharedStoreError
from rhytid.storage.shared.mirror import StoreMirror
from rhytid.storage.shared.shared_store import SharedStore
from rhytid.storage.store import AssetStore
from rhytid.support.console import Stopwatch
from rhytid.support.settings import ServiceSettings
from storage.backends import new_folder
from storage.conftest import folder, graph, mesh, settings, store

__all__ = ["folder", "graph", "mesh", "settings", "store"]
SMALL = ("--resolution", "256", "--wrinkles", "400")


@pytest.mark.slow
def test_what_one_bake_builds_others_fetch(
    bucket: str,
    tmp_path: Path,
    small_mesh: SmallMesh,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    place, mesh = bucket, str(write_animation(tmp_path / "shot.npz", small_mesh, 2))
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    bake = ["bake", "--mesh", mesh, "--shared-store", place, "--method", "binned"]
    assert main([*bake, *SMALL, "--out", str(whole)]) == 0
    [asset] = SharedStore.at(place).ids()
    capsys.readouterr()

    monkeypatch.setattr(AssetBuilder, "_build", None)
    part = [*bake, "--asset", asset, "--out", str(parts), "--json", "--frame-range"]
    assert main([*part, "1", "--store", str(tmp_path / "cache")]) == 0
    assert json.loads(capsys.readouterr().out)["steps"]["fetch"]["calls"] == 1
    monkeypatch.setenv("RHYTID_SHARED_STORE", place)
    assert main([*part[:3], *part[5:], "2"]) == 0
    again = tmp_path / "again"
    assert main([*bake, *SMALL, "--out", str(again)]) == 0

    files = sorted(file.name for file in whole.glob("*.exr"))
    assert len(files) == 2
    for name in files:
        for out in (parts, again):
            assert (out / name).read_bytes() == (whole / name).read_bytes()
    assert main([*bake, "--asset", "0" * 16, "--out", str(parts)]) == 1
    assert f"no asset {'0' * 16} in the shared store" in capsys.readouterr().err


@pytest.mark.slow
def test_a_snapshot_goes_through_a_shared_store(
    tmp_path: Path, small_mesh: SmallMesh, capsys: pytest.CaptureFixture[str]
) -> None:
    place = str(new_folder(tmp_path))
    mesh = str(write_animation(tmp_path / "shot.npz", small_mesh, 1))
    here, there = (str(tmp_path / name) for name in ("here", "there"))
    first, second = tmp_path / "first.tar", tmp_path / "second.tar"
    bake = ["bake", "--mesh", mesh, "--out", str(tmp_path / "maps"), "--store", here]
    assert main([*bake, *SMALL]) == 0
    asset = only_asset(tmp_path / "here")
    assert main(["snapshot", asset, "--store", here, "--out", str(first)]) == 0
    assert SharedStore.at(place).ids() == []

    restore = ["restore", str(first), "--store", there, "--shared-store", place]
    for shared in (True, False):
        capsys.readouterr()
        assert main([*restore, "--json"]) == 0
        [found] = json.loads(capsys.readouterr().out)["restored"]
        assert (found["new"], found["shared"]) == (shared, shared)
    assert main(restore) == 0
    already = f"{asset}: there already; there already in the shared store\n"
    assert capsys.readouterr().out == already
    for id in SharedStore.at(place).ids():
        SharedStore.at(place).remove(id)
    assert main(restore) == 0
    assert capsys.readouterr().out == f"{asset}: there already; pushed to the shared store\n"

    elsewhere = ["--store", str(tmp_path / "elsewhere"), "--shared-store", place]
    assert main(["snapshot", asset, "--out", str(second), *elsewhere]) == 0
    assert second.read_bytes() == first.read_bytes()
    assert main(["snapshot", "0" * 16, *elsewhere]) == 1
    assert "in the shared store" in capsys.readouterr().err


def test_a_bake_and_a_snapshot_take_what_another_machine_has_changed(
    tmp_path: Path,
    folder: Path,
    store: AssetStore,
    mesh: Mesh,
    graph: WrinkleGraph,
    settings: AssetSettings,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    asset, place, here = "00112233aabbccdd", str(new_folder(tmp_path)), tmp_path / "here"
    facts = {"spacing": 0.5, "distance": 0.5, "uv_length": 10.0, "warnings": []}
    store.put_asset(asset, mesh, graph, settings, facts)
    changing, watch = StoreMirror(store, SharedStore.at(place)), Stopwatch()
    service = replace(ServiceSettings.from_environment(), store=here, shared_store=place)

    def fetched(r_max: float) -> AssetSettings | None:
        store.put_overlay(asset, settings.with_r_max(r_max))
        changing.push(asset, lambda share, file: None)
        fetch(service, asset, watch)
        with AssetStore(here) as found:
            return found.overlay(asset)

    assert [fetched(0.2), fetched(0.3)] == [settings.with_r_max(r) for r in (0.2, 0.3)]
    fetch(service, asset, watch)
    fetch(service, "0" * 16, watch)
    assert len(watch.seconds["fetch"]) == 2

    store.put_overlay(asset, settings.with_r_max(0.4))
    changing.push(asset, lambda share, file: None)
    out = ["--out", str(tmp_path / "a.tar"), "--store", str(here), "--shared-store", place]
    assert main(["snapshot", asset, *out]) == 0
    with store.snapshots.of(asset) as made:
        assert (tmp_path / "a.tar").read_bytes() == b"".join(made.pieces())

    def away(self: SharedStore, id: str) -> None:
        raise SharedStoreError("it does not answer")

    monkeypatch.setattr(SharedStore, "index", away)
    assert main(["snapshot", asset, *out]) == 0
    assert f"{asset} is taken as it is here: it does not answer" in capsys.readouterr().err
    assert main(["snapshot", "0" * 16, *out]) == 1


def test_a_bake_whose_asset_cannot_be_shared_says_so(
    tmp_path: Path,
    small_mesh: SmallMesh,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    mesh = str(write_animation(tmp_path / "shot.npz", small_mesh, 1))
    folder, maps = new_folder(tmp_path), tmp_path / "maps"

    def full(*arguments: object, **named: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("rhytid.storage.shared.folder_backend.FolderBackend._install", full)
    bake = ["bake", "--mesh", mesh, "--out", str(maps), *SMALL]
    assert main([*bake, "--shared-store", str(folder)]) == 0

    assert "is not in the shared store" in capsys.readouterr().err
    assert [file.suffix for file in maps.glob("*.exr")] == [".exr"]


@pytest.mark.parametrize("command", ["bake", "serve", "restore", "snapshot"])
def test_a_shared_store_that_is_not_there_is_refused(
    command: str, tmp_path: Path, small_mesh: SmallMesh, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh = str(write_animation(tmp_path / "shot.npz", small_mesh, 1))
    out = str(tmp_path / "out")
    arguments = {
        "bake": ["--mesh", mesh, "--out", out, *SMALL],
        "serve": ["--port", "0", "--store", out],
        "restore": [mesh, "--store", out],
        "snapshot": ["0" * 16, "--store", out],
    }
    missing = str(tmp_path / "missing")

    assert main([command, *arguments[command], "--shared-store", missing]) == 1

    assert f"{missing}: no such folder; make it, or mount it" in capsys.readouterr().err
