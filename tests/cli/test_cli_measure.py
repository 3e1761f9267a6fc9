"""`rhytid measure`: patches of a sheet, of a scan that is known and of skin that is grown."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from PIL import Image

from cli.running import usage_error
from rhytid.cli import main, measure_inputs
from rhytid.domain.mesh import Mesh
from rhytid.engine.assets import creation
from rhytid.pipeline.folds import measured_folds
from rhytid_lab.samples.grids import flat_sheet

WIDE, RESOLUTION = 1.6, 1024  # cm; UV covers 0.96 of the map


@pytest.fixture(scope="module")
def sheet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("sheet") / "sheet.npz"
    mesh: Mesh = flat_sheet(WIDE, 16)
    frame = (mesh.positions * (0.8, 1.0, 1.0)).astype(np.float32)
    arrays = {"positions": mesh.positions, "faces": mesh.faces, "uv": mesh.uv}
    np.savez(file, **arrays, face_uv=mesh.face_uv, frames=frame[None])
    return file


def measured(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    assert main(["measure", *arguments, "--json"]) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


def test_a_scan_of_waves(sheet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """30 micrometres high, 0.8 mm long, their crests upright; along is turned by 30 degrees."""
    line = (np.arange(RESOLUTION) + 0.5) / RESOLUTION
    wave = 0.003 * np.sin(2 * np.pi * (line - 0.5) / 0.96 * WIDE / 0.08)
    heights = np.repeat(wave[None], RESOLUTION, axis=0).astype(np.float32)
    scan = tmp_path / "wave.1001.exr"
    OpenEXR.File({}, {"Y": heights}).write(str(scan))

    found = measured(capsys, str(sheet), "--scan", str(scan), "--patch", "0.5", "0.5")
    more = ("--patch", "0", "0", "0", "--along", "30", "--cutoff", "0.8")
    turned = measured(capsys, str(sheet), "--scan", str(scan), *more)

    [patch] = found["patches"]
    areal = patch["rest"]["areal"]
    assert (areal["sa"], areal["sku"]) == pytest.approx((60 / np.pi, 1.5), rel=0.02)
    assert patch["rest"]["along"]["rz"] == pytest.approx(60.0, rel=0.02)
    assert patch["rest"]["across"]["rz"] < 0.5
    assert patch["rest"]["directions"]["angle"] == 90.0
    assert patch["moved"] is None
    assert turned["patches"][0]["rest"]["directions"]["angle"] == 60.0
    # Half of a wave as long as the cutoff is left, which says nothing of the depth of lines.
    assert turned["patches"][0]["rest"]["areal"]["sq"] == pytest.approx(30 / 8**0.5, rel=0.05)
    assert turned["published"] == []
    [depth] = found["published"]
    assert (depth["inside"], depth["low"], depth["high"]) == (True, 20.0, 200.0)


def test_grown_skin_under_strain(
    sheet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is smoother along the strain, and the loss is held against what is published."""
    plot = tmp_path / "plots" / "measure.png"
    grown = ("--wrinkles", "1500", "--resolution", "512", "--size", "8", "--patch", "0.5", "0.5")
    given = [str(sheet), *grown, "--strain", "1.25", "--plot", str(plot)]

    assert main(["measure", *given, "--json", str(tmp_path / "m.json")]) == 0
    text = capsys.readouterr().out
    found = json.loads((tmp_path / "m.json").read_text())

    [patch] = found["patches"]
    rest, moved = patch["rest"], patch["moved"]
    assert moved["along"]["ra"] < 0.95 * rest["along"]["ra"]
    assert moved["slopes_along"]["variance"] < 0.8 * rest["slopes_along"]["variance"]
    _, ra, rz = found["published"]
    loss = 100 * (1 - moved["along"]["ra"] / rest["along"]["ra"])
    assert ra["value"] == pytest.approx(loss)
    assert (ra["low"], rz["high"]) == (40.0, 50.0)
    assert ("OUTSIDE" in text) == (not all(one["inside"] for one in found["published"]))
    assert "Sa µm" in text
    with Image.open(plot) as drawn:
        assert drawn.width > 2000


@pytest.mark.slow
def test_a_frame_is_measured_where_its_skin_is(
    sheet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As the strain that it is: 0.8 times as wide."""
    grown = ("--wrinkles", "1500", "--resolution", "512", "--size", "6", "--patch", "0.5", "0.5")
    by_frame = measured(capsys, str(sheet), *grown, "--frame", "1")
    by_strain = measured(capsys, str(sheet), *grown, "--strain", "0.8")

    for name in ("sa", "sdq", "sku"):
        first, second = (one["patches"][0]["moved"]["areal"][name] for one in (by_frame, by_strain))
        assert first == pytest.approx(second, rel=1e-3)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--strain", "1.25", "--frame", "1"], "both say how the mesh is moved"),
        (["--scan", __file__, "--strain", "1.25"], "a scan is measured at rest"),
        (["--strain-across", "1.1"], "is beside --strain"),
        (["--frame", "0"], "argument --frame"),
        (["--patch", "1"], "--patch has 1 numbers"),
        (["--strain", "-1"], "--strain -1: above 0"),
        (["--scan", __file__, "--wrinkles", "5"], "--scan gives the relief"),
    ],
)
def test_options_that_contradict(
    options: list[str], message: str, sheet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert message in usage_error(capsys, "measure", "--mesh", str(sheet), *options)


def test_a_patch_beyond_the_mesh_is_refused(
    sheet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scan = tmp_path / "flat.1001.exr"
    OpenEXR.File({}, {"Y": np.eye(64, dtype=np.float32)}).write(str(scan))
    given = ["measure", str(sheet), "--scan", str(scan), "--patch", "0.9", "0.5"]
    assert main(given) == 1
    assert "lies beside the mesh or in another UDIM" in capsys.readouterr().err
    assert main(["measure", str(sheet), "--scan", str(scan), "--place", "nose"]) == 1
    assert "do not show it; they show none" in capsys.readouterr().err


def test_a_painted_region_is_a_place(
    sheet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Skin is there that its region grows, and one that is painted nowhere is no place."""
    mask = np.zeros((64, 64), np.uint8)
    mask[20:44, 40:56] = 255
    for name, painted in (("lip", mask), ("nose", 0 * mask)):
        Image.fromarray(painted).save(tmp_path / f"{name}.1001.png")
    masks = [f"{name}={tmp_path / name}.1001.png" for name in ("lip", "nose")]
    grown = ["--wrinkles", "300", "--resolution", "256", "--size", "2"]
    given = [str(sheet), *grown, "--region-mask", *masks]
    (found,) = measured(capsys, *given, "--place", "lip")["patches"]
    assert found["patch"] == "lip"
    assert main(["measure", *given, "--place", "lip", "-v"]) == 0
    told = capsys.readouterr().err
    for step in ("placing patches", "looking whether patches fit"):
        assert f"rhytid: {step}\n" in told
    assert main(["measure", *given, "--place", "nose"]) == 1
    assert "--place nose: no triangle of it is in UDIM 1001" in capsys.readouterr().err
    assert main(["measure", *given, "--place", "cheek"]) == 1
    assert "--place cheek: the expressions do not show it" in capsys.readouterr().err


@pytest.fixture(scope="module")
def brows(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sheet, whose upper half raised brows compress along y; their file is beside it."""
    file = tmp_path_factory.mktemp("brows") / "sheet.npz"
    mesh: Mesh = flat_sheet(WIDE, 16)
    raised = mesh.positions.copy()
    raised[:, 1] -= 0.3 * np.maximum(raised[:, 1], 0)
    arrays = {"positions": mesh.positions, "faces": mesh.faces, "uv": mesh.uv}
    np.savez(file, **arrays, face_uv=mesh.face_uv)
    np.savez(file.with_name("shapes.npz"), shapes=raised[None], names=["browInnerUp"])
    return file


def test_as_many_wrinkles_are_told_as_regions_leave(
    brows: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By `bake`, `measure` and `synthesize` alike; by area alone it would be another number."""
    skin = ["--spacing", "0.03", "--region", "nose"]
    shapes = ["--shapes", str(brows.with_name("shapes.npz"))]

    def told(command: str, *given: str) -> str:
        assert main([command, str(brows), *skin, *given]) == 0
        return capsys.readouterr().err.partition("notice: about ")[2].partition(" wrinkles")[0]

    out = ("--out", str(tmp_path / "g.safetensors"))
    grown = told("synthesize", *out, *shapes)
    assert grown != told("synthesize", *out)
    measured = ("--resolution", "256", "--size", "2", "--patch", "0.5", "0.5")
    assert told("measure", *measured, *shapes) == grown
    np.save(tmp_path / "frame.npy", np.load(brows)["positions"][None])
    frames = ("--frames", str(tmp_path / "frame.npy"), "--resolution", "256")
    assert told("bake", *frames, "--out", str(tmp_path / "maps"), *shapes) == grown


def test_folds_are_measured_once(
    brows: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of places and of the skin there, and it is told; where the skin has others, they are its
    own."""
    calls = []

    def counted(*given: Any) -> Any:
        calls.append(given)
        return measured_folds(*given)

    for module in (measure_inputs, creation):
        monkeypatch.setattr(module, "measured_folds", counted)
    shapes = ["--shapes", str(brows.with_name("shapes.npz"))]
    sizes = ["--wrinkles", "300", "--resolution", "256", "--size", "2", *shapes]
    given = [str(brows), *sizes, "--place", "forehead"]
    assert main(["measure", *given, "-v"]) == 0
    assert len(calls) == 1
    assert "rhytid: checking the skin\n" in capsys.readouterr().err
    measured(capsys, *given, "--set", "anatomy=coarse")
    assert len(calls) == 3


def test_expressions_say_where_places_of_a_graph_are(
    brows: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """They grow nothing there; without a place they stay refused."""
    shapes = ["--shapes", str(brows.with_name("shapes.npz"))]
    graph = tmp_path / "g.safetensors"
    made = ["synthesize", str(brows), "--out", str(graph), "--wrinkles", "300", *shapes]
    assert main(made) == 0
    capsys.readouterr()
    given = [str(brows), "--graph", str(graph), "--resolution", "256", "--size", "2"]
    (place,) = measured(capsys, *given, *shapes, "--place", "forehead")["patches"]
    assert place["patch"] == "forehead"
    at = [str(value) for value in place["origin"]]
    (patch,) = measured(capsys, *given, "--patch", *at)["patches"]
    assert place["rest"]["areal"]["sa"] == pytest.approx(patch["rest"]["areal"]["sa"], rel=0.01)
    assert "--shapes says how lines grow" in usage_error(capsys, "measure", *given, *shapes)


@pytest.mark.parametrize("source", ["graph", "scan"])
def test_a_painted_region_is_a_place_of_skin_that_is_not_grown(
    source: str, sheet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A mask has no say there but in --place; beside it and other options it stays refused."""
    file, mask = tmp_path / f"{source}.1001.exr", np.zeros((64, 64), np.uint8)
    if source == "graph":
        file = tmp_path / "g.safetensors"
        assert main(["synthesize", str(sheet), "--out", str(file), "--wrinkles", "300"]) == 0
    else:
        OpenEXR.File({}, {"Y": np.eye(64, dtype=np.float32)}).write(str(file))
    mask[20:44, 40:56] = 255
    Image.fromarray(mask).save(tmp_path / "lip.1001.png")
    sizes = ["--resolution", "256", "--size", "2"]
    given = [str(sheet), f"--{source}", str(file), *sizes]
    masked = [*given, "--region-mask", f"lip={tmp_path / 'lip.1001.png'}"]
    capsys.readouterr()
    (place,) = measured(capsys, *masked, "--place", "lip")["patches"]
    at = [str(value) for value in place["origin"]]
    (patch,) = measured(capsys, *given, "--patch", *at)["patches"]
    assert (place["patch"], place["triangle"]) == ("lip", patch["triangle"])
    assert place["rest"]["areal"]["sa"] == pytest.approx(patch["rest"]["areal"]["sa"], rel=0.01)
    assert "--region-mask" in usage_error(capsys, "measure", *masked)
    other = ["--place", "lip", "--region", "lip"]
    assert "--region says" in usage_error(capsys, "measure", *masked, *other)


def test_what_does_not_fit_is_told_beside_the_figures_of_others(
    sheet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The sheet ends 2.7 mm right of the first: 5 mm across fit, 6 do not."""
    scan = tmp_path / "flat.1001.exr"
    OpenEXR.File({}, {"Y": np.eye(64, dtype=np.float32)}).write(str(scan))
    beyond = ["--scan", str(scan), "--patch", "0.82", "0.5"]
    given = [str(sheet), *beyond, "--patch", "0.5", "0.5"]
    found = measured(capsys, *given)
    assert [patch["patch"] for patch in found["patches"]] == ["1001 0.500 0.500"]
    (warning,) = (one for one in found["warnings"] if one["code"] == "patch-size")
    assert warning["where"] == "patch 1001 0.820 0.500"
    assert "take --size 5 or another place" in warning["detail"]
    assert measured(capsys, str(sheet), *beyond, "--size", "5")["patches"]
    assert main(["measure", *given, "--strict"]) == 1
    assert "--allow patch-size" in capsys.readouterr().err


def test_a_place_that_goes_beyond_where_it_is_moved_is_left_out(
    sheet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Pressed to 0.8 the sheet is 12.8 mm wide: of 14 mm there is no room, at rest there is."""
    grown = ("--wrinkles", "300", "--resolution", "256", "--patch", "0.5", "0.5")
    assert main(["measure", str(sheet), *grown, "--size", "14", "--strain", "0.8"]) == 1
    assert "take a smaller --size or another place" in capsys.readouterr().err


def test_a_place_that_is_in_another_udim_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The lips have triangles in UDIM 1002 alone, which are fewer."""
    skin, lips = flat_sheet(WIDE, 16), flat_sheet(WIDE, 8)
    rest = np.concatenate([skin.positions, lips.positions + np.float32([5, 0, 0])])
    shapes, first = np.stack([rest, rest]), len(skin.positions)
    shapes[0, :first] *= np.float32([1, 0.8, 1])
    shapes[1, first:] += 0.05 * np.sin(9 * lips.positions[:, [1, 2, 0]])
    np.savez(
        tmp_path / "face.npz",
        positions=rest,
        faces=np.concatenate([skin.faces, lips.faces + first]),
        uv=np.concatenate([skin.uv, lips.uv + np.float32([1, 0])]),
        face_uv=np.concatenate([skin.face_uv, lips.face_uv + len(skin.uv)]),
        shapes=shapes,
        names=["browInnerUp", "mouthPucker"],
    )
    assert main(["measure", str(tmp_path / "face.npz"), "--place", "lip", "--size", "4"]) == 1
    told = "--place lip: no triangle of it is in UDIM 1001, which has most: give --patch"
    assert told in capsys.readouterr().err
