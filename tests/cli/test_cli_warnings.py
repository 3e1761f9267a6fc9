"""Warnings of the commands: told on stderr, counted at the end, an error with --strict."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

import face_data
from cli.running import usage_error
from rhytid.baking.run_warnings import RunWarnings
from rhytid.cli import main
from rhytid.domain.notices import NOTICES
from rhytid.domain.warnings import CODES, InputWarning
from rhytid.errors import StrictError
from rhytid.storage.store import AssetStore
from rhytid_lab.samples.face import procedural_face

pytestmark = pytest.mark.release

SMALL = ("--resolution", "256", "--wrinkles", "400")
SAMPLE = procedural_face(16)
ARRAYS = {name: getattr(SAMPLE.mesh, name) for name in ("positions", "faces", "uv", "face_uv")}


@pytest.fixture
def neutral(tmp_path: Path) -> Path:
    np.savez(tmp_path / "head.npz", **ARRAYS)
    return tmp_path / "head.npz"


@pytest.fixture
def metres(tmp_path: Path) -> Path:
    """Two frames in metres."""
    frames = [SAMPLE.pose({"smile": w}) / np.float32(100) for w in (0.5, 1.0)]
    np.save(tmp_path / "shot.npy", np.stack(frames))
    return tmp_path / "shot.npy"


def lines(capsys: pytest.CaptureFixture[str], code: str) -> list[str]:
    """Those of a code; the last line of all says how many warnings there are, and none again."""
    told = capsys.readouterr().err.splitlines()
    warned = [line for line in told if "warning: " in line]
    assert len(set(warned)) == len(warned)
    if warned and "--strict: " not in told[-1]:
        some = "1 warning" if len(warned) == 1 else f"{len(warned)} warnings"
        let = sum("allowed warning: " in line for line in warned)
        some += f", {let} of them allowed" if let else ""
        assert told[-1].endswith(f": {some}, listed above; `rhytid warnings CODE` says what to do")
        assert sum("listed above" in line for line in told) == 1
    return [line for line in warned if f"warning: {code}: " in line]


@pytest.mark.slow
@pytest.mark.parametrize("method", ["redraw", "binned"])
def test_bake_tells_what_and_where_once(
    neutral: Path, metres: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], method: str
) -> None:
    out, figures = tmp_path / "maps", tmp_path / "figures.json"
    given = ["--mesh", str(neutral), "--frames", str(metres), "--out", str(out), *SMALL]
    assert main(["bake", *given, "--method", method, "--json", str(figures)]) == 0
    told = lines(capsys, "frame-scaled")
    assert [f"frame 000{i} of shot.npy" in line for i, line in zip((1, 2), told, strict=False)] == [
        True,
        True,
    ]
    assert all(line.startswith("rhytid bake: ") and "m beside" in line for line in told)
    assert len(told) == 2
    kept = json.loads(figures.read_text())["warnings"]
    assert [w["code"] for w in kept] == ["frame-scaled"] * 2


def test_strict_bake_writes_nothing(
    neutral: Path, metres: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "maps"
    given = ["--mesh", str(neutral), "--frames", str(metres), "--out", str(out), *SMALL]
    assert main(["bake", *given, "--strict"]) == 1
    told = capsys.readouterr().err
    assert "--strict: 2 warnings, so nothing was done" in told
    assert "frame 0002 of shot.npy" in told
    assert not out.exists()


def test_what_is_allowed_is_told_and_no_error(
    neutral: Path, metres: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of two warnings one is allowed: the other is an error still."""
    out, figures = tmp_path / "maps", tmp_path / "figures.json"
    given = ["bake", "--mesh", str(neutral), "--frames", str(metres), "--out", str(out), *SMALL]
    given += ["--json", str(figures), "--strict", "--allow", "frame-scaled"]
    (tmp_path / "mm.json").write_text('{"unit": "mm"}')
    assert main([*given, "--settings", str(tmp_path / "mm.json")]) == 1
    told = capsys.readouterr().err
    assert "rhytid bake: allowed warning: frame-scaled: " in told
    assert "rhytid bake: warning: mesh-size: " in told
    assert "--strict: 1 warning, so nothing was done (--allow mesh-size would allow that)" in told
    assert not out.exists()
    assert main(given) == 0
    assert lines(capsys, "frame-scaled")
    kept = json.loads(figures.read_text())["warnings"]
    assert [w["code"] for w in kept] == ["frame-scaled"] * 2


@pytest.mark.parametrize("command", ["bake", "demo", "synthesize", "graph"])
def test_of_an_unknown_code_the_known_ones_are_told(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    told = usage_error(capsys, command, "--allow", "texel-sise")
    assert "texel-sise" in told
    assert all(code in told for code in CODES)


@pytest.mark.face
def test_the_real_face_is_used_strictly_with_its_nostrils_allowed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    face = face_data.load_face()
    names = ("positions", "faces", "uv", "face_uv")
    np.savez(tmp_path / "face.npz", **{name: getattr(face, name) for name in names})
    out = tmp_path / "face.safetensors"
    given = ["synthesize", str(tmp_path / "face.npz"), "--out", str(out), "--wrinkles", "300"]
    assert main([*given, "--strict"]) == 1
    assert not out.exists()
    assert lines(capsys, "texel-size")
    assert main([*given, "--strict", "--allow", "texel-size"]) == 0
    assert out.exists()
    assert lines(capsys, "texel-size")


def test_what_is_right_is_baked_strictly_and_in_silence(
    neutral: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    np.save(tmp_path / "smile.npy", SAMPLE.pose({"smile": 1.0}))
    out = tmp_path / "maps"
    given = ["--mesh", str(neutral), "--frames", str(tmp_path / "smile.npy"), "--out", str(out)]
    assert main(["bake", *given, *SMALL, "--strict"]) == 0
    assert "warning" not in capsys.readouterr().err
    assert len(list(out.glob("*.exr"))) == 1


def test_settings_of_synthesis_beside_a_graph_are_told_before_anything_is_made(
    neutral: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    graph, settings = tmp_path / "g.safetensors", tmp_path / "old.json"
    assert main(["synthesize", str(neutral), "--out", str(graph), "--wrinkles", "300"]) == 0
    capsys.readouterr()
    frames, out = str(tmp_path / "smile.npy"), tmp_path / "maps"
    np.save(frames, SAMPLE.pose({"smile": 1.0}))
    settings.write_text('{"graph": {"age": 65, "seed": 2, "spacing": 0.1}}')
    given = ["bake", "--mesh", str(neutral), "--frames", frames, "--graph", str(graph)]
    given += ["--settings", str(settings), "--resolution", "256", "--out", str(out)]
    assert main([*given, "--strict"]) == 1
    (told,) = lines(capsys, "settings-unused")
    assert "settings: graph.age (65.0): " in told
    assert "--graph" in told
    assert not out.exists()
    assert main(given) == 0
    assert len(lines(capsys, "settings-unused")) == 1


def test_a_store_whose_asset_was_changed_is_baked_with_a_warning(
    neutral: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    frames, store = str(tmp_path / "smile.npy"), tmp_path / "store"
    np.save(frames, SAMPLE.pose({"smile": 1.0}))
    given = ["bake", "--mesh", str(neutral), "--frames", frames, "--store", str(store), *SMALL]
    assert main([*given, "--out", str(tmp_path / "a")]) == 0
    with AssetStore(store) as kept:
        (asset,) = kept.ids()
        present = kept.overlay(asset)
        assert present is not None
        kept.put_overlay(asset, present.changed({"shape": {"cushion": 0.2}}))
    assert not lines(capsys, "settings-changed")
    assert main([*given, "--out", str(tmp_path / "b")]) == 0
    (told,) = lines(capsys, "settings-changed")
    assert "shape.cushion is 0.2, sent was 0.7" in told
    assert main([*given, "--out", str(tmp_path / "c"), "--strict"]) == 1


def test_the_spacing_told_and_the_depth_are_as_many_times_the_usual_ones(
    neutral: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """On a neck pores are farther apart than their spacing."""
    graph = tmp_path / "g.safetensors"
    given = (str(neutral), "--region", "neck", "--wrinkles", "400", "--out", str(graph))
    assert main(["synthesize", *given]) == 0
    (told,) = [line for line in capsys.readouterr().err.splitlines() if "fix the spacing" in line]
    spacing, usual, depth, usual_depth = map(float, re.findall(r"([\d.]+) mm", told)[:4])
    assert depth / usual_depth == pytest.approx(spacing / usual, rel=0.01)


@pytest.mark.slow
def test_commands_tell_lengths_of_a_number_of_wrinkles_and_grain_that_is_not_drawn(
    neutral: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """And --strict lets it be."""
    np.save(tmp_path / "smile.npy", SAMPLE.pose({"smile": 1.0}))
    animation = ["--mesh", str(neutral), "--frames", str(tmp_path / "smile.npy"), *SMALL]
    figures = tmp_path / "figures.json"
    commands = {
        "bake": [*animation, "--out", str(tmp_path / "maps"), "--json", str(figures)],
        "demo": [*animation, "--out", str(tmp_path / "demo")],
        "synthesize": [str(neutral), "--out", str(tmp_path / "g.safetensors"), *SMALL[2:]],
    }
    for command, given in commands.items():
        assert main([command, *given, "--strict"]) == 0
        told = [line for line in capsys.readouterr().err.splitlines() if "notice: " in line]
        start = f"rhytid {command}: notice: "
        if command != "demo":
            assert told.pop(0).startswith(f"{start}about 400 wrinkles and 190 pores, ")
        assert told[0].startswith(f"{start}400 wrinkles fix the spacing, and depths follow it: ")
        assert [line.partition(" drawn")[0] for line in told[1:]] == (
            [] if command == "synthesize" else [f"{start}grain-not-drawn: no grain is"]
        )
    for file in (figures, tmp_path / "demo" / "times.json"):
        kept = json.loads(file.read_text())
        assert [n["code"] for n in kept["notices"]] == ["grain-not-drawn"]
        assert kept["warnings"] == []


@pytest.mark.slow
def test_demo_warns_and_refuses(
    neutral: Path, metres: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["demo", "--mesh", str(neutral), "--frames", str(metres), *SMALL]
    out = tmp_path / "demo"
    assert main([*given, "--out", str(out), "--unit", "mm", "--strict"]) == 1
    told = capsys.readouterr().err
    assert "warning: mesh-size: head.npz, mesh: " in told
    assert "warning: frame-scaled: frame 0001 of shot.npy" in told
    assert not out.exists()
    assert main([*given, "--out", str(out)]) == 0
    told = lines(capsys, "frame-scaled")
    assert ["frame 0001 of shot.npy" in line for line in told] == [True, False]
    assert len(json.loads((out / "times.json").read_text())["warnings"]) == 2


def test_a_run_that_fails_points_at_what_may_be_the_reason(
    neutral: Path, metres: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """There is no patch of skin 6 mm wide on a head of 24 mm."""
    given = ["demo", "--mesh", str(neutral), "--frames", str(metres), "--unit", "mm", *SMALL]
    assert main([*given, "--out", str(tmp_path / "demo")]) == 1
    told = capsys.readouterr().err
    assert told.count("warning: mesh-size: head.npz, mesh: ") == 1
    assert "rhytid demo: 3 warnings, listed above; " in told


@pytest.mark.parametrize("command", ["synthesize", "graph"])
def test_graphs_of_a_mesh_in_the_wrong_unit(
    neutral: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    graph = tmp_path / "graph.safetensors"
    assert main(["synthesize", str(neutral), "--out", str(graph), "--wrinkles", "300"]) == 0
    assert "warning" not in capsys.readouterr().err
    made, curves = tmp_path / "made" / "g.safetensors", tmp_path / "curves" / "g.obj"
    rest = ["--out", str(made), "--wrinkles", "300"] if command == "synthesize" else [str(graph)]
    given = [command, str(neutral), *rest, "--curves", str(curves), "--unit", "m"]
    assert main([*given, "--strict"]) == 1
    assert lines(capsys, "mesh-size")
    assert not made.parent.exists()
    assert not curves.parent.exists()
    assert main(given) == 0
    assert len(lines(capsys, "mesh-size")) == 1
    assert curves.exists()


def test_a_long_shot_is_told_in_a_few_lines(capsys: pytest.CaptureFixture[str]) -> None:
    warned = RunWarnings("bake", False)
    for i in range(400):
        warned.frame([InputWarning("frame-scaled", "x", "?")], f"{i:04d}")
        warned.frame([InputWarning("frame-scaled", "x", "?")], f"{i:04d}")
    assert len(capsys.readouterr().err.splitlines()) == 3
    warned.frame([InputWarning("stretch-at-clamp", "y", "?")], "0000")
    assert len(capsys.readouterr().err.splitlines()) == 1
    warned.summarize()
    (told,) = capsys.readouterr().err.splitlines()
    assert told == (
        "rhytid bake: 401 warnings, listed above (3 of 400 frame-scaled); `rhytid warnings "
        "CODE` says what to do"
    )
    assert len(warned.figures()) == 401


def test_what_is_allowed_is_marked_and_counted(capsys: pytest.CaptureFixture[str]) -> None:
    warned = RunWarnings("bake", True, ["frame-scaled"])
    warned.frame([InputWarning("frame-scaled", "x", "?")], "0001")
    with pytest.raises(StrictError):
        warned.frame([InputWarning("stretch-at-clamp", "y", "?")], "0002")
    warned.summarize()
    assert capsys.readouterr().err.splitlines() == [
        "rhytid bake: allowed warning: frame-scaled: frame 0001: x",
        "rhytid bake: warning: stretch-at-clamp: frame 0002: y",
        "rhytid bake: 2 warnings, 1 of them allowed, listed above; `rhytid warnings CODE` says "
        "what to do",
    ]


def test_what_to_do_is_printed_without_the_documentation(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["warnings", "texel-size"]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert told.startswith("texel-size (warning) about: a mesh when: the side of a texel")
    assert "what to do: give the place that is named more room in UV" in told
    assert main(["warnings"]) == 0
    told = capsys.readouterr().out
    assert all(f"\n{code} (" in f"\n{told}" for code in (*CODES, *NOTICES))
    assert "texel-size" in usage_error(capsys, "warnings", "texel-sise")


def test_a_strict_command_ends_with_the_first_frame_that_is_wrong() -> None:
    with pytest.raises(StrictError):
        RunWarnings("bake", True).frame([InputWarning("frame-scaled", "x", "?")], "0001")
