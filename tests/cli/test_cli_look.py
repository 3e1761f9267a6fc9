"""`rhytid look` over folders of maps."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from pxr import Usd

from cli.running import usage_error, write_animation
from meshes import SmallMesh
from rhytid.cli import main
from rhytid.exports.textures.writers import write_parts
from rhytid.formats.exr_encoder import exr_parts
from rhytid.formats.png import encode_png
from rhytid.formats.tile_header import TileHeader


def write_maps(folder: Path, *names: str, unit: str = "cm") -> Path:
    """Small maps of these names."""
    folder.mkdir(exist_ok=True)
    for name in names:
        _, udim, frame, _ = name.split(".")
        header = TileHeader(
            unit, frame, "asset", "redraw", "tensor", "nearest", int(udim), 0, 0, 0, 1.0
        )
        texels = np.full((2, 2), -0.01, np.float32)
        write_parts(folder / name, exr_parts(texels, header.attributes()))
    return folder


def all_maps(folder: Path) -> Path:
    names = [f"face.{udim}.{n:04d}.exr" for udim in (1001, 1002) for n in (8, 9, 10)]
    return write_maps(folder, *names)


def test_a_folder_gets_both_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    maps = all_maps(tmp_path / "maps")

    assert main(["look", str(maps), "--unit", "m", "--bind", "/root/face", "--json"]) == 0

    assert json.loads(capsys.readouterr().out) == {
        "usd": str(maps / "face.look.usda"),
        "materialx": str(maps / "face.mtlx"),
        "udims": [1001, 1002],
        "frames": 3,
        "first": "0008",
        "last": "0010",
        "unit": "cm",
        "scale": 0.01,
    }
    stage = Usd.Stage.Open(str(maps / "face.look.usda"))
    file = stage.GetAttributeAtPath("/Looks/face/rhytidHeights.inputs:file")
    assert file.GetTimeSamples() == [8, 9, 10]
    assert file.Get(9).path == "./face.<UDIM>.0009.exr"
    assert "face.&lt;UDIM&gt;.{04frame}.exr" in (maps / "face.mtlx").read_text()


def test_gaps_between_frames_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = [f"face.1001.{n:04d}.exr" for n in (1, 2, 4, 6)]
    maps = write_maps(tmp_path, *names)

    assert main(["look", str(maps)]) == 0
    assert "no maps of 2 frames in between: 3, 5. There USD" in capsys.readouterr().err
    assert main(["look", str(maps), "--frame", "0001"]) == 0
    assert capsys.readouterr().err == ""


def test_one_frame_is_chosen_by_its_name(tmp_path: Path) -> None:
    maps = write_maps(tmp_path, "face.1001.smile.exr", "face.1001.frown.exr")

    assert main(["look", str(maps)]) == 1
    assert main(["look", str(maps), "--frame", "smile"]) == 0

    text = (maps / "face.look.usda").read_text()
    assert "@./face.1001.smile.exr@" in text
    assert "timeSamples" not in text


def test_other_files_are_left_alone(tmp_path: Path) -> None:
    maps = write_maps(tmp_path, "face.1001.0001.exr")
    for name in ("face.mip.1001.0001.exr", "face.1001.0002.png", "face.0001.exr", "notes.txt"):
        (maps / name).touch()

    assert main(["look", str(maps)]) == 0

    assert "face.1001.0001.exr" in (maps / "face.look.usda").read_text()
    assert len([*maps.glob("*.usda")]) == 1


@pytest.mark.parametrize(
    ("names", "options", "why"),
    [
        ([], [], "has no files named NAME.<UDIM>.<FRAME>.exr, which bake writes"),
        (["a.1001.0001.exr"], ["--name", "b"], "has no files named b.<UDIM>.<FRAME>.exr"),
        (["a.1001.0001.exr", "b.1001.0001.exr"], [], "has maps of a, b: --name chooses"),
        (["a.1001.0001.exr"], ["--frame", "0002"], "has no maps of frame 0002"),
        (["a.1001.1.exr", "a.1002.2.exr"], [], "a.1002.1.exr is missing in"),
        (["a.1001.smile.exr", "a.1001.x.exr"], [], "frame smile has no number"),
        (["a.1101.1.exr"], [], "UDIM 1101: USD reads 1001 to 1100"),
    ],
)
def test_what_is_missing_is_said(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    names: list[str],
    options: list[str],
    why: str,
) -> None:
    maps = write_maps(tmp_path / "maps", *names)

    assert main(["look", str(maps), *options]) == 1

    assert why in capsys.readouterr().err
    assert not [*maps.glob("*.usda"), *maps.glob("*.mtlx")]


def test_a_damaged_map_and_an_unknown_unit_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    maps = write_maps(tmp_path / "maps", "a.1001.1.exr", unit="span")
    assert main(["look", str(maps), "--unit", "cm"]) == 1
    assert "'span' is no known unit of length" in capsys.readouterr().err
    (maps / "a.1001.1.exr").write_bytes(b"no image")
    assert main(["look", str(maps)]) == 1
    assert "a.1001.1.exr: not a readable EXR file" in capsys.readouterr().err
    assert main(["look", str(tmp_path / "none")]) == 1
    assert "no such folder" in capsys.readouterr().err


@pytest.mark.parametrize(
    "options",
    [
        ["--bind", "root/face"],
        ["--bind", "/root/../face"],
        ["--material", "/a b"],
        ["--uv", "a/b"],
        ["--uv", "9"],
        ["--fps", "0"],
        ["--fps", "nan"],
        ["--fps", "10001"],
        ["--unit", "span"],
    ],
)
def test_paths_and_numbers_are_checked(
    tmp_path: Path, options: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert f"argument {options[0]}: " in usage_error(capsys, "look", str(tmp_path), *options)


def test_a_glb_needs_maps_of_one_level(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    maps, mesh = write_maps(tmp_path / "maps", "face.1001.smile.exr"), tmp_path / "sheet.obj"
    mesh.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n")
    command = ["look", str(maps), "--gltf", str(mesh), "--json"]
    assert main(command) == 1
    assert "face.roughness.1001.smile.png is missing" in capsys.readouterr().err

    for name, level in (("roughness", "2"), ("anisotropy", "2"), ("normal-gl", "0")):
        texels = np.zeros((2, 2, 3), np.uint16)
        file = maps / f"face.{name}.1001.smile.png"
        file.write_bytes(encode_png(texels, {"level": level}))
    assert main(command) == 1
    assert "maps of one level are needed" in capsys.readouterr().err

    file.write_bytes(encode_png(texels, {"level": "2"}))
    assert main(command) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["gltf"] == str(maps / "face.smile.glb")
    read = trimesh.load(figures["gltf"], process=False).to_geometry()
    assert read.visual.material.name == "skin.1001"

    for damaged in (b"{", b"\xff", b"3", b"[1]"):
        (maps / "face.roughness.json").write_bytes(damaged)
        assert main(command) == 1
        assert "face.roughness.json is damaged: bake again" in capsys.readouterr().err


@pytest.mark.parametrize("others", ["fewer", "joined", "ordered", "unknown"])
def test_a_glb_of_another_mesh_is_refused(
    tmp_path: Path, small_mesh: SmallMesh, others: str, capsys: pytest.CaptureFixture[str]
) -> None:
    shot, out = write_animation(tmp_path / "shot.npz", small_mesh, 1), tmp_path / "maps"
    profiles = ["float", "roughness", "anisotropy", "normal-gl", "--level", "1"]
    small = ["--resolution", "256", "--wrinkles", "400", "--store", str(tmp_path / "store")]
    bake = ["bake", "--mesh", str(shot), "--out", str(out), *small, "--profile", *profiles]
    assert main(bake) == 0
    capsys.readouterr()
    assert main(["look", str(out), "--gltf", str(shot)]) == 0
    capsys.readouterr()
    glb, facts = out / "shot.0001.glb", out / "shot.roughness.json"
    glb.unlink()

    with np.load(shot) as arrays:
        found = dict(arrays)
    count, triangles = len(found["positions"]), len(found["faces"])
    if others == "unknown":
        old = {name: value for name, value in json.loads(facts.read_text()).items()
               if name not in ("vertices", "triangles", "faces_sha256")}  # fmt: skip
        facts.write_text(json.dumps(old))
    found.pop("frames")
    if others == "joined":
        swapped = np.arange(count)
        swapped[:2] = 1, 0
        found["faces"] = swapped[found["faces"]]
    elif others == "ordered":
        found["faces"] = np.roll(found["faces"][::-1], 1, axis=1)
        found["face_uv"] = np.roll(found["face_uv"][::-1], 1, axis=1)
    else:
        found["faces"], found["face_uv"] = found["faces"][:-1], found["face_uv"][:-1]
    np.savez(tmp_path / "other.npz", **found)
    ended = main(["look", str(out), "--gltf", str(tmp_path / "other.npz")])
    told = capsys.readouterr().err
    assert (ended, glb.exists()) == ((0, True) if others in ("ordered", "unknown") else (1, False))
    if others == "fewer":
        assert f"other.npz has {count} vertices and {triangles - 1} triangles, the mesh of" in told
        assert f"{facts} has {count} vertices and {triangles} triangles: give a frame" in told
    if others == "joined":
        assert f"other.npz has {count} vertices and {triangles} triangles, as the mesh of" in told
