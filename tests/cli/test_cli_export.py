"""`rhytid export`: packages from files and from a store."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import handmade
from cli.running import usage_error, write_neutral
from meshes import SmallMesh, deform
from rhytid.cli import main
from rhytid.domain.expressions import Expressions
from rhytid.domain.mesh import Mesh
from rhytid.storage.store import AssetStore


@pytest.fixture
def mesh(tmp_path: Path, small_mesh: SmallMesh) -> Path:
    """A .npz of a mesh with two shapes."""
    shapes = np.stack([deform(small_mesh.positions, seed, 0.02 * seed) for seed in (1, 2)])
    file = tmp_path / "face.npz"
    np.savez(file, **small_mesh._asdict(), shapes=shapes, names=np.array(["smile", "frown"]))
    return file


@pytest.mark.slow
def test_a_mesh_becomes_a_package_and_its_asset_does_again(
    tmp_path: Path, mesh: Path, small_mesh: SmallMesh, capsys: pytest.CaptureFixture[str]
) -> None:
    graph, store = handmade.write(tmp_path / "g.safetensors"), str(tmp_path / "store")
    settings = tmp_path / "s.json"
    settings.write_text('{"preset": "paper", "resolution": 256, "tile_size": 256}')
    first, second = tmp_path / "first", tmp_path / "second"
    given = ["--mesh", str(mesh), "--graph", str(graph), "--settings", str(settings)]

    assert main(["export", str(first), *given, "--store", store, "--json"]) == 0

    figures = json.loads(capsys.readouterr().out)
    manifest = json.loads((first / "manifest.json").read_bytes())
    assert (manifest["mesh"]["shapes"], manifest["resolution"]) == (["smile", "frown"], 256)
    assert figures["texture_bytes"] == manifest["texture_bytes"]
    assert figures["bytes"] == sum(f.stat().st_size for f in first.rglob("*") if f.is_file())
    # Of the second shape, which is twice as far from the neutral.
    assert figures["r_max"] == manifest["blend"]["r_max"] != 0.2

    again = ["--asset", figures["asset"], "--store", store, "--levels", "1", "-q"]
    assert main(["export", str(second), *again]) == 0

    found = json.loads((second / "manifest.json").read_bytes())
    assert found["mesh"]["shapes"] == []
    assert found["textures"]["levels"] == 1
    assert found["blend"] == manifest["blend"]
    assert (second / "triangles.bin").read_bytes() == (first / "triangles.bin").read_bytes()

    moved = np.load(mesh)["shapes"][:1] - np.float32(Mesh(*small_mesh).centre)
    with AssetStore(Path(store)) as kept:
        kept.put_shapes(figures["asset"], Expressions(np.float32(moved), ("pout",)))
    assert main(["export", str(tmp_path / "third"), *again]) == 0
    found = json.loads((tmp_path / "third" / "manifest.json").read_bytes())
    assert found["mesh"]["shapes"] == ["pout"]


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ([], "one of the arguments --mesh --asset is required"),
        (["--asset", "a" * 16, "--resolution", "256"], "--resolution says how an asset is built"),
        (["--asset", "a" * 16, "--set", "age=20"], "--set says how an asset is built"),
        (["--asset", "a" * 16, "--levels", "0"], "invalid choice"),
    ],
)
def test_options_without_effect_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], why: str
) -> None:
    assert why in usage_error(capsys, "export", str(tmp_path / "out"), *options)


def test_what_cannot_be_exported_is_said_before_anything_is_built(
    tmp_path: Path, small_mesh: SmallMesh, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh, out = str(write_neutral(tmp_path / "face.npz", small_mesh)), tmp_path / "out"
    settings = tmp_path / "s.json"
    settings.write_text('{"bins": {"merge": "mellow"}}')
    given = ["export", str(out), "--mesh", mesh, "--settings", str(settings)]

    assert main(given) == 1
    assert "bins.merge is mellow: packages are made" in capsys.readouterr().err
    assert main(["export", str(out), "--asset", "a" * 16, "--store", str(tmp_path)]) == 1
    assert "is no store of assets" in capsys.readouterr().err
    assert not out.exists()
