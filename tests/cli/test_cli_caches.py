"""Commands on geometry caches: which frames there are, their numbers, units and errors."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pxr", reason="usd-core has no wheel for this platform")

import handmade
from cli.running import write_animation, write_neutral
from face_data import Face
from formats.usd_files import add_mesh, new_stage, write_usd
from meshes import SmallMesh, deform
from rhytid.baking.frames import FrameFiles
from rhytid.baking.input_files import mesh_file, shape_files
from rhytid.cli import main
from rhytid.domain.mesh import Mesh
from rhytid.errors import FrameError
from rhytid.formats.exr import read_exr
from rhytid.formats.frame_set import Clip
from rhytid.formats.meshes import MeshFile
from rhytid_lab.commands.demo_face import animation

SMALL = ("--resolution", "256", "--wrinkles", "400")


def usd_mesh(mesh: SmallMesh) -> dict[str, Any]:
    return {
        "points": mesh.positions,
        "counts": np.full(len(mesh.faces), 3),
        "corners": mesh.faces.ravel(),
        "uv": mesh.uv,
        "uv_indices": mesh.face_uv.ravel(),
    }


def pc2(file: Path, frames: Any, start: float) -> Path:
    head = struct.pack("<12siiffi", b"POINTCACHE2\0", 1, frames.shape[1], start, 1.0, len(frames))
    file.write_bytes(head + frames.astype("<f4").tobytes())
    return file


@pytest.fixture
def neutral(small_mesh: SmallMesh) -> MeshFile:
    return MeshFile(Mesh(*small_mesh))


@pytest.fixture
def poses(small_mesh: SmallMesh) -> Any:
    """As `write_animation` has them."""
    return np.stack([deform(small_mesh.positions, seed, 0.05) for seed in range(3)])


def labels(frames: FrameFiles) -> list[str]:
    return [place.label for place in frames.places]


def test_caches_keep_their_numbers(tmp_path: Path, neutral: MeshFile, poses: Any) -> None:
    files = [pc2(tmp_path / "b.pc2", poses[1:], 240), pc2(tmp_path / "a.pc2", poses[:1], 101)]

    frames = FrameFiles(neutral, files)

    assert labels(frames) == ["0240", "0241", "0101"]
    read = [frames.read(place) for place in frames.places]
    np.testing.assert_array_equal(read, poses[[1, 2, 0]])


def test_a_number_in_two_caches_is_refused(tmp_path: Path, neutral: MeshFile, poses: Any) -> None:
    files = [pc2(tmp_path / "a.pc2", poses, 1), pc2(tmp_path / "b.pc2", poses, 3)]

    with pytest.raises(FrameError, match=r"a\.pc2 and .*b\.pc2 both hold frame 3"):
        FrameFiles(neutral, files)


def test_stages_without_samples_are_numbered_by_their_names(
    tmp_path: Path, small_mesh: SmallMesh, neutral: MeshFile, poses: Any
) -> None:
    files = [
        write_usd(tmp_path / f"shot.{number}.usdc", **usd_mesh(small_mesh._replace(positions=pose)))
        for number, pose in zip((12, 13), poses, strict=False)
    ]

    frames = FrameFiles(neutral, files)

    assert labels(frames) == ["0012", "0013"]
    np.testing.assert_array_equal(frames.read(frames.places[1]), poses[1])


def test_what_is_wrong_is_told_with_file_prim_and_frame(
    tmp_path: Path, small_mesh: SmallMesh, neutral: MeshFile, poses: Any
) -> None:
    poses[1, 7] = np.nan
    samples = dict(zip((1, 2, 3), poses, strict=True))
    file = write_usd(tmp_path / "shot.usdc", samples=samples, **usd_mesh(small_mesh))
    told = r"shot\.usdc: /root/face, frame 2: frame vertex 7 is \[nan"
    own = FrameFiles(mesh_file(file), [])
    for frames in (own, FrameFiles(neutral, [file])):
        np.testing.assert_array_equal(frames.read(frames.places[0]), poses[0])
        with pytest.raises(FrameError, match=told):
            frames.read(frames.places[1])
    with pytest.raises(FrameError, match=told):
        shape_files(file, neutral)


def test_shapes_come_from_caches(tmp_path: Path, neutral: MeshFile, poses: Any) -> None:
    shapes = shape_files(pc2(tmp_path / "a.pc2", poses, 1), neutral)

    assert shapes is not None
    np.testing.assert_array_equal(shapes.positions, poses)


def test_the_demo_takes_one_mesh_of_a_stage(
    tmp_path: Path, small_mesh: SmallMesh, poses: Any
) -> None:
    stage = new_stage(tmp_path / "shot.usda", 0.001)
    add_mesh(stage, "/eye")
    add_mesh(stage, "/face", samples={7: poses[0], 8: poses[2]}, **usd_mesh(small_mesh))
    stage.GetRootLayer().Save()

    found = animation(tmp_path / "shot.usda", [], None, Clip("face"))

    assert (labels(found.frames), found.unit) == (["0007", "0008"], "mm")
    np.testing.assert_array_equal(found.frames.read(found.frames.places[1]), poses[2])
    assert found.expressions is not None


def test_the_maps_of_a_stage_are_those_of_the_same_npz(
    tmp_path: Path, small_mesh: SmallMesh, poses: Any
) -> None:
    archive = write_animation(tmp_path / "face.npz", small_mesh, 3)
    samples = dict(zip((1001, 1002, 1003), poses, strict=True))
    stage = write_usd(tmp_path / "face.usdc", 0.001, samples=samples, **usd_mesh(small_mesh))
    for mesh, unit in ((archive, ("--unit", "mm")), (stage, ())):
        given = ["bake", "--mesh", str(mesh), "--out", str(tmp_path / mesh.suffix), *SMALL, *unit]
        assert main(given) == 0

    for i in (1, 2, 3):
        ours, told = read_exr(tmp_path / ".usdc" / f"face.1001.{1000 + i}.exr")
        theirs, wanted = read_exr(tmp_path / ".npz" / f"face.1001.{i:04d}.exr")
        np.testing.assert_array_equal(ours, theirs)
        assert told["unit"] == wanted["unit"] == "mm"
        assert np.abs(ours).max() > 0.0


def test_a_unit_that_is_given_is_taken(
    tmp_path: Path, small_mesh: SmallMesh, capsys: pytest.CaptureFixture[str]
) -> None:
    stage = write_usd(tmp_path / "face.usdc", 1.0, "Z", **usd_mesh(small_mesh))
    units = []
    for more in ((), ("--unit", "in")):
        assert main(["check", str(stage), *more, "--json"]) == 0
        out, err = capsys.readouterr()
        units.append(json.loads(out)["unit"])
        assert "notice: upAxis is Z and is kept" in err

    assert units == ["m", "in"]


def test_check_reads_the_frames_of_a_stage(
    tmp_path: Path, small_mesh: SmallMesh, poses: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    still = write_usd(tmp_path / "still.usdc", **usd_mesh(small_mesh))
    moving = write_usd(
        tmp_path / "moving.usdc", samples=dict(enumerate(poses)), **usd_mesh(small_mesh)
    )
    for file, count in ((still, 0), (moving, 3)):
        assert main(["check", str(file), "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["frames"] == count


def test_several_meshes_are_named_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stage = new_stage(tmp_path / "shot.usda")
    for path in ("/eye", "/face"):
        add_mesh(stage, path)
    stage.GetRootLayer().Save()

    assert main(["check", str(tmp_path / "shot.usda")]) == 1
    told = "shot.usda: the stage has 2 meshes, one must be chosen: /eye (5 points), /face"
    assert told in capsys.readouterr().err
    assert main(["check", str(tmp_path / "shot.usda"), "--prim", "/face"]) == 0


def test_a_skin_grown_on_a_stage_is_that_of_the_same_npz(
    tmp_path: Path, small_mesh: SmallMesh, poses: Any
) -> None:
    archive = write_neutral(tmp_path / "face.npz", small_mesh)
    stage = write_usd(tmp_path / "face.usdc", 0.001, **usd_mesh(small_mesh))
    shot = pc2(tmp_path / "shot.pc2", poses, 1)
    np.save(tmp_path / "shot.npy", poses)
    grown = []
    for mesh, shapes, more in (
        (archive, tmp_path / "shot.npy", ("--unit", "mm")),
        (stage, shot, ()),
    ):
        out = tmp_path / f"{mesh.suffix}.safetensors"
        given = ["synthesize", str(mesh), "--shapes", str(shapes), "--wrinkles", "400"]
        assert main([*given, "--out", str(out), *more]) == 0
        grown.append(out.read_bytes())

    assert grown[0] == grown[1]


@pytest.mark.slow
@pytest.mark.release
@pytest.mark.face
def test_the_real_face_as_a_stage_has_the_maps_of_its_npz(tmp_path: Path, face: Face) -> None:
    names = list(face.composites)[:3]
    poses = np.stack([face.composite(name) for name in names])
    mesh = SmallMesh(face.positions, face.faces, face.uv, face.face_uv)
    np.savez(tmp_path / "face.npz", **mesh._asdict(), frames=poses)
    samples = dict(zip(range(101, 104), poses, strict=True))
    write_usd(tmp_path / "face.usdc", 0.01, samples=samples, **usd_mesh(mesh))
    for suffix in (".npz", ".usdc"):
        given = ["bake", "--mesh", str(tmp_path / f"face{suffix}"), "--resolution", "512"]
        assert main([*given, "--out", str(tmp_path / suffix)]) == 0

    for number in range(1, 4):
        ours = read_exr(tmp_path / ".usdc" / f"face.1001.{100 + number:04d}.exr")[0]
        theirs = read_exr(tmp_path / ".npz" / f"face.1001.{number:04d}.exr")[0]
        np.testing.assert_array_equal(ours, theirs)
        assert np.abs(ours).max() > 0.0


def test_a_template_has_the_unit_of_its_stage(
    tmp_path: Path, small_mesh: SmallMesh, capsys: pytest.CaptureFixture[str]
) -> None:
    """metersPerUnit 1 makes texels a hundred times as large as in centimetres."""
    sizes = []
    for metres in (0.01, 1.0):
        file = tmp_path / f"{metres}.usda"
        write_usd(file, metres, **usd_mesh(small_mesh))
        options = ["--out", str(tmp_path / f"p{metres}"), "--size", "16", "-q", "--json"]
        assert main(["template", str(file), *options]) == 0
        sizes.append(json.loads(capsys.readouterr().out)["texel_mm"])
    assert sizes[1] == pytest.approx(100 * sizes[0])


def stage_of_two(file: Path, mesh: SmallMesh, name: str) -> str:
    """A stage with the mesh at a path, and an eye beside it."""
    stage = new_stage(file)
    add_mesh(stage, "/eye")
    add_mesh(stage, name, **usd_mesh(mesh))
    stage.GetRootLayer().Save()
    return str(file)


def test_one_mesh_of_a_stage_is_chosen(
    tmp_path: Path, small_mesh: SmallMesh, capsys: pytest.CaptureFixture[str]
) -> None:
    old = stage_of_two(tmp_path / "old.usda", small_mesh, "/face")
    new = stage_of_two(tmp_path / "new.usda", small_mesh, "/film")
    skin, out = str(handmade.write(tmp_path / "g.safetensors")), tmp_path / "out.safetensors"
    commands = (
        ["template", old, "--out", str(tmp_path / "paint"), "--size", "16", "--json"],
        ["graph", old, skin, "--json"],
        ["transfer", skin, old, old, "--out", str(out), "--json"],
    )
    for command in commands:
        assert main([*command, "-q"]) == 1
        assert "has 2 meshes, one must be chosen: /eye" in capsys.readouterr().err
        assert main([*command, "-q", "--prim", "/face"]) == 0
        told = json.loads(capsys.readouterr().out)
    assert told["pores"] == 8

    carried = ["transfer", skin, old, new, "--out", str(out), "--prim", "/face"]
    assert main(carried) == 1
    assert "new.usda: no mesh '/face' on the stage" in capsys.readouterr().err
    assert main([*carried, "--to-prim", "/film"]) == 0
