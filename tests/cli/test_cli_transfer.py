"""`rhytid transfer`: graphs of other programs and of this one, from file to file."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import handmade
from cli.running import write_neutral
from meshes import SmallMesh
from rhytid.cli import main
from rhytid.domain.graph import mesh_digest
from rhytid.formats.graphs import read_graph
from rhytid.formats.meshes import read_mesh


@pytest.fixture
def files(tmp_path: Path, small_mesh: SmallMesh) -> tuple[str, str, str]:
    """A graph that names no triangles, its mesh, and the same of other order and UV."""
    graph = handmade.write(tmp_path / "g.safetensors")
    old = write_neutral(tmp_path / "old.npz", small_mesh)
    order = np.random.default_rng(0).permutation(len(small_mesh.faces))
    uv = small_mesh.uv * np.float32(0.5)
    faces, face_uv = small_mesh.faces[order], small_mesh.face_uv[order]
    new = tmp_path / "new.npz"
    np.savez(new, **small_mesh._replace(uv=uv, faces=faces, face_uv=face_uv)._asdict())
    return str(graph), str(old), str(new)


def test_a_graph_is_written_and_figures_told(
    files: tuple[str, str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, figures = tmp_path / "new" / "out.safetensors", tmp_path / "f.json"
    assert main(["transfer", *files, "--out", str(out), "--json", str(figures)]) == 0

    known = json.loads(figures.read_text())
    assert (known["pores before"], known["pores"]) == (8, 8)
    assert (known["wrinkles before"], known["wrinkles"]) == (7, 7)
    assert known["far"] == known["lost"] == known["torn"] == 0
    assert "mean distance" in capsys.readouterr().out
    made, before = (read_graph(Path(file).read_bytes()) for file in (out, files[0]))
    assert made.node_uv == pytest.approx(before.node_uv * 0.5, abs=1e-6)
    assert made.edge_half_width == pytest.approx(before.edge_half_width * 0.5, rel=1e-5)
    new = read_mesh(Path(files[2]).read_bytes(), "new.npz").mesh
    assert made.origin is not None
    assert made.origin.mesh == mesh_digest(new)
    # It is taken for the other mesh, and refused for its own.
    back = ["transfer", str(out), files[2], files[1], "--out", str(tmp_path / "back.safetensors")]
    assert main(back) == 0
    assert main(["transfer", str(out), files[1], files[1], "--out", str(out)]) == 1
    assert "made for another mesh" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("out", "more", "said"),
    [
        ("g.npz", [], "g.npz: the graph is written as .safetensors"),
        ("g.safetensors", ["--reach", "0"], "--reach is 0: must be above 0"),
        ("g.safetensors", ["--unit", "mm", "--strict"], "--strict: 1 warning"),
    ],
)
def test_what_cannot_be_done_is_an_error(
    files: tuple[str, str, str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    out: str,
    more: list[str],
    said: str,
) -> None:
    place = tmp_path / "out" / out
    assert main(["transfer", *files, "--out", str(place), *more]) == 1
    assert said in capsys.readouterr().err
    assert not place.exists()
