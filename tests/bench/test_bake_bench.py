"""The bench of a bake: what it measures, and of which files."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from meshes import SmallMesh
from rhytid.cli import main
from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import mesh_udims
from rhytid_lab.bench import bake
from rhytid_lab.bench.bake import BakeCost, Spent, four_udims


def test_a_bench_measures_every_part(
    tmp_path: Path,
    small_mesh: SmallMesh,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(bake, "WRITTEN", {1: (("half",), ("float", "ply")), 4: (("half",),)})
    monkeypatch.setattr(bake, "METHODS", ("redraw",))
    mesh, figures = tmp_path / "mesh.npz", tmp_path / "figures.json"
    arrays = {name: getattr(small_mesh, name) for name in ("positions", "faces", "uv", "face_uv")}
    stretched = [small_mesh.positions * np.array([1 + 0.02 * k, 1, 1]) for k in range(5)]
    np.savez(mesh, **arrays, frames=np.array(stretched, np.float32))
    given = ["bench", "--bake", "--mesh", str(mesh), "--size", "256", "--wrinkles", "400"]

    assert main([*given, "--json", str(figures)]) == 0
    assert "is replaced" not in capsys.readouterr().err

    found = json.loads(figures.read_text())
    assert found["frames"] == 5
    rows = found["results"]
    assert [(row["written"], row["udims"]) for row in rows] == [
        ("half", 1), ("float ply", 1), ("half", 4),
    ]  # fmt: skip
    for row in rows:
        for part in ("kernels", "drawn", "files", "bake"):
            assert row[part]["seconds"] > 0.0
            assert row[part]["processor"] > 0.0


def test_few_frames_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mesh = tmp_path / "mesh.npz"
    square = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
    corners = np.array([[0, 1, 2]])
    uv = {"uv": square[:, :2], "face_uv": corners}
    np.savez(mesh, positions=square, faces=corners, **uv, frames=square[None])

    assert main(["bench", "--bake", "--mesh", str(mesh)]) == 1
    assert "--bake needs 5 frames or more, 1 are there" in capsys.readouterr().err


def test_the_ratios_are_to_the_processor_time_of_kernels_and_files(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(bake, "core_count", lambda: 4)
    parts = Spent(9.0, 1.5), Spent(9.0, 9.0), Spent(9.0, 0.5), Spent(1.0, 3.0)
    cost = BakeCost("binned", "half", 1, *parts)

    assert (cost.ratio, cost.work) == (2.0, 1.5)


def test_four_copies_lie_on_four_udims(small_mesh: SmallMesh) -> None:
    mesh = Mesh(small_mesh.positions, small_mesh.faces, small_mesh.uv, small_mesh.face_uv)
    frames = np.stack([mesh.positions, 2 * mesh.positions]).astype(np.float32)

    four, moved = four_udims(mesh, frames)

    assert mesh_udims(four) == (1001, 1002, 1003, 1004)
    assert (len(four.faces), moved.shape) == (4 * len(mesh.faces), (2, len(four.positions), 3))
    np.testing.assert_allclose(moved[0], four.positions, atol=1e-5)
