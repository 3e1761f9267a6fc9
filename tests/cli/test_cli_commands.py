"""Commands from end to end, on the device."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from cli.running import write_animation, write_neutral
from exr_images import exr
from meshes import SmallMesh
from rhytid.cli import main
from rhytid.formats.exr import read_exr
from rhytid.formats.graphs import read_graph

SMALL = ("--resolution", "256", "--wrinkles", "400")


def test_devices_lists_one_that_is_used(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["devices", "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)
    assert [device["used"] for device in listed].count(True) == 1
    assert [device["number"] for device in listed] == list(range(len(listed)))

    assert main(["devices"]) == 0
    assert all(device["name"] in capsys.readouterr().out for device in listed[:1])


@pytest.mark.parametrize("command", ["devices", "serve"])
def test_a_device_that_is_not_there_is_an_error(
    command: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("RHYTID_DEVICE", "no such device")
    arguments = [command, *(["--port", "0"] if command == "serve" else [])]

    assert main(arguments) == 1
    told = capsys.readouterr()
    assert "no OpenCL device matches 'no such device'" in told.err
    assert told.out == ""


def test_synthesize_writes_the_same_graph_each_time(
    tmp_path: Path, small_mesh: SmallMesh, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh = str(write_neutral(tmp_path / "mesh.npz", small_mesh))
    outs = [tmp_path / "new" / f"{name}.safetensors" for name in "ab"]

    for out in outs:
        given = ["synthesize", mesh, "--out", str(out), "--wrinkles", "300", "--seed", "5"]
        assert main([*given, "--json"]) == 0

    figures = json.loads(capsys.readouterr().out.partition("\n}\n")[0] + "}")
    assert figures["wrinkles"] == 300
    assert outs[0].read_bytes() == outs[1].read_bytes()
    assert read_graph(outs[0].read_bytes()).counts()[1] == 300
    assert sorted(file.name for file in outs[0].parent.iterdir()) == [out.name for out in outs]


def test_synthesize_leaves_nothing_after_an_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "bad.obj").write_text("v 0 0 x\n")

    out = tmp_path / "out" / "g.safetensors"
    assert main(["synthesize", str(tmp_path / "bad.obj"), "--out", str(out)]) == 1
    assert "bad.obj: " in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.slow
def test_a_unit_of_a_number_and_a_name_goes_through_to_the_files(
    tmp_path: Path, small_mesh: SmallMesh
) -> None:
    mesh = str(write_animation(tmp_path / "mesh.npz", small_mesh, 1))
    (tmp_path / "s.json").write_text('{"unit": "30cm"}')
    size = ["--resolution", "256", "--spacing", "0.05"]
    for name, unit in (("a", ["--unit", "30cm"]), ("b", ["--settings", str(tmp_path / "s.json")])):
        assert main(["bake", mesh, "--out", str(tmp_path / name), *size, *unit]) == 0
    first, second = (tmp_path / name / "mesh.1001.0001.exr" for name in "ab")
    assert read_exr(first)[1]["unit"] == "30cm"
    assert first.read_bytes() == second.read_bytes()
    assert main(["look", str(tmp_path / "a"), "--unit", "m"]) == 0
    assert "= 0.3\n" in (tmp_path / "a" / "mesh.look.usda").read_text()


@pytest.mark.slow
def test_bake_goes_on_with_the_same_inputs_alone(
    tmp_path: Path, small_mesh: SmallMesh, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh = str(write_animation(tmp_path / "shot.npz", small_mesh, 2))
    out = tmp_path / "maps"
    given = ["bake", "--mesh", mesh, "--out", str(out), *SMALL, "--json"]

    def counts(*more: str, lines: str = "level") -> tuple[int, int]:
        assert main([*given, *more, "--lines", lines]) == 0
        figures = json.loads(capsys.readouterr().out)
        return figures["written"], figures["skipped"]

    assert counts() == (2, 0)
    first = (out / "shot.1001.0002.exr").read_bytes()
    assert counts() == (0, 2)
    (out / "shot.1001.0002.exr").write_bytes(first[:100])
    assert counts() == (1, 1)
    assert (out / "shot.1001.0002.exr").read_bytes() == first
    write_animation(tmp_path / "shot.npz", small_mesh, 3)
    assert counts() == (1, 2)
    # Lines grow by the frames of the mesh file: with other frames it is other skin.
    assert counts(lines="auto") == (3, 0)
    write_animation(tmp_path / "shot.npz", small_mesh, 4)
    assert counts(lines="auto") == (4, 0)
    write_animation(tmp_path / "shot.npz", small_mesh, 3)
    assert counts("--method", "binned") == (3, 0)
    texels, header = read_exr(out / "shot.1001.0001.exr")
    assert texels.shape == (256, 256)
    assert np.isfinite(texels).all()
    assert texels.min() < 0
    assert header["method"] == "binned"


@pytest.mark.slow
def test_bake_takes_a_stretch_model_a_sampling_and_a_merge(
    tmp_path: Path, small_mesh: SmallMesh, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh = str(write_animation(tmp_path / "shot.npz", small_mesh, 1))
    merge = tmp_path / "mellow.json"
    merge.write_text('{"bins": {"merge": "mellow", "depth_factored": true}}')
    out = tmp_path / "maps"
    given = ["bake", "--mesh", mesh, "--out", str(out), *SMALL]
    maps = []
    rows = [[], ["--method", "convolved", "--sampling", "smooth"], ["--method", "binned"]]

    for method in (*rows, ["--method", "binned", "--settings", str(merge)]):
        for model in ("tensor", "tension", "uv"):
            assert main([*given, *method, "--stretch", model]) == 0
            assert "1 map written to" in capsys.readouterr().out
            texels, header = read_exr(out / "shot.1001.0001.exr")
            assert header["stretch"] == model
            assert header["sampling"] == ("smooth" if "smooth" in method else "nearest")
            maps.append(texels)

    assert all(np.isfinite(texels).all() for texels in maps)
    assert len({texels.tobytes() for texels in maps}) == 12


def test_bake_takes_a_graph_and_numbered_frames(
    tmp_path: Path, small_mesh: SmallMesh, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh = str(write_neutral(tmp_path / "mesh.npz", small_mesh))
    graph = str(tmp_path / "g.safetensors")
    assert main(["synthesize", mesh, "--out", graph, "--wrinkles", "300"]) == 0
    frames = [tmp_path / f"f_{number:04d}.npy" for number in (7, 12)]
    for frame in frames:
        np.save(frame, small_mesh.positions)

    given = ["bake", "--mesh", mesh, "--graph", graph, "--resolution", "256", "--half"]
    files = ["--frames", *map(str, frames), "--name", "n", "--out", str(tmp_path / "maps")]
    assert main([*given, *files, "--store", str(tmp_path / "store")]) == 0

    names = sorted(file.name for file in (tmp_path / "maps").glob("*.exr"))
    assert names == ["n.1001.0007.exr", "n.1001.0012.exr"]
    assert read_exr(tmp_path / "maps" / names[0])[0].dtype == np.float16
    assert (tmp_path / "store").is_dir()
    assert "2 maps written" in capsys.readouterr().out


def test_bake_needs_a_usable_name(
    tmp_path: Path, small_mesh: SmallMesh, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh = str(write_animation(tmp_path / "(.).npz", small_mesh, 1))

    assert main(["bake", "--mesh", mesh, "--out", str(tmp_path / "maps")]) == 1
    assert "--name gives another" in capsys.readouterr().err


@pytest.mark.parametrize(("stem", "name"), [("my head.v2", "my_head_v2"), ("head_", "head_")])
def test_bake_names_maps_after_a_mesh_whatever_its_name_has(
    stem: str,
    name: str,
    tmp_path: Path,
    small_mesh: SmallMesh,
    capsys: pytest.CaptureFixture[str],
) -> None:
    mesh = str(write_animation(tmp_path / f"{stem}.npz", small_mesh, 1))

    given = ["bake", "--mesh", mesh, "--wrinkles", "100", "--resolution", "256"]
    assert main([*given, "--out", str(tmp_path / "maps")]) == 0
    noticed = "notice: maps are called my_head_v2" in capsys.readouterr().err
    assert noticed == (name != stem)
    assert (tmp_path / "maps" / f"{name}.1001.0001.exr").is_file()


@pytest.mark.slow
def test_bake_takes_stiffness_maps(
    tmp_path: Path, small_mesh: SmallMesh, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh = str(write_animation(tmp_path / "shot.npz", small_mesh, 2))
    for grey in (0, 255):
        Image.new("L", (4, 4), grey).save(tmp_path / f"grey{grey}.1001.png")

    def baked(out: str, *more: str) -> bytes:
        given = ["bake", "--mesh", mesh, "--out", str(tmp_path / out), *SMALL, *more]
        assert main(given) == 0
        texels, _ = read_exr(tmp_path / out / "shot.1001.0002.exr")
        return texels.tobytes()

    plain = baked("plain")
    assert baked("white", "--stiffness", str(tmp_path / "grey255.1001.png")) == plain
    rigid = baked("black", "--stiffness", str(tmp_path / "grey0.1001.png"))
    (tmp_path / "zero.1001.exr").write_bytes(exr(np.zeros((4, 4), np.float16)))
    assert baked("zero", "--stiffness", str(tmp_path / "zero.1001.exr")) == rigid
    assert rigid == baked("neutral", "--method", "neutral") != plain

    capsys.readouterr()
    (tmp_path / "a.1003.png").write_bytes(b"")
    given = ["bake", "--mesh", mesh, "--out", str(tmp_path / "x"), *SMALL]
    assert main([*given, "--stiffness", str(tmp_path / "a.1003.png")]) == 1
    assert "a.1003.png is of UDIM 1003, which has no mesh" in capsys.readouterr().err
