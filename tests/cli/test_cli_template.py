"""Paint aids: images that open where they shall, and masks that change nothing until painted."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from cli.running import write_neutral
from meshes import SmallMesh
from rhytid.cli import main
from rhytid.cli.template import MASKS
from rhytid.domain.painted_maps import CONTROLS, REGION_MAPS, REGION_PREFIX
from rhytid.formats.graphs import read_graph
from rhytid.formats.painted import read_stiffness


@pytest.fixture
def mesh(tmp_path: Path, small_mesh: SmallMesh) -> str:
    return str(write_neutral(tmp_path / "mesh.npz", small_mesh))


@pytest.fixture
def paint(tmp_path: Path, mesh: str) -> Path:
    out = tmp_path / "new" / "paint"
    assert main(["template", mesh, "--out", str(out), "--size", "64", "-q"]) == 0
    return out


def test_every_image_opens_with_its_mode_and_size(paint: Path) -> None:
    assert set(MASKS) == {*CONTROLS, "stiffness"}
    modes = {f"{name}.1001.png": "I;16" for name in MASKS}
    modes |= {"template.1001.png": "RGBA", "texel_size.1001.png": "RGB", "guide.png": "RGB"}
    assert {file.name for file in paint.iterdir()} == set(modes)
    for name, mode in modes.items():
        with Image.open(paint / name) as image:
            image.load()
            assert image.format == "PNG"
            assert image.mode == mode, name
            assert name == "guide.png" or image.size == (64, 64)


def test_all_starter_masks_grow_the_skin_of_none(tmp_path: Path, mesh: str, paint: Path) -> None:
    out = [tmp_path / "plain.safetensors", tmp_path / "masked.safetensors"]
    base = ["synthesize", mesh, "--wrinkles", "600", "-q", "--out"]
    maps = [f"{name}={paint / name}.1001.png" for name in CONTROLS if name not in REGION_MAPS]
    masks = [f"{n.removeprefix(REGION_PREFIX)}={paint / n}.1001.png" for n in REGION_MAPS]
    assert main([*base, str(out[0])]) == 0
    assert main([*base, str(out[1]), "--map", *maps, "--region-mask", *masks]) == 0
    assert out[0].read_bytes() == out[1].read_bytes()
    assert len(read_graph(out[0].read_bytes()).edge_nodes) >= 600


def test_the_starter_of_stiffness_leaves_stretch_as_it_is(paint: Path) -> None:
    file = paint / "stiffness.1001.png"
    stiffness = read_stiffness([(file.name, file.read_bytes())], [1001])
    assert stiffness.texels(1001, 256, 0, 0, 256) is None


def test_what_is_painted_is_kept(
    mesh: str, paint: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    painted = paint / "density.1001.png"
    Image.fromarray(np.full((8, 8), 200, np.uint8)).save(painted)
    before = painted.read_bytes()
    (paint / "scale.1001.png").unlink()
    assert main(["template", mesh, "--out", str(paint), "--size", "32", "--json"]) == 0
    told = {f["file"]: f["shows"] for f in json.loads(capsys.readouterr().out)["files"]}
    assert painted.read_bytes() == before
    assert told["density.1001.png"] == "kept as it is"
    assert told["scale.1001.png"] == "a mask, grey 0.5: changes nothing yet"
    with Image.open(paint / "scale.1001.png") as image:
        assert image.size == (32, 32)


def test_only_the_masks_that_are_wanted(tmp_path: Path, mesh: str) -> None:
    options = ["--masks", "direction", "region_lip", "mouth", "--size", "16", "-q"]
    assert main(["template", mesh, "--out", str(tmp_path / "p"), *options]) == 0
    found = {file.name for file in (tmp_path / "p").glob("*.1001.png")}
    assert found == {
        "template.1001.png", "texel_size.1001.png", "direction.1001.png", "region_lip.1001.png",
        "region_mouth.1001.png",
    }  # fmt: skip


@pytest.mark.parametrize("size", ["15", "8193"])
def test_a_size_out_of_range_is_told(
    tmp_path: Path, mesh: str, capsys: pytest.CaptureFixture[str], size: str
) -> None:
    assert main(["template", mesh, "--out", str(tmp_path / "p"), "--size", size]) == 1
    assert f"--size {size}: from 16 to 8192" in capsys.readouterr().err
    assert not (tmp_path / "p").exists()


def test_how_many_maps_go_together_is_told(
    tmp_path: Path, mesh: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rhytid.cli.template.MOST_TEXELS", 3 * 16 * 16 + 1)
    options = ["--size", "16", "--masks", "density"]
    assert main(["template", mesh, "--out", str(tmp_path / "p"), *options]) == 0
    assert "At this size 3 maps" in capsys.readouterr().out
