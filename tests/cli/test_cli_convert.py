"""`rhytid convert`: what a server gets is what commands read."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from meshes import SmallMesh
from rhytid.baking.input_files import mesh_file
from rhytid.cli import main
from rhytid.errors import MeshError
from rhytid.formats.meshes import read_mesh


def test_a_mesh_and_its_frames_are_the_same(
    tmp_path: Path, small_mesh: SmallMesh, capsys: pytest.CaptureFixture[str]
) -> None:
    """Doubles that stand far away, shapes with names, and frames with numbers of their own."""
    away = small_mesh.positions.astype(np.float64) + 1e4 + 1e-7 * np.arange(3)
    mesh, arrays = tmp_path / "face.npz", {**small_mesh._asdict(), "positions": away}
    shapes = np.stack([away * 1.01, away * 1.02])
    np.savez(mesh, **arrays, shapes=shapes, names=["smile", "frown"])
    frames = []
    for number in (7, 9):
        frames.append(tmp_path / f"shot.{number}.npy")
        np.save(frames[-1], away + number / 10)
    out = tmp_path / "new" / "face.npz"
    given = ["convert", str(mesh), "--frames", *map(str, frames), "--out", str(out), "--json"]

    assert main(given) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["frames"], told["shapes"], told["unit"]) == (["0007", "0009"], 2, None)
    sent, read = read_mesh(out.read_bytes(), out.name), mesh_file(mesh)
    for name in ("positions", "faces", "uv", "face_uv", "centre"):
        np.testing.assert_array_equal(getattr(sent.mesh, name), getattr(read.mesh, name))
    assert sent.mesh.centre.any()
    assert sent.shapes is not None
    assert read.shapes is not None
    assert sent.shapes.digest() == read.shapes.digest()
    assert sent.frames is not None
    wanted = [np.float32(away + n / 10 - read.mesh.centre) for n in (7, 9)]
    np.testing.assert_array_equal(sent.frames, wanted)
    first = out.read_bytes()
    assert main(given) == 0
    assert out.read_bytes() == first


def test_frame_numbers_and_units_are_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("pxr", reason="usd-core has no wheel for this platform")
    from formats.usd_files import POINTS, add_mesh, new_stage

    file, out = tmp_path / "shot.usda", tmp_path / "shot.npz"
    values = [POINTS, POINTS * np.float32(1.5)]
    stage = new_stage(file, 0.01)
    stage.SetStartTimeCode(1001)
    stage.SetEndTimeCode(1002)
    add_mesh(stage, "/face", samples=dict(zip((1001, 1002), values, strict=True)))
    stage.Save()

    assert main(["convert", str(file), "--out", str(out)]) == 0
    assert capsys.readouterr().out.splitlines() == [
        f"{out}: 2 frames",
        "A server counts them from 0001: frame 1001 is 0001 there.",
        'The unit is cm: send it with the settings {"unit": "cm"}.',
    ]
    sent = read_mesh(out.read_bytes(), out.name)
    np.testing.assert_array_equal(sent.frames, values)


def test_usd_is_refused_with_the_way(tmp_path: Path) -> None:
    with pytest.raises(MeshError, match=r"`rhytid convert` makes \.npz of USD"):
        read_mesh(b"PXR-USDC", "face.usdc")
    with pytest.raises(MeshError) as other:
        read_mesh(b"", "face.fbx")
    assert "convert" not in str(other.value)


def test_what_is_written_is_npz(
    tmp_path: Path, small_mesh: SmallMesh, capsys: pytest.CaptureFixture[str]
) -> None:
    np.savez(tmp_path / "a.npz", **small_mesh._asdict())
    assert main(["convert", str(tmp_path / "a.npz"), "--out", str(tmp_path / "b.obj")]) == 1
    assert "is written as .npz" in capsys.readouterr().err
    assert main(["convert", str(tmp_path / "a.npz"), "--out", str(tmp_path / "b.npz")]) == 0
    assert read_mesh((tmp_path / "b.npz").read_bytes(), "b.npz").frames is None


def test_arrays_that_nothing_reads_are_told(
    tmp_path: Path, small_mesh: SmallMesh, capsys: pytest.CaptureFixture[str]
) -> None:
    np.savez(tmp_path / "head.npz", **small_mesh._asdict(), shpaes=np.zeros(3), hair=np.zeros(3))
    given = [str(tmp_path / "head.npz"), "--out", str(tmp_path / "out.npz")]
    assert main(["convert", *given]) == 0
    told = "warning: arrays-unused: the mesh file: not read: 'shpaes' (did you mean shapes?); "
    printed = capsys.readouterr().err
    assert told in printed
    assert "notice: arrays-not-read: the mesh file has arrays that are not read: 'hair'" in printed
    assert main(["check", given[0], "--strict"]) == 1
    assert "--allow arrays-unused" in capsys.readouterr().err
