"""What folds take as a package computes it: against the reference, the device, and JavaScript."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import rhytid_viewer
from exports.skin_package.conftest import Written
from meshes import deform
from reference import folding as reference
from rhytid.domain.mesh import Mesh
from rhytid.exports.skin_package.manifest import Manifest
from rhytid.exports.skin_package.runtime import folds, stretch

NUMBERS = {
    "length": 5.6,
    "most": 0.9,
    "least": 0.5,
    "most_bend": 45.0,
    "rounds": 3,
    "normal_rounds": 1,
}


def pressed(mesh: Any) -> NDArray[np.float32]:
    """Positions that are shorter along x, with folds."""
    moved = deform(mesh.positions, 3, 0.08) * (0.4, 1.0, 1.0)
    moved[:, 2] += 0.2 * np.cos(2.5 * np.pi * mesh.positions[:, 0])
    return moved.astype(np.float32)


def rest_of(mesh: Mesh) -> NDArray[np.float64]:
    return stretch.rest_of(mesh.positions, mesh.faces, mesh.triangle_uv())


def test_the_share_is_that_of_the_reference(written: Written) -> None:
    mesh = written.mesh
    moved = pressed(mesh)
    found = folds.Folds(mesh.positions, mesh.faces, rest_of(mesh), NUMBERS).shares(moved)
    want = reference.taken(mesh.positions, mesh.faces, moved, 5.6, 3, 1)

    assert want.max() > 0.1
    assert np.abs(found - want).max() < 1e-6


def test_the_manifest_has_the_numbers_of_the_device(written: Written) -> None:
    manifest = Manifest.model_validate_json((written.folder / "manifest.json").read_bytes())
    numbers = manifest.stretch.folds
    assert numbers is not None
    mesh, moved = written.mesh, pressed(written.mesh)
    written.engine.frames.put(written.asset, "folded", moved)
    want = written.engine.frames.stretch(written.asset, "folded").folds
    rest = stretch.read_rest(written.folder / "triangles.bin")
    found = folds.Folds(mesh.positions, mesh.faces, rest, numbers.model_dump()).shares(moved)

    assert np.abs(found - want).max() < 2e-4
    assert (stretch.log_stretch(moved, mesh.faces, rest, folds=found)[:, 6] == found).all()


@pytest.mark.parametrize("rounds", [(3, 1), (1, 0)])
def test_javascript_gives_the_numbers_of_numpy(
    written: Written, tmp_path: Path, rounds: tuple[int, int]
) -> None:
    node = shutil.which("node")
    assert node is not None, "needs Node.js"
    mesh, moved = written.mesh, pressed(written.mesh)
    numbers = {**NUMBERS, "rounds": rounds[0], "normal_rounds": rounds[1]}
    mesh.positions.astype("<f4").tofile(tmp_path / "neutral")
    moved.astype("<f4").tofile(tmp_path / "positions")
    mesh.faces.astype("<u4").tofile(tmp_path / "indices")
    for name in ("stretch", "folds"):
        (tmp_path / f"{name}.mjs").write_bytes(rhytid_viewer.read(f"{name}.js"))
    (tmp_path / "run.mjs").write_text(
        f"""
import {{ readFileSync, writeFileSync }} from "node:fs";
import {{ Folds }} from "./folds.mjs";
import {{ readRest, stretchTexture }} from "./stretch.mjs";
const bytes = (file) => new Uint8Array(readFileSync(file)).buffer;
const floats = (file) => new Float32Array(bytes(file));
const rest = readRest(bytes({str(written.folder / "triangles.bin")!r}));
const folds = new Folds(floats("neutral"), new Uint32Array(bytes("indices")), rest, {numbers});
const out = stretchTexture(rest.length / 8, 512);
folds.write(floats("positions"), out);
writeFileSync("out", out);
""",
        encoding="utf-8",
    )
    subprocess.run([node, "run.mjs"], cwd=tmp_path, check=True)

    rest = stretch.read_rest(written.folder / "triangles.bin")
    want = folds.Folds(mesh.positions, mesh.faces, rest, numbers).shares(moved)
    got = np.fromfile(tmp_path / "out", "<f4").reshape(-1, 8)[: len(mesh.faces), 6]
    assert want.max() > 0.1
    assert np.abs(got - want).max() < 1e-6
