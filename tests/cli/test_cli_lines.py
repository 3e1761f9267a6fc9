"""Lines by expressions on the command line: a folder of OBJ, a file, the mesh's own, none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from cli.running import write_neutral
from meshes import SmallMesh
from rhytid.cli import main
from rhytid.formats.graphs import read_graph
from rhytid.support import console

pytestmark = pytest.mark.release


def shapes_of(mesh: SmallMesh) -> np.ndarray:
    factors = np.float32([[0.8, 1, 1], [0.9, 1, 1]])
    return mesh.positions * factors[:, None]


def grown(tmp_path: Path, mesh: Path, *more: str) -> dict[str, bytes]:
    out = tmp_path / "g.safetensors"
    command = ["synthesize", str(mesh), "--out", str(out), "--wrinkles", "300", *more]
    assert main(command) == 0
    return {name: array.tobytes() for name, array in read_graph(out.read_bytes()).arrays().items()}


def write_obj(file: Path, positions: np.ndarray) -> None:
    file.write_text("".join(f"v {x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in positions))


def test_a_folder_a_file_and_the_mesh_itself_say_the_same(
    tmp_path: Path, small_mesh: SmallMesh
) -> None:
    neutral = write_neutral(tmp_path / "mesh.npz", small_mesh)
    shapes = shapes_of(small_mesh)
    folder = tmp_path / "shapes"
    folder.mkdir()
    for name, shape in zip("ab", shapes, strict=True):
        write_obj(folder / f"{name}.obj", shape)
    (folder / "notes.txt").write_text("not a shape")
    np.save(tmp_path / "s.npy", shapes)
    np.savez(tmp_path / "own.npz", **small_mesh._asdict(), shapes=shapes)
    plain = grown(tmp_path, neutral)
    ways = [
        grown(tmp_path, neutral, "--shapes", str(folder)),
        grown(tmp_path, neutral, "--shapes", str(tmp_path / "s.npy"), "--lines", "expressions"),
        grown(tmp_path, tmp_path / "own.npz"),
    ]
    assert ways[0] == ways[1] == ways[2] != plain
    assert grown(tmp_path, tmp_path / "own.npz", "--lines", "level") == plain


def test_mistakes_are_told_with_their_place(
    tmp_path: Path, small_mesh: SmallMesh, capsys: pytest.CaptureFixture[str]
) -> None:
    neutral = str(write_neutral(tmp_path / "mesh.npz", small_mesh))
    np.save(tmp_path / "few.npy", shapes_of(small_mesh)[:, :5])
    (tmp_path / "empty").mkdir()
    (tmp_path / "bad").mkdir()
    write_obj(tmp_path / "bad" / "smile.obj", small_mesh.positions[:7])
    (tmp_path / "offsets").mkdir()
    for name, shape in zip("ab", shapes_of(small_mesh) - small_mesh.positions, strict=True):
        write_obj(tmp_path / "offsets" / f"{name}.obj", 0.5 * shape)
    out = str(tmp_path / "g.safetensors")
    for more, told in (
        (["--lines", "expressions"], 'graph.lines is "expressions", and none came'),
        (["--shapes", str(tmp_path / "few.npy")], "few.npy: shapes have shape (2, 5, 3)"),
        (["--shapes", str(tmp_path / "empty")], "empty holds no OBJ files"),
        (["--shapes", str(tmp_path / "bad")], "smile.obj: frame has 7 vertices"),
        (["--shapes", str(tmp_path / "offsets")], "offsets: no shape is 20 % as large as the mesh"),
    ):
        assert main(["synthesize", neutral, "--out", out, *more]) != 0
        assert told in capsys.readouterr().err


@pytest.mark.slow
def test_the_lines_are_drawn_beside_a_preview(tmp_path: Path, small_mesh: SmallMesh) -> None:
    neutral = write_neutral(tmp_path / "mesh.npz", small_mesh)
    np.save(tmp_path / "s.npy", shapes_of(small_mesh))
    preview = tmp_path / "p.png"
    grown(tmp_path, neutral, "--shapes", str(tmp_path / "s.npy"), "--preview", str(preview))
    assert preview.exists()
    assert (tmp_path / "p.lines.png").exists()


@pytest.mark.slow
def test_the_regions_are_drawn_by_age_beside_a_preview(
    tmp_path: Path,
    small_mesh: SmallMesh,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    neutral = write_neutral(tmp_path / "mesh.npz", small_mesh)
    np.savez(tmp_path / "s.npz", shapes=shapes_of(small_mesh), names=["pucker", "browInnerUp"])
    files = ("--shapes", str(tmp_path / "s.npz"), "--preview", str(tmp_path / "p.png"))
    plain = grown(tmp_path, neutral, *files)
    with Image.open(tmp_path / "p.regions.png") as picture:
        width, one = picture.size
    capsys.readouterr()
    monkeypatch.setattr(console, "_EVERY", 0.002)
    more = grown(tmp_path, neutral, *files, "--ages", "20", "35", "65")
    monkeypatch.undo()
    told = capsys.readouterr().err
    steps = ("synthesis, age 20:", "preview:", "regions, age 65:")
    steps += ("placing patches,", "placing patches of regions,", "drawing p.regions.png,")
    assert all(f"rhytid: {step} " in told for step in steps)
    assert more == plain  # the graph that is written is that of --set age
    with Image.open(tmp_path / "p.regions.png") as picture:
        assert picture.size[0] == width
        rows = picture.size[1] - one
    assert rows == pytest.approx(2 * (one - 50), rel=0.15)
    assert grown(tmp_path, neutral, "--set", "age=65") != grown(tmp_path, neutral)
    command = ["synthesize", str(neutral), "--out", str(tmp_path / "g.safetensors")]
    assert main([*command, *files, "--ages", "80"]) != 0
    assert "one of --ages is 80: from 20 to 70" in capsys.readouterr().err


@pytest.mark.slow
def test_ages_of_a_mesh_without_regions_are_drawn_at_flat_places(
    tmp_path: Path, small_mesh: SmallMesh, capsys: pytest.CaptureFixture[str]
) -> None:
    neutral = write_neutral(tmp_path / "mesh.npz", small_mesh)
    given = ("--unit", "ft", "--preview", str(tmp_path / "p.png"))
    grown(tmp_path, neutral, *given)
    assert not (tmp_path / "p.regions.png").exists()
    grown(tmp_path, neutral, *given, "--ages", "20", "65")
    told = capsys.readouterr().err
    assert "rhytid synthesize: notice: neither painted masks" in told
    assert "show regions of the mesh: p.regions.png shows its flattest" in told
    with Image.open(tmp_path / "p.regions.png") as picture:
        assert picture.size[1] > 4 * 400  # two rows of patches for each age
