"""`rhytid displace`: a mesh moved by maps that there are."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from cli.running import usage_error, write_animation, write_neutral
from exr_images import exr
from meshes import SmallMesh
from rhytid.cli import main
from rhytid.formats.meshes import read_mesh

pytestmark = pytest.mark.usefixtures("decoded_here")

FLAT = 32768


def displace(*arguments: object) -> int:
    return main(["displace", *map(str, arguments)])


def write_png(file: Path, codes: np.ndarray) -> Path:
    Image.fromarray(codes).save(file)
    return file


def positions(file: Path) -> np.ndarray:
    return read_mesh(file.read_bytes(), file.name).mesh.positions


@pytest.mark.parametrize("format", ["glb", "ply"])
def test_a_baked_map_gives_the_surface_that_bake_writes(
    tmp_path: Path, small_mesh: SmallMesh, format: str
) -> None:
    """Bit for bit."""
    shot, out = write_animation(tmp_path / "shot.npz", small_mesh, 1), tmp_path / "maps"
    given = ["bake", str(shot), "--out", str(out), "--resolution", "256", "--wrinkles", "400"]
    assert main([*given, "--geometry", format, "--subdivide", "1", "--method", "neutral"]) == 0
    with np.load(shot) as arrays:
        moved = SmallMesh(arrays["frames"][0], *small_mesh[1:])
    mesh, mine = write_neutral(tmp_path / "frame.npz", moved), tmp_path / f"mine.{format}"
    map = out / "shot.1001.0001.exr"
    assert displace(mesh, map, "--subdivide", 1, "--out", mine) == 0
    assert mine.read_bytes() == (out / f"shot.0001.{format}").read_bytes()


def test_scale_midlevel_and_units(tmp_path: Path) -> None:
    """A flat sheet of 10 cm rises by what a code stands for."""
    mesh, map = sheet(tmp_path / "sheet.npz"), tmp_path / "map.png"
    write_png(map, np.full((16, 32), 65535, np.uint16))
    out = tmp_path / "out.glb"
    for options, height in (
        (["--scale", "2"], 1.0),
        (["--scale", "2", "--midlevel", "0"], 2.0),
        (["--scale", "-2", "--midlevel", "0.25"], -1.5),
        (["--scale", "2", "--scan-unit", "mm", "--unit", "cm"], 0.1),
        (["--scale", "1", "--scan-unit", "mm", "--unit", "2mm", "--midlevel", "0"], 0.5),
    ):
        assert displace(mesh, map, *options, "--out", out) == 0
        assert positions(out)[:, 2] == pytest.approx(height, rel=1e-6), options


def test_the_midlevel_is_found_outside_of_the_charts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh, map, out = sheet(tmp_path / "sheet.npz"), tmp_path / "map.png", tmp_path / "out.glb"
    codes = np.full((64, 64), 30000, np.uint16)
    codes[8:-8, 8:-8] += np.arange(48, dtype=np.uint16)[:, None] * 10 - 240
    write_png(map, codes)
    given = (mesh, map, "--scale", 65535, "--midlevel", "auto", "--subdivide", "4")
    assert displace(*given, "--out", out) == 0
    assert -250 < positions(out)[:, 2].min() < -180
    assert 180 < positions(out)[:, 2].max() < 250

    codes[:6], codes[-6:], codes[:, :6], codes[:, -6:] = 0, 0, 0, 0
    write_png(map, codes)
    assert displace(*given, "--out", out) == 1
    assert "outside of the charts it is 0, beyond the values inside" in capsys.readouterr().err


def test_edges_are_cut_until_they_are_short_enough(tmp_path: Path) -> None:
    mesh, map = sheet(tmp_path / "sheet.npz"), tmp_path / "map.exr"
    map.write_bytes(exr(np.zeros((16, 16), np.float32)))
    told = tmp_path / "told.json"
    for edge, levels in (("100", 0), ("7.08", 1), ("5.1", 2), ("1.0", 4)):
        out = tmp_path / "out.ply"
        assert displace(mesh, map, "--edge", edge, "--out", out, "--json", told) == 0
        figures = json.loads(told.read_text())
        assert (figures["levels"], figures["triangles"]) == (levels, 2 * 4**levels)


def test_maps_of_several_udims(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mesh, out = two_squares(tmp_path / "two.npz"), tmp_path / "out.glb"
    first, second = (tmp_path / f"d.{udim}.exr" for udim in (1001, 1002))
    first.write_bytes(exr(np.full((16, 16), 1.0, np.float32)))
    every = tmp_path / "d.<UDIM>.exr"
    assert displace(mesh, every, "--out", out) == 1
    assert "no map of UDIM 1002, which the mesh has; --partial allows it" in capsys.readouterr().err
    assert displace(mesh, every, "--partial", "--out", out) == 0
    assert positions(out)[:, 2] == pytest.approx(np.where(positions(out)[:, 0] < 1.5, 1.0, 0.0))
    second.write_bytes(exr(np.full((32, 64), 2.0, np.float32)))
    for maps in ([every], [first, second]):
        assert displace(mesh, *maps, "--out", out) == 0
        assert positions(out)[:, 2] == pytest.approx(np.where(positions(out)[:, 0] < 1.5, 1.0, 2.0))
    assert displace(mesh, tmp_path / "other.<UDIM>.exr", "--out", out) == 1
    assert "there is no such file for any UDIM" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ([], "has codes, which have no length of their own: --scale, the length"),
        (["--scale", "0"], "--scale is 0: that is no relief"),
        (["--scale", "nan"], "--scale is nan: must be finite"),
        (["--scale", "1", "2"], "--scale has 2 numbers"),
        (["--scale", "1", "2", "3"], "has one channel, --scale has 3 numbers"),
        (["--scale", "1", "--midlevel", "2"], "--midlevel is 2: of codes it is from 0"),
        (["--scale", "1", "--edge", "0"], "an edge of 0: must be a length"),
        (["--scale", "1", "--unit", "furlong"], None),
        (["--scale", "1", "--midlevel", "grey"], None),
    ],
)
def test_what_cannot_be_meant_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], said: str | None
) -> None:
    mesh, out = sheet(tmp_path / "sheet.npz"), tmp_path / "out.glb"
    map = write_png(tmp_path / "map.png", np.full((16, 16), FLAT, np.uint16))
    given = ["displace", str(mesh), str(map), *options, "--out", str(out)]
    if said is None:
        assert options[-1] in usage_error(capsys, *given)
    else:
        assert main(given) == 1
        assert said in capsys.readouterr().err
    assert not out.exists()


def test_a_mesh_without_maps_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mesh = sheet(tmp_path / "sheet.npz")
    said = usage_error(capsys, "displace", str(mesh), "--scale", "1", "--out", "out.glb")
    assert "give a mesh and, after it, its maps: there is" in said
    assert "sheet.npz alone" in said


@pytest.mark.parametrize("text", ["3mm", "4,1,0.3", "map.png"])
def test_a_scale_that_is_no_number_is_told_what_stands_elsewhere(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str
) -> None:
    mesh = sheet(tmp_path / "sheet.npz")
    said = usage_error(capsys, "displace", str(mesh), str(mesh), "--scale", text)
    assert f"argument --scale: '{text}': a number, or three with spaces" in said
    assert "--scan-unit says of which unit, and files of maps stand before this option" in said


def test_a_surface_is_glb_or_ply(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mesh = sheet(tmp_path / "sheet.npz")
    map = write_png(tmp_path / "map.png", np.full((16, 16), FLAT, np.uint16))
    assert displace(mesh, map, "--scale", "1", "--out", tmp_path / "out.obj") == 1
    assert "out.obj: the surface is written as .glb or .ply" in capsys.readouterr().err


def sheet(file: Path) -> Path:
    """10 by 10, in the middle of its UDIM."""
    uv = np.array([[0.1, 0.1], [0.9, 0.1], [0.9, 0.9], [0.1, 0.9]])
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    points = np.pad((uv - 0.1) * 12.5, ((0, 0), (0, 1))).astype(np.float32)
    np.savez(file, positions=points, faces=faces, uv=uv, face_uv=faces)
    return file


def two_squares(file: Path) -> Path:
    """Side by side, a UDIM each."""
    square = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    uv = np.concatenate([square, square + np.array([1, 0])])
    points = np.pad(uv + np.repeat([[0, 0], [1, 0]], 4, axis=0), ((0, 0), (0, 1)))
    faces = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]], np.int32)
    np.savez(file, positions=points.astype(np.float32), faces=faces, uv=uv, face_uv=faces)
    return file
