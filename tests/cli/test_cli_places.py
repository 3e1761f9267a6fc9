"""Where commands write is looked at before anything is built; a store that is held says by whom."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cli.running import write_animation
from meshes import SmallMesh
from rhytid.cli import main
from rhytid.errors import InputError
from rhytid.storage.store import AssetStore


@pytest.fixture
def no_device(monkeypatch: pytest.MonkeyPatch) -> None:
    """A command that comes to open a device ends with another error than the one expected."""

    def opened(*_: Any, **__: Any) -> None:
        raise AssertionError("a device was opened")

    # In this order: the second is imported from the first.
    monkeypatch.setattr("rhytid.engine.engine.open_device", opened)
    monkeypatch.setattr("rhytid.engine.engine.open_device", opened)


@pytest.mark.usefixtures("no_device")
@pytest.mark.parametrize(
    "arguments",
    [
        "bake {mesh} --out {below}",
        "bake {mesh} --out {here} --openjd {below}",
        "bake {mesh} --out {here} --json {below}",
        "export {below} --mesh {mesh}",
        "synthesize {mesh} --out {below}.safetensors",
        "synthesize {mesh} --out {here}/g.safetensors --preview {below}.png",
        "synthesize {mesh} --out {here}/g.safetensors --json {below}",
        "template {mesh} --out {below}",
        "controls {mesh} --out {below}.png",
        "convert {mesh} --out {below}.npz",
        "check {mesh} --picture {below}.png",
        "snapshot 0123456789abcdef --out {below}",
        "demo {mesh} --out {below}",
        "reproduce --out {below}",
        "bench --scaling {below}",
        "bench --json {below}",
    ],
)
def test_what_cannot_be_written_is_told_before_anything_is_built(
    arguments: str, tmp_path: Path, small_mesh: SmallMesh, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh = write_animation(tmp_path / "shot.npz", small_mesh, 1)
    (tmp_path / "file").touch()
    below = tmp_path / "file" / "sub" / "out"
    words = arguments.format(mesh=mesh, below=below, here=tmp_path / "here").split()
    assert main(words) == 1
    last = capsys.readouterr().err.splitlines()[-1]
    assert last.startswith(f"rhytid {words[0]}: {below}")
    assert last.endswith("cannot be written: Not a directory")


@pytest.mark.usefixtures("no_device")
@pytest.mark.parametrize(
    "arguments",
    [
        "bake {mesh} --out {file}",
        "export {file} --mesh {mesh}",
        "bake {mesh} --out x --json {file}/x.json",
    ],
)
def test_a_file_is_no_folder_of_maps(
    arguments: str, tmp_path: Path, small_mesh: SmallMesh, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh = write_animation(tmp_path / "shot.npz", small_mesh, 1)
    assert main(arguments.format(mesh=mesh, file=mesh).split()) == 1
    assert f"{mesh} is a file, not a folder" in capsys.readouterr().err


@pytest.mark.usefixtures("no_device")
@pytest.mark.parametrize("link", [False, True])
@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ("synthesize {mesh} --out {pipe}", "g.safetensors"),
        ("convert {mesh} --out {pipe}", "shot.2.npz"),
        ("convert {mesh} --out {mesh} --json {pipe}", "figures.json"),
    ],
)
def test_no_file_takes_the_place_of_a_pipe_or_a_device(
    arguments: str,
    name: str,
    link: bool,
    tmp_path: Path,
    small_mesh: SmallMesh,
    capsys: pytest.CaptureFixture[str],
) -> None:
    mesh = write_animation(tmp_path / "shot.npz", small_mesh, 1)
    pipe = tmp_path / name
    os.mkfifo(tmp_path / "fifo" if link else pipe)
    if link:
        pipe.symlink_to("fifo")
    assert main(arguments.format(mesh=mesh, pipe=pipe).split()) == 1
    assert f"{pipe} is a device or a pipe, not a plain file" in capsys.readouterr().err
    assert pipe.is_fifo()


def test_a_second_bake_is_told_of_the_first(
    tmp_path: Path,
    small_mesh: SmallMesh,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    mesh = write_animation(tmp_path / "shot.npz", small_mesh, 1)
    store = tmp_path / "store"
    given = ["bake", str(mesh), "--out", str(tmp_path / "maps"), "--store", str(store)]
    told: list[str] = []

    def build(*_: Any) -> None:
        capsys.readouterr()
        assert main(given) == 1  # the second one, while the first holds the store
        told.append(capsys.readouterr().err.splitlines()[-1])
        raise InputError("no more is needed")

    monkeypatch.setattr("rhytid.baking.bake.build", build)
    assert main(given) == 1
    holder = f"another rhytid bake, process {os.getpid()}"
    assert told == [f"rhytid bake: store {store} is in use by {holder}"]
    with AssetStore(store):  # a program that is not named serves
        assert main(given) == 1
        assert "is in use by another rhytid serve, process " in capsys.readouterr().err


def test_no_server_begins_in_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "store"
    file.write_text("of somebody else")
    assert main(["serve", "--store", str(file), "--port", "0"]) == 1
    assert capsys.readouterr().err == f"rhytid serve: the store {file} is a file, not a folder\n"


def test_a_store_that_an_earlier_version_holds_is_in_use_all_the_same(tmp_path: Path) -> None:
    with AssetStore(tmp_path):
        (tmp_path / "lock").write_text("")
        with pytest.raises(Exception, match="is in use by another rhytid process"):
            AssetStore(tmp_path)


@pytest.mark.usefixtures("no_device")
@pytest.mark.parametrize(
    ("arguments", "kind"),
    [
        ("check {other}", "mesh file"),
        ("check {mesh} --frames {other}", "frame file"),
        ("bake {mesh} --shapes {other} --out {out}", "shapes"),
    ],
)
def test_formats_that_are_listed_are_all_that_are_read(
    arguments: str,
    kind: str,
    tmp_path: Path,
    small_mesh: SmallMesh,
    capsys: pytest.CaptureFixture[str],
) -> None:
    mesh = tmp_path / "face.npz"
    np.savez(mesh, **small_mesh._asdict(), frames=small_mesh.positions[None])
    other = tmp_path / "face.fbx"
    other.touch()
    assert main(arguments.format(mesh=mesh, other=other, out=tmp_path / "out").split()) == 1
    last = capsys.readouterr().err.splitlines()[-1]
    assert f"{other}: {kind} with extension '.fbx': must be one of ." in last
    assert ".usd, .usda, .usdc, .usdz" in last
    assert "(USD needs the extra usd; in a clone of rhytid: pip install '.[usd]')" in last
    assert (".mdd, .pc2" in last) == (kind != "mesh file")
