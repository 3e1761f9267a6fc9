"""What commands remove in the folder of their output: files of an earlier run, and no others."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from meshes import bumpy_grid
from rhytid.cli import main
from rhytid.errors import InputError
from rhytid.exports.skin_package.package import has_package
from rhytid_lab.commands.demo_session import remove_earlier

OF_A_DEMO = ("contact_0003.png", "redraw/face.1001.0003.exr", "binned/face.1001.0003.exr")
OF_OTHERS = (
    "contact_sheet.png",
    "contact_0003.jpg",
    "redraw/face.mine.exr",
    "other/face.1001.1.exr",
)


def written(folder: Path, *names: str) -> None:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(b"a")


def names(folder: Path) -> set[str]:
    return {str(file.relative_to(folder)) for file in folder.rglob("*") if file.is_file()}


def test_a_demo_removes_what_an_earlier_one_wrote(tmp_path: Path) -> None:
    written(tmp_path, *OF_A_DEMO, *OF_OTHERS)
    before = names(tmp_path)
    remove_earlier(tmp_path)
    assert names(tmp_path) == before, "no demo has run here"
    (tmp_path / "times.json").write_text("[1, 2]")
    remove_earlier(tmp_path)
    assert names(tmp_path) == {*before, "times.json"}
    figures = {"key_frames": [], "wrinkles": 5, "r_max": 0.1, "device": "a device"}
    (tmp_path / "times.json").write_text(json.dumps(figures))
    remove_earlier(tmp_path)
    assert names(tmp_path) == {*OF_OTHERS, "times.json"}


def test_an_export_replaces_no_manifest_of_something_else(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh, out = tmp_path / "face.npz", tmp_path / "web page"
    np.savez(mesh, **bumpy_grid(4, seed=1)._asdict())
    written(out, "textures/maps.1001.ktx2", "manifest.json")
    before = names(out)
    assert main(["export", "--mesh", str(mesh), str(out)]) != 0
    told = f"{out / 'manifest.json'} is not of a skin package: choose another folder"
    assert told in capsys.readouterr().err
    assert names(out) == before
    (out / "manifest.json").write_text('{"name": "my app", "start_url": "."}')
    with pytest.raises(InputError, match="choose another folder"):
        has_package(out)
    (out / "manifest.json").write_text('{"format": "rhytid-skin"}')
    assert has_package(out)
    (out / "manifest.json").unlink()
    assert not has_package(out)
