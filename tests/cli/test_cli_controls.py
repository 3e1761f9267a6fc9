"""Guiding synthesis on the command line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from cli.running import usage_error, write_neutral
from exr_images import exr, raw_exr
from meshes import SmallMesh
from rhytid.cli import main
from rhytid.formats.graphs import read_graph


@pytest.fixture
def mesh(tmp_path: Path, small_mesh: SmallMesh) -> str:
    return str(write_neutral(tmp_path / "mesh.npz", small_mesh))


def painted(file: Path, left: int, right: int) -> str:
    texels = np.array([[left] * 8 + [right] * 8] * 16, np.uint8)
    if file.suffix == ".exr":
        file.write_bytes(exr((texels / 255).astype(np.float32)))
    else:
        Image.fromarray(texels).save(file)
    return str(file)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["png", "exr"])
def test_maps_masks_and_settings_reach_the_graph(
    tmp_path: Path, mesh: str, capsys: pytest.CaptureFixture[str], kind: str
) -> None:
    out = tmp_path / "g.safetensors"
    base = ["synthesize", mesh, "--out", str(out), "--wrinkles", "600", "--json"]
    assert main(base) == 0
    plain = read_graph(out.read_bytes())
    density = painted(tmp_path / f"d.1001.{kind}", 0, 128)
    mask = painted(tmp_path / f"m.{kind}", 255, 255)
    options = ["--map", f"density={density}", "--region-mask", f"nose={mask}"]
    assert main([*base, *options, "--set", "strength=0.5", "--set", "turn=-10"]) == 0
    graph = read_graph(out.read_bytes())
    drawn = graph.own_nodes & (graph.node_weight > 0)  # a copy has its place in another chart
    assert graph.node_uv[drawn, 0].min() > 0.45 > plain.node_uv[:, 0].min()
    assert graph.edge_weight.mean() < 0.8 * plain.edge_weight.mean()
    capsys.readouterr()
    assert main([*base, "--region", "nose"]) == 0
    assert json.loads(capsys.readouterr().out)["wrinkles"] == 780


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--set", "density=-1"], "--set density is -1: from 0.0625 to 16"),
        (["--wrinkles", "0"], "rhytid synthesize: --wrinkles is 0: from 100 to"),
        (["--map", "density={black}"], "the map leaves no room for pores"),
        (["--map", "density={none}"], "no such file"),
        (["--map", "density={deep}"], "deep.exr has deep texels"),
        (["--map", "dens={black}"], "'dens': one of density"),
        (["--set", "strength=much"], "strength needs a number, as strength=1.5"),
        (["--region-mask", "chin={black}"], "'chin': one of forehead"),
        (["--region-mask", "region_mout={black}"], "did you mean mouth?"),
        (["--map", "event={black}"], "did you mean events?"),
        (["--set", "evnts=1"], "did you mean events?"),
        (["--set", "anatomy=corse"], "did you mean coarse?"),
        (["--region", "chin"], "invalid choice"),
    ],
)
def test_mistakes_are_told(
    tmp_path: Path, mesh: str, capsys: pytest.CaptureFixture[str], options: list[str], told: str
) -> None:
    files = {"black": painted(tmp_path / "b.png", 0, 0), "none": str(tmp_path / "none.png")}
    files["deep"] = str(tmp_path / "deep.exr")
    (tmp_path / "deep.exr").write_bytes(raw_exr(flags=0x802))
    given = [option.format(**files) for option in options]
    out = tmp_path / "g.safetensors"
    try:
        status = main(["synthesize", mesh, "--out", str(out), *given])
    except SystemExit as end:
        status = int(end.code or 0)
    assert status != 0
    assert told in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.parametrize("given", ["density.1001.png", "density="])
def test_a_map_without_its_name_or_its_file_is_told_how(
    given: str, capsys: pytest.CaptureFixture[str]
) -> None:
    told = usage_error(capsys, "synthesize", __file__, "--out", "g.safetensors", "--map", given)
    assert f"{given!r}: write it as NAME=FILE" in told
