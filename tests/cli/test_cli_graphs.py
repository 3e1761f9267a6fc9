"""Graphs on the command line: what `synthesize` and `graph` write and tell, and hand-made ones."""

from __future__ import annotations

import errno
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import handmade
from cli.running import write_neutral
from meshes import SmallMesh
from rhytid.cli import graph_output, main
from rhytid.formats.exr import read_exr
from rhytid.formats.graphs import read_graph
from rhytid.synthesis.progress import clocked


@pytest.fixture
def mesh(tmp_path: Path, small_mesh: SmallMesh) -> str:
    return str(write_neutral(tmp_path / "mesh.npz", small_mesh))


def frame_of(mesh: str, file: Path) -> str:
    """The neutral positions of a mesh, as a frame."""
    with np.load(mesh) as arrays:
        np.save(file, arrays["positions"])
    return str(file)


def told(capsys: pytest.CaptureFixture[str]) -> Any:
    return json.loads(capsys.readouterr().out)


@pytest.mark.slow
def test_synthesize_tells_what_the_file_holds(
    tmp_path: Path, mesh: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "g.safetensors"
    assert main(["synthesize", mesh, "--out", str(out), "--wrinkles", "300", "--json"]) == 0
    figures = told(capsys)
    graph = read_graph(out.read_bytes())
    assert (figures["pores"], figures["wrinkles"]) == graph.counts()
    assert figures["drawn_pores"] == np.count_nonzero(graph.pore_weight[graph.own_nodes])
    assert figures["seconds"].keys() >= {"pores", "edges", "trails"}
    assert all(seconds >= 0 for seconds in figures["seconds"].values())
    seconds = figures.pop("seconds")

    monkeypatch.setattr(graph_output, "_beside", None)  # which is for a graph that is written
    assert main(["graph", mesh, str(out), "--json"]) == 0
    assert told(capsys) == figures
    assert main(["graph", mesh, str(out)]) == 0
    table = capsys.readouterr().out
    assert re.search(rf"^pores +{graph.counts()[0]}$", table, re.MULTILINE)
    assert seconds


def test_a_graph_that_cannot_be_written_is_no_success(
    tmp_path: Path, mesh: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Though it was measured meanwhile, nothing is reported."""
    out = tmp_path / "g.safetensors"

    def fail(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("rhytid.support.atomic_files.write_pieces", fail)
    assert main(["synthesize", mesh, "--out", str(out), "--wrinkles", "300", "--json"]) != 0
    told_of = capsys.readouterr()
    assert told_of.out == ""
    assert "No space left on device" in told_of.err
    assert not out.exists()


@pytest.mark.slow
def test_what_is_asked_for_is_written_and_folders_are_made(tmp_path: Path, mesh: str) -> None:
    out = tmp_path / "a" / "g.safetensors"
    files = {name: tmp_path / name[0] / f"g.{name}" for name in ("obj", "json", "png")}
    options = {"--curves": files["obj"], "--json": files["json"], "--preview": files["png"]}
    given = ["synthesize", mesh, "--out", str(out), "--wrinkles", "300", "--unit", "m"]
    assert main([*given, *(str(word) for pair in options.items() for word in pair)]) == 0
    assert json.loads(files["json"].read_text())["wrinkles"] == 300
    assert files["obj"].read_text().startswith("# ")
    assert "in m\n" in files["obj"].read_text()[:40]
    with Image.open(files["png"]) as picture:
        assert picture.width > 500
        assert np.asarray(picture).std() > 5
    kept = {path.name for path in tmp_path.rglob("*") if path.is_file()}
    assert kept == {"mesh.npz", "g.safetensors", "g.obj", "g.json", "g.png"}


@pytest.mark.parametrize(
    ("option", "file", "wrong"),
    [
        ("--curves", "g.fbx", r".obj, .usda"),
        ("--preview", "g.jpg", ".png"),
        ("--out", "g.npz", ".safetensors"),
    ],
)
def test_an_unknown_extension_is_refused_before_anything_is_done(
    tmp_path: Path,
    mesh: str,
    capsys: pytest.CaptureFixture[str],
    option: str,
    file: str,
    wrong: str,
) -> None:
    out = tmp_path / "g.safetensors"
    given = ["synthesize", mesh, "--out", str(out), option, str(tmp_path / file)]
    assert main(given) == 1
    message = capsys.readouterr().err
    assert file in message
    assert wrong in message
    assert not out.exists()


@pytest.mark.parametrize("option", ["--out", "--curves", "--preview", "--json"])
@pytest.mark.parametrize("place", ["taken/g", "folder"])
def test_what_cannot_be_written_is_refused_before_anything_is_done(
    tmp_path: Path, mesh: str, capsys: pytest.CaptureFixture[str], option: str, place: str
) -> None:
    endings = {"--out": ".safetensors", "--curves": ".obj", "--preview": ".png", "--json": ".json"}
    wrong = (tmp_path / place).with_suffix(endings[option])
    (tmp_path / "taken").write_text("no folder")
    if place == "folder":
        wrong.mkdir()
    out = tmp_path / "g.safetensors"
    given = ["synthesize", mesh, "--wrinkles", "300", "--out", str(out), option, str(wrong)]
    assert main(given) == 1
    message = capsys.readouterr().err
    assert str(wrong) in message
    assert "synthesis" not in message
    assert not out.exists()


@pytest.mark.slow
def test_a_hand_made_graph_is_described_and_baked(
    tmp_path: Path, mesh: str, capsys: pytest.CaptureFixture[str]
) -> None:
    graph = str(handmade.write(tmp_path / "seven.safetensors"))
    curves, picture = tmp_path / "seven.usda", tmp_path / "seven.png"
    given = ["graph", mesh, graph, "--curves", str(curves), "--preview", str(picture), "--json"]
    assert main(given) == 0
    figures = told(capsys)
    assert (figures["pores"], figures["wrinkles"], figures["seam_wrinkles"]) == (8, 7, 0)
    assert figures["degree"]["histogram"] == [0, 7, 0, 0, 0, 0, 0, 1]
    assert sum(figures["angles"]) == 7
    assert "curveVertexCounts = [2, 2, 2, 2, 2, 2, 2]" in curves.read_text()
    assert picture.stat().st_size > 1000

    frame = frame_of(mesh, tmp_path / "f_0001.npy")
    out = tmp_path / "maps"
    bake = ["bake", "--mesh", mesh, "--frames", frame, "--out", str(out), "--graph", graph]
    settings = tmp_path / "settings.json"  # lines and pores alone
    settings.write_text('{"shape": {"grain": 0, "undulation": 0}}')
    assert main([*bake, "--resolution", "256", "--settings", str(settings)]) == 0
    texels = read_exr(out / "mesh.1001.0001.exr")[0]
    assert 10 < np.count_nonzero(texels) < texels.size / 4


@pytest.mark.parametrize("name", handmade.BAD)
@pytest.mark.parametrize("command", ["graph", "bake"])
def test_what_is_wrong_with_a_graph_is_named(
    tmp_path: Path, mesh: str, capsys: pytest.CaptureFixture[str], command: str, name: str
) -> None:
    changes, wrong = handmade.BAD[name]
    graph = str(handmade.write(tmp_path / "bad.safetensors", **changes))
    frame = frame_of(mesh, tmp_path / "f_0001.npy")
    given = {
        "graph": [mesh, graph],
        "bake": ["--mesh", mesh, "--graph", graph, "--frames", frame, "--out", str(tmp_path / "m")],
    }
    assert main([command, *given[command]]) == 1
    assert wrong in capsys.readouterr().err


def test_stages_are_timed_by_name() -> None:
    seen: list[tuple[float, str]] = []
    clock, seconds = clocked(lambda *report: seen.append(report))
    for stage in ("pores", "edges", "pores", "shapes", "shapes"):
        clock(0.5, stage)
    assert list(seconds) == ["pores", "edges", "shapes"]
    assert len(seen) == 5
