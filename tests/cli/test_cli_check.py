"""`rhytid check`, from the command line to the table, JSON and picture."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from cli.running import usage_error
from meshes import SmallMesh
from rhytid.cli import main
from rhytid.domain.tiles import mesh_udims
from rhytid.formats.meshes import read_mesh
from rhytid_lab.samples.face import procedural_face

SAMPLE = procedural_face(16)
ARRAYS = {name: getattr(SAMPLE.mesh, name) for name in ("positions", "faces", "uv", "face_uv")}


@pytest.fixture
def head(tmp_path: Path) -> Path:
    np.savez(tmp_path / "head.npz", **ARRAYS)
    return tmp_path / "head.npz"


def turned(small: SmallMesh, file: Path) -> Path:
    """The sheet in space with triangle 70 turned over."""
    arrays = {name: array.copy() for name, array in small._asdict().items()}
    for name in ("faces", "face_uv"):
        arrays[name][70] = arrays[name][70][::-1]
    np.savez(file, **arrays)
    return file


def test_a_table_tells_and_the_status_is_0(
    small_mesh: SmallMesh, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", str(turned(small_mesh, tmp_path / "sheet.npz"))]) == 0
    told = capsys.readouterr()
    row = next(line for line in told.out.splitlines() if line.startswith("wound against"))
    assert "1 triangle, 3 edges" in row
    assert "triangle 70, uv (" in row
    assert "mesh-size" in told.err


def test_lengths_in_a_counted_unit_are_no_fourth_side(
    head: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", str(head), "--unit", "5.5cm"]) == 0
    rows = capsys.readouterr().out.splitlines()
    size = next(row for row in rows if row.startswith("size"))
    assert re.search(r"  \([0-9.]+ x [0-9.]+ x [0-9.]+\) x 5\.5cm, longest [0-9.]+ mm", size)
    loops = next(row for row in rows if row.startswith("boundary loops"))
    assert re.search(r"\d, in units of 5\.5cm: [0-9.]+", loops)


def test_shares_are_told_in_plain_numbers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Everything under one UV square, over itself and mirrored."""
    folded = {**ARRAYS, "uv": np.abs(ARRAYS["uv"] - 0.5) * (1.0, 0.0) + ARRAYS["uv"] * (0.0, 1.0)}
    np.savez(tmp_path / "folded.npz", **folded)
    assert main(["check", str(tmp_path / "folded.npz")]) == 0
    rows = capsys.readouterr().out.splitlines()
    overlap = next(row for row in rows if row.startswith("UV overlap"))
    assert re.search(r"\b(9\d|100) % of UDIM 1001", overlap)


@pytest.mark.slow
def test_json_and_picture(
    small_mesh: SmallMesh, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh = turned(small_mesh, tmp_path / "sheet.npz")
    picture = tmp_path / "new" / "sheet.png"
    assert main(["check", str(mesh), "--unit", "ft", "--json", "--picture", str(picture)]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["triangles_with"]["flipped"]["count"] == 1
    assert figures["warnings"] == []
    pixels = np.asarray(Image.open(picture)).reshape(-1, 3)
    assert (pixels == (230, 89, 166)).all(axis=1).any()


def test_texels_shrink_with_the_resolution(head: Path, tmp_path: Path) -> None:
    found = []
    for resolution in ("1024", "4096"):
        out = tmp_path / f"{resolution}.json"
        given = ["check", str(head), "--resolution", resolution, "--json", str(out)]
        assert main(given) == 0
        found.append(json.loads(out.read_text())["texels"])
    coarse, fine = found
    for name in ("least", "median", "most"):
        assert coarse[name]["mm"] == pytest.approx(4 * fine[name]["mm"])
        assert coarse[name]["mm"] == pytest.approx(10 * coarse[name]["side"])
        assert coarse[name]["place"] == fine[name]["place"]
    assert fine["least"]["mm"] < fine["median"]["mm"] < fine["most"]["mm"]


@pytest.mark.parametrize(
    ("unit", "named"), [("cm", r"\S+ x \S+ x \S+ cm,"), ("5.5cm", r"\(\S+ x \S+ x \S+\) x 5\.5cm,")]
)
def test_a_size_has_three_sides_in_any_unit(
    head: Path, unit: str, named: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", str(head), "--unit", unit]) == 0
    assert re.search(rf"^size +{named}", capsys.readouterr().out, re.MULTILINE)


def test_frames_are_looked_at(
    head: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    frames = [SAMPLE.pose({"smile": w}) / np.float32(100) for w in (0.5, 1.0)]
    np.save(tmp_path / "shot.npy", np.stack(frames))
    given = ["check", str(head), "--frames", str(tmp_path / "shot.npy")]
    assert main(given) == 0
    told = capsys.readouterr()
    assert told.err.count("frame-scaled") == 2
    assert "frames" in told.out

    assert main([*given, "--strict"]) == 1
    told = capsys.readouterr()
    assert "texel, median" in told.out, "what was found is told all the same"
    assert "--strict: 2 warnings" in told.err
    assert main([*given, "--strict", "--allow", "frame-scaled"]) == 0


def test_shapes_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shapes = np.stack([SAMPLE.pose({"smile": 1.0})] * 2)
    out = tmp_path / "f.json"
    np.savez(tmp_path / "m.npz", **ARRAYS, shapes=shapes, names=np.array(["jawOpen", "odd"]))
    assert main(["check", str(tmp_path / "m.npz"), "--json", str(out)]) == 0
    known = json.loads(out.read_text())["shapes"]
    assert known == {"count": 2, "names": ["jawOpen", "odd"], "regions": {"neck": ["jawOpen"]}}
    told = "GB; regions that the shapes show have more or fewer"
    assert told in capsys.readouterr().out
    np.savez(tmp_path / "m.npz", **ARRAYS, shapes=shapes)
    assert main(["check", str(tmp_path / "m.npz")]) == 0
    assert told not in capsys.readouterr().out


def test_a_pucker_tells_of_the_mouth_around_the_lips(tmp_path: Path) -> None:
    shapes, out = np.stack([SAMPLE.pose({"smile": 1.0})]), tmp_path / "f.json"
    np.savez(tmp_path / "m.npz", **ARRAYS, shapes=shapes, names=np.array(["mouthPucker"]))
    assert main(["check", str(tmp_path / "m.npz"), "--json", str(out)]) == 0
    regions = json.loads(out.read_text())["shapes"]["regions"]
    assert regions == {"lip": ["mouthPucker"], "mouth": ["mouthPucker"]}


@pytest.mark.parametrize("module", ["trimesh", "rhytid_kernels"])
def test_other_commands_leave_modules_alone(module: str) -> None:
    parser = "import sys, rhytid.cli.program as p; p.build_parser()"
    code = f"{parser}; print('{module}' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_a_check_imports_nothing_that_it_does_not_need(tmp_path: Path) -> None:
    mesh = tmp_path / "quad.obj"
    corners = ((0, 0), (1, 0), (1, 1), (0, 1))
    lines = [f"v {x} {y} 0\nvt {x} {y}" for x, y in corners]
    mesh.write_text("\n".join([*lines, "f 1/1 2/2 3/3", "f 1/1 3/3 4/4", ""]))
    code = (
        "import sys; from rhytid.cli import main; main(['check', sys.argv[1]]); "
        "unused = {'scipy', 'rhytid.cli.bake', 'rhytid_lab', 'numpy.ma', 'importlib.metadata', "
        "'OpenEXR', 'PIL', 'statistics', 'tqdm', 'uuid'}; print(*unused & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code, mesh], capture_output=True, text=True)
    assert "texel" in done.stdout
    assert done.stdout.splitlines()[-1] == ""


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--picture", "x.jpg"], "x.jpg: the picture is written as .png"),
        (["--resolution", "1000"], "resolution"),
    ],
)
def test_what_cannot_be_used_is_an_error(
    head: Path, capsys: pytest.CaptureFixture[str], options: list[str], said: str
) -> None:
    assert main(["check", str(head), *options]) == 1
    assert said in capsys.readouterr().err


def test_a_mesh_that_cannot_be_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "bad.obj").write_text("v 0 0 x\n")
    assert main(["check", str(tmp_path / "bad.obj")]) == 1
    assert "bad.obj: " in capsys.readouterr().err


def test_how_much_skin_there_would_be_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """And that a body has too much of it, and texels that are too coarse."""
    file = tmp_path / "body.npz"
    np.savez(file, **{**ARRAYS, "positions": SAMPLE.mesh.positions * np.float32(8)})
    given = ["check", str(file), "--unit", "cm", "--resolution", "4096"]
    assert main([*given, "--json", str(tmp_path / "figures.json")]) == 0
    printed = capsys.readouterr()
    figures = json.loads((tmp_path / "figures.json").read_text())
    build = figures["build"]
    assert set(build) == {"wrinkles", "pores", "seconds", "nbytes"}
    assert f"about {build['wrinkles'] / 1e6:.2g} million wrinkles" in printed.out
    assert [notice["code"] for notice in figures["notices"]] == ["few-texels", "large-build"]
    assert "notice: few-texels: fewer than four texels lie between pores" in printed.err


def test_a_scan_is_measured_on_its_mesh(
    head: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    codes = np.random.default_rng(0).integers(20000, 45000, (64, 64)).astype(np.uint16)
    for udim in mesh_udims(read_mesh(head.read_bytes(), head.name).mesh):
        Image.fromarray(codes).save(tmp_path / f"d.{udim}.png")
    out, scan = tmp_path / "figures.json", ["--scan", str(tmp_path / "d.<UDIM>.png")]
    given = ["check", str(head), *scan, "--scale", "5", "--scan-unit", "cm"]
    assert main([*given, "--json", str(out)]) == 0
    told = json.loads(out.read_text())
    first = told["scan"]["maps"][0]
    assert (first["kind"], first["bits"], first["width"]) == ("16 bits", 16, 64)
    assert "scan-depth" in {warning["code"] for warning in told["warnings"]}
    capsys.readouterr()
    assert main(given) == 0
    printed = capsys.readouterr()
    assert f"scan {first['udim']}, relief" in printed.out
    assert "warning: scan-depth: " in printed.err
    assert main([*given, "--strict"]) == 1
    assert main(given[:4]) == 1
    assert "has codes, which have no length of their own" in capsys.readouterr().err


@pytest.mark.parametrize(
    "option",
    [["--scale", "1"], ["--midlevel", "0"], ["--scan-unit", "mm"], ["--flip", "v"], ["--partial"]],
)
def test_how_a_scan_is_read_needs_a_scan(
    head: Path, capsys: pytest.CaptureFixture[str], option: list[str]
) -> None:
    said = usage_error(capsys, "check", str(head), *option)
    assert f"{option[0]} says how to read displacement: give --scan, too" in said


@pytest.mark.parametrize("module", ["trimesh", "scipy.spatial", "pyopencl"])
def test_a_mesh_is_checked_without_what_takes_long_to_import(module: str, head: Path) -> None:
    call = f"from rhytid.cli import main; main(['check', {str(head)!r}])"
    code = f"import sys; {call}; sys.exit({module!r} in sys.modules)"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, check=False)
    assert found.returncode == 0, found.stderr
