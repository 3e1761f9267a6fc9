"""`rhytid bake --asset`: an asset that is built already, as on another machine."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cli.running import only_asset, usage_error, write_animation
from meshes import SmallMesh
from rhytid.cli import main
from rhytid.formats.exr import read_exr

SMALL = ("--resolution", "256", "--wrinkles", "400", "--method", "binned")


@pytest.mark.slow
def test_parts_by_a_restored_asset_are_what_one_bake_writes(
    tmp_path: Path, small_mesh: SmallMesh, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh = str(write_animation(tmp_path / "shot.npz", small_mesh, 3))
    here, there = (str(tmp_path / name) for name in ("here", "there"))
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    assert main(["bake", "--mesh", mesh, "--out", str(whole), "--store", here, *SMALL]) == 0
    asset = only_asset(tmp_path / "here")
    snapshot = str(tmp_path / "face.tar")
    assert main(["snapshot", asset, "--store", here, "--out", snapshot]) == 0
    assert main(["restore", snapshot, "--store", there]) == 0

    given = ["bake", "--mesh", mesh, "--out", str(parts), "--store", there, "--asset", asset]
    for part in ("1-2", "3"):
        assert main([*given, "--method", "binned", "--frame-range", part]) == 0

    files = sorted(file.name for file in whole.glob("*.exr"))
    assert files == [f"shot.1001.{frame:04d}.exr" for frame in (1, 2, 3)]
    assert files == sorted(file.name for file in parts.glob("*.exr"))
    for name in files:
        assert (whole / name).read_bytes() == (parts / name).read_bytes()

    other = str(write_animation(tmp_path / "other.npz", small_mesh, 1))
    moved = main([*given[:2], other, *given[3:]])
    assert moved == 0  # the same neutral with other frames
    capsys.readouterr()
    assert main([*given[:-1], "0" * 16]) == 1
    assert f"no asset '{'0' * 16}'; the store is {there}" in capsys.readouterr().err
    assert main([*given, "--frame-range", "2-5"]) == 1
    assert "no frame 4-5; there are 1-3" in capsys.readouterr().err


def test_an_asset_of_another_mesh_is_refused(
    tmp_path: Path, small_mesh: SmallMesh, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh = write_animation(tmp_path / "shot.npz", small_mesh, 1)
    store = str(tmp_path / "store")
    given = ["bake", "--out", str(tmp_path / "maps"), "--store", store]
    assert main([*given, "--mesh", str(mesh), *SMALL]) == 0
    asset = only_asset(tmp_path / "store")
    with np.load(mesh) as arrays:
        np.savez(tmp_path / "big.npz", **{**arrays, "positions": arrays["positions"] * 2})

    assert main([*given, "--mesh", str(tmp_path / "big.npz"), "--asset", asset]) == 1
    assert f"asset {asset} is of another mesh than --mesh" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ([], "--asset needs --store or --shared-store"),
        (["--store", "s", "--seed", "2"], "--seed says how to build an asset"),
        (["--store", "s", "--unit", "cm"], "--unit says how to build an asset"),
        (["--store", "s", "--frames-folder", "."], "give both"),
        (["--chunk", "0"], "a whole number from 1"),
    ],
)
def test_options_that_build_are_refused_beside_an_asset(
    more: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["bake", "--mesh", __file__, "--out", str(tmp_path), "--asset", "a" * 16]
    assert message in usage_error(capsys, *given, *more)


def test_another_resolution_is_the_same_skin(
    tmp_path: Path, small_mesh: SmallMesh, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh = str(write_animation(tmp_path / "shot.npz", small_mesh, 1))
    given = ["bake", "--mesh", mesh, "--store", str(tmp_path / "store")]
    assert main([*given, "--out", str(tmp_path / "small"), *SMALL]) == 0
    asset = only_asset(tmp_path / "store")

    given += ["--asset", asset, "--method", "binned"]
    assert main([*given, "--out", str(tmp_path / "large"), "--resolution", "512"]) == 0
    assert main([*given, "--out", str(tmp_path / "again"), "--resolution", "256"]) == 0
    name = "shot.1001.0001.exr"
    again = (tmp_path / "again" / name).read_bytes()
    assert again == (tmp_path / "small" / name).read_bytes()
    # Nothing of the skin depends on how many texels it is drawn with.
    built = ["bake", "--mesh", mesh, "--out", str(tmp_path / "built"), *SMALL]
    assert main([*built, "--resolution", "512"]) == 0
    made, built_so = (read_exr(tmp_path / folder / name)[0] for folder in ("large", "built"))
    assert made.shape == (512, 512)
    np.testing.assert_array_equal(made, built_so)
    capsys.readouterr()
    assert main([*given, "--out", str(tmp_path / "odd"), "--resolution", "300"]) == 1
    assert "resolution" in capsys.readouterr().err
