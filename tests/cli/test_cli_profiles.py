"""`bake --profile`: several kinds of files of one map."""

from __future__ import annotations

import json
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from cli.running import usage_error, write_animation
from exports.textures.reading import read_texture
from meshes import SmallMesh
from rhytid.cli import main
from rhytid.engine.engine import Engine
from rhytid.engine.messages import MapQuery
from rhytid.exports.textures import PROFILE_NAMES
from rhytid.exports.textures.frame_map import Chart
from rhytid.formats.meshes import read_mesh
from rhytid.support.settings import ServiceSettings

SMALL = ("--resolution", "256", "--wrinkles", "400")


@pytest.mark.slow
def test_one_bake_writes_every_profile(
    tmp_path: Path, small_mesh: SmallMesh, capsys: pytest.CaptureFixture[str]
) -> None:
    shot = write_animation(tmp_path / "shot.npz", small_mesh, 1)
    out, store = tmp_path / "maps", tmp_path / "store"
    names = [name for name in PROFILE_NAMES if name != "half"]
    given = ["bake", "--mesh", str(shot), "--out", str(out), "--store", str(store), *SMALL]

    assert main([*given, "--json"]) == 0
    alone = read_texture(out / "shot.1001.0001.exr")
    first = json.loads(capsys.readouterr().out)
    assert main([*given, "--profile", *names, "--json"]) == 0
    told = capsys.readouterr()
    figures = json.loads(told.out)

    assert (figures["written"], figures["skipped"]) == (len(names) - 1, 1)
    assert first["bytes_at_most"] == {"frame": 4 * 256**2, "all": 4 * 256**2, "frames": 1}
    line = "rhytid: maps: up to 2.8 MB per frame, 2.8 MB for 1 frame, before compression"
    assert line in told.err
    heights = alone.texels[..., 0]
    assert heights.min() < -1e-3
    for kind in ("normal-gl.1001.0001", "normal-dx.0001.1001", "cavity.0001.1001"):
        found = read_texture(out / f"shot.{kind}.png")
        assert np.ptp(found.texels[..., 0]) > 50
        assert float(found.attributes["maximum"]) <= 1.0
    weights = read_texture(out / "shot.weights.0001.1001.png").texels
    assert weights[..., :2].max(axis=(0, 1)).min() > 5
    levels_are_the_services(out, store, figures["asset"], shot)


def levels_are_the_services(out: Path, store: Path, asset: str, shot: Path) -> None:
    """Bit for bit what a renderer gets as tiles, of texels that lie inside of islands."""
    with np.load(shot) as arrays:
        frame = arrays["frames"][0]
    settings = replace(ServiceSettings.from_environment(), store=store)
    with closing(Engine(settings)) as engine:
        engine.frames.put(asset, "0001", frame)
        mesh = read_mesh(shot.read_bytes(), shot.name).mesh
        inside = Chart.of(mesh, 1001, engine.tiles.triangles(asset, 1001)).inside
        heights_of_png16(out, inside)
        for level in range(5):
            side = 256 >> level
            whole = inside.reshape(side, 1 << level, side, -1).all(axis=(1, 3))
            assert whole.sum() > 20
            wanted = engine.tiles.plan_map(asset, "0001", MapQuery(), 1001, level).draw()
            for name in ("shot.mip.1001.0001.exr", "shot.1001.0001.tx"):
                found = read_texture(out / name, level).texels[..., 0]
                np.testing.assert_array_equal(found[whole], wanted[whole])


def heights_of_png16(out: Path, inside: NDArray[np.bool_]) -> None:
    heights = read_texture(out / "shot.1001.0001.exr").texels[..., 0]
    coded = read_texture(out / "shot.png16.1001.0001.png")
    full = float(coded.attributes["range"])
    shown = (coded.texels[..., 0] / 65535 - float(coded.attributes["midlevel"])) * full
    assert np.abs(shown - heights)[inside].max() < full / 65535


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--half", "--profile", "tx"], "--half is --profile half"),
        (["--profile", "jpeg"], "invalid choice"),
        (["--profile", "png16", "--level", "2"], "--level is of the profiles"),
        (["--profile", "slopes", "--base-roughness", "0.5"], "--base-roughness is of"),
        (["--profile", "roughness", "--base-roughness", "1.5"], "a number from 0 to 1"),
        (["--profile", "png16", "--compression", "zips"], "is of the profiles float and half"),
        (["--compression", "rar"], "invalid choice"),
        (["--blood-time", "0.3"], "is of --profile blood"),
        (["--profile", "blood", "--blood-time", "-1"], "seconds, 0 to 10"),
    ],
)
def test_options_that_contradict(
    options: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["bake", "--mesh", __file__, "--out", str(tmp_path / "x")]
    assert message in usage_error(capsys, *given, *options)


def test_files_of_the_same_name_are_refused(
    tmp_path: Path, small_mesh: SmallMesh, capsys: pytest.CaptureFixture[str]
) -> None:
    shot = write_animation(tmp_path / "shot.npz", small_mesh, 1)
    given = ["bake", "--mesh", str(shot), "--out", str(tmp_path / "x")]

    assert main([*given, "--profile", "float", "half"]) == 1
    assert "have the same file names" in capsys.readouterr().err
    assert not (tmp_path / "x").exists()


def test_a_compression_changes_no_texel(tmp_path: Path, small_mesh: SmallMesh) -> None:
    shot = write_animation(tmp_path / "shot.npz", small_mesh, 1)
    given = ["bake", str(shot), *SMALL, "--half"]
    found = []
    for compression in ("zip", "piz"):
        out = tmp_path / compression
        assert main([*given, "--out", str(out), "--compression", compression]) == 0
        found.append(read_texture(out / "shot.1001.0001.exr"))

    np.testing.assert_array_equal(found[0].texels, found[1].texels)
    assert [one.attributes["compression"] for one in found] == ["zip", "piz"]


def test_a_level_that_there_is_not_is_refused_before_anything_is_built(
    tmp_path: Path, small_mesh: SmallMesh, capsys: pytest.CaptureFixture[str]
) -> None:
    shot, out = write_animation(tmp_path / "shot.npz", small_mesh, 1), tmp_path / "maps"
    given = ["bake", "--mesh", str(shot), "--out", str(out), *SMALL, "--profile", "slopes"]
    assert main([*given, "--level", "9"]) == 1
    assert "--level 9: maps of 256 x 256 texels have levels 0 to 8" in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.parametrize(("level", "told"), [([], True), (["--level", "1"], False)])
def test_roughness_beside_normals_of_another_level_is_told(
    level: list[str], told: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    profiles = ["--profile", "roughness", "normal-gl", *level]
    assert main(["bake", __file__, "--out", str(tmp_path / "x"), *profiles]) == 1
    assert ("a shader that reads both needs one" in capsys.readouterr().err) == told
