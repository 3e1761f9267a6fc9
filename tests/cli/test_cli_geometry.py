"""`bake --geometry`: surfaces that the written maps displace."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from cli.running import usage_error, write_animation, write_neutral
from meshes import SmallMesh
from rhytid.cli import bake as cli_bake
from rhytid.cli import main
from rhytid.exports.displaced import Samples
from rhytid.formats.exr import read_exr
from rhytid.formats.meshes import read_mesh

SMALL = ("--resolution", "256", "--wrinkles", "400")


def bake(mesh: Path, out: Path, *more: str) -> dict[str, int]:
    figures = out.parent / "figures.json"
    given = ["bake", "--mesh", str(mesh), "--out", str(out), *SMALL, *more]
    assert main([*given, "--json", str(figures)]) == 0
    told = json.loads(figures.read_text())
    return {name: told[name] for name in ("written", "skipped")}


def test_what_is_made_of_positions_follows_them(tmp_path: Path, small_mesh: SmallMesh) -> None:
    """Maps of the neutral are the same in every frame; normals and surfaces are not."""
    mesh, frame = write_neutral(tmp_path / "mesh.npz", small_mesh), tmp_path / "frame.npy"
    out, store = tmp_path / "maps", str(tmp_path / "store")
    more = ("--store", store, "--frames", str(frame), "--method", "neutral", "--subdivide", "0",
            "--geometry", "glb", "--profile", "float", "normal-gl")  # fmt: skip
    for stretched in (1.0, 1.01):
        np.save(frame, small_mesh.positions * np.float32([stretched, 1.0, 1.0]))
        kept = 1 if stretched != 1.0 else 0
        assert bake(mesh, out, *more) == {"written": 3 - kept, "skipped": kept}
        assert bake(mesh, out, *more) == {"written": 0, "skipped": 3}


@pytest.mark.slow
@pytest.mark.parametrize("format", ["glb", "ply"])
def test_a_surface_is_moved_by_its_map(tmp_path: Path, small_mesh: SmallMesh, format: str) -> None:
    shot = write_animation(tmp_path / "shot.npz", small_mesh, 2)
    out, store = tmp_path / "maps", str(tmp_path / "store")
    more = ("--store", store, "--geometry", format, "--subdivide", "1")
    assert bake(shot, out, *more) == {"written": 4, "skipped": 0}

    with np.load(shot) as arrays:
        frames = arrays["frames"]
    for number, frame in enumerate(frames, 1):
        file = out / f"shot.{number:04d}.{format}"
        found = read_mesh(file.read_bytes(), file.name).mesh
        heights, _ = read_exr(out / f"shot.1001.{number:04d}.exr")
        assert len(found.faces) == 800
        uv = np.zeros((len(found.positions), 2))
        uv[found.faces] = found.triangle_uv()
        moved = np.linalg.norm(found.positions[: len(frame)] - frame, axis=1)
        # Away from the seam each vertex moves by what its one map has there.
        alone = np.setdiff1d(np.arange(len(frame)), 5 + 11 * np.arange(11))
        vertices = np.arange(len(frame))
        wanted = np.abs(Samples.of(uv[vertices], heights.shape, vertices).read(heights))
        assert moved[alone] == pytest.approx(wanted[alone], abs=2e-6)
        assert wanted.max() > 1e-3

    assert bake(shot, out, *more) == {"written": 0, "skipped": 4}
    one = out / f"shot.0002.{format}"
    before = one.read_bytes()
    one.unlink()
    assert bake(shot, out, *more) == {"written": 1, "skipped": 3}
    assert one.read_bytes() == before
    assert bake(shot, out, *more[:-1], "0") == {"written": 2, "skipped": 2}


def test_too_many_triangles_are_refused_before_anything_is_made(
    tmp_path: Path, small_mesh: SmallMesh, capsys: pytest.CaptureFixture[str]
) -> None:
    shot, out = write_animation(tmp_path / "shot.npz", small_mesh._replace(
        faces=np.repeat(small_mesh.faces, 3, axis=0),
        face_uv=np.repeat(small_mesh.face_uv, 3, axis=0),
    ), 1), tmp_path / "maps"  # fmt: skip
    given = ["bake", "--mesh", str(shot), "--out", str(out), "--geometry", "glb"]
    assert main([*given, "--subdivide", "8"]) == 1
    assert "600 triangles cut 8 times are 39321600" in capsys.readouterr().err
    assert not out.exists()


def test_the_first_frame_is_drawn_as_a_picture(
    tmp_path: Path, small_mesh: SmallMesh, monkeypatch: pytest.MonkeyPatch
) -> None:
    """That of the part that is baked, whether its maps are there already or not."""
    monkeypatch.setattr(cli_bake, "_PIXELS", 200)
    shot = write_animation(tmp_path / "shot.npz", small_mesh, 2)
    more = ("--store", str(tmp_path / "store"))
    found = []
    for name, part in (("first", ()), ("again", ()), ("second", ("--frame-range", "2"))):
        file = tmp_path / "pictures" / f"{name}.png"
        bake(shot, tmp_path / "maps", *more, *part, "--picture", str(file))
        with Image.open(file) as picture:
            found.append(np.asarray(picture))
    assert found[0].shape == (200, 200, 3)
    assert (found[0][0, 0] == 255).all()
    assert found[0].std() > 10
    assert (found[1] == found[0]).all()
    assert (found[2] != found[0]).any()


def test_a_job_bundle_has_no_picture(
    tmp_path: Path, small_mesh: SmallMesh, capsys: pytest.CaptureFixture[str]
) -> None:
    shot = str(write_animation(tmp_path / "shot.npz", small_mesh, 1))
    given = ("--mesh", shot, "--out", str(tmp_path), "--openjd", str(tmp_path))
    told = usage_error(capsys, "bake", *given, "--picture", str(tmp_path / "p.png"))
    assert "--picture is of a frame that is baked" in told
