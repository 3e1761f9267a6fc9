"""The bench of a bake: what it measures, and of which files."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from meshes import SmallMesh
from rhytid.cli import main
from rhytid.cli.termination import INTERRUPTED
from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import mesh_udims
from rhytid_lab.bench import bake
from rhytid_lab.bench.bake import BakeBench, BakeCost, Spent, four_udims


def test_a_bench_measures_every_part(
    tmp_path: Path,
    small_mesh: SmallMesh,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(bake, "WRITTEN", {1: (("half",), ("float", "ply")), 4: (("half",),)})
    monkeypatch.setattr(bake, "METHODS", ("redraw",))
    figures = tmp_path / "figures.json"
    mesh = face_shot(tmp_path, small_mesh, [1 + 0.02 * k for k in range(5)])
    given = ["bench", "--bake", "--mesh", mesh, "--size", "256", "--wrinkles", "400"]

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


def face_shot(folder: Path, mesh: SmallMesh, factors: list[float]) -> str:
    """A mesh file whose frames are stretched by these factors."""
    file = folder / "shot.npz"
    arrays = {name: getattr(mesh, name) for name in ("positions", "faces", "uv", "face_uv")}
    stretched = [mesh.positions * np.array([factor, 1, 1]) for factor in factors]
    np.savez(file, **arrays, frames=np.array(stretched, np.float32))
    return str(file)


@pytest.mark.parametrize("factors", [[1.1], [1.1] * 8, [1.0, 1.1, 1.2, 1.3, 1.0, 1.1]])
def test_few_frames_that_differ_are_refused(
    factors: list[float],
    tmp_path: Path,
    small_mesh: SmallMesh,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["bench", "--bake", "--mesh", face_shot(tmp_path, small_mesh, factors)]) == 1
    differ, told = len({*factors}), capsys.readouterr().err
    assert f"--bake needs 5 frames that differ, {differ} of {len(factors)} do" in told


def test_frames_that_repeat_are_left_out_and_told(
    tmp_path: Path,
    small_mesh: SmallMesh,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    timed = []

    def cost(bench: BakeBench, method: str, written: Sequence[str]) -> BakeCost:
        timed.append(len(bench._frames.places))
        if len(timed) == 3:
            raise KeyboardInterrupt
        return BakeCost(method, " ".join(written), 1, *[Spent(1.0, 1.0)] * 4)

    monkeypatch.setattr(BakeBench, "cost", cost)
    shot = face_shot(tmp_path, small_mesh, [1.0, 1.1, 1.1, 1.2, 1.3, 1.4, 1.5])
    given = ["bench", "--bake", "--mesh", shot, "--size", "256", "--wrinkles", "400"]

    assert main([*given, "--methods", "binned", "--repeats", "3", "--json"]) == INTERRUPTED

    told = capsys.readouterr()
    assert timed == [5, 5, 5]
    assert "notice: 1 of 7 frames left out: a bake copies the files" in told.err
    assert "notice: it did not end: cases are missing above" in told.err
    figures = json.loads(told.out)
    assert figures["cancelled"] is True
    assert [(row["method"], row["written"]) for row in figures["results"]] == [
        ("binned", "half"), ("binned", "float"),
    ]  # fmt: skip


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
