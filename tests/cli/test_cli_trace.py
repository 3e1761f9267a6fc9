"""`rhytid trace`: a scan becomes a graph and a residual, which together are the scan at rest."""

from __future__ import annotations

import json
import shlex
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import scipy
from numpy.typing import NDArray
from PIL import Image

from exr_images import exr
from meshes import SmallMesh
from pipeline.scenes import sheet
from reference import tracing as reference
from rhytid.baking.input_files import control_files, mask_files, mesh_file, stiffness_files
from rhytid.baking.inputs import scanned_skin
from rhytid.baking.request import SkinRequest
from rhytid.baking.run_warnings import RunWarnings
from rhytid.cli import main
from rhytid.domain.mesh import Mesh
from rhytid.errors import InputError
from rhytid.exports.textures.frame_map import local_edges
from rhytid.formats.exr import read_exr
from rhytid.formats.graphs import read_graph
from rhytid_lab.samples.face import procedural_face

pytestmark = pytest.mark.usefixtures("decoded_here")

SIDE, RANGE = 256, 0.02
STEP = RANGE / 65535
# Of a map of each UDIM.
GREYS = {1001: 10, 1002: 200}
FILES = {"graph.safetensors", "residual.1001.exr", "settings.json", "trace.png"}


class Traced(NamedTuple):
    """What was traced of a face: its file, the scan's, the folder, what was printed and told."""

    mesh: Path
    scan: Path
    out: Path
    said: str
    told: dict


def trace(*arguments: object) -> int:
    return main(["trace", *map(str, arguments)])


def write_face(file: Path) -> Path:
    face = procedural_face(48)
    arrays = {name: getattr(face.mesh, name) for name in ("positions", "faces", "uv", "face_uv")}
    np.savez(file, **arrays, frames=face.mesh.positions[None])
    return file


def neutral_map(mesh: Path, traced: Path, out: Path) -> NDArray[np.float32]:
    """The neutral that `bake` draws of what was traced, mesh units."""
    files = "--graph", traced / "graph.safetensors", "--settings", traced / "settings.json"
    given = ["bake", mesh, "--out", out, "--method", "neutral", *files]
    assert main([*map(str, given)]) == 0
    [file] = out.glob("*.exr")
    return read_exr(file)[0]


def relief() -> NDArray[np.float32]:
    """Lines, pores and broad swells, mesh units."""
    rng = np.random.default_rng(1)
    starts = rng.uniform(30, 226, (60, 2))
    lines = np.concatenate([starts, starts + rng.uniform(-25, 25, (60, 2))], axis=1)
    found = reference.relief_of_lines(SIDE, lines, 3.0, 0.003, 1.0)
    found = found + reference.relief_of_pores(SIDE, rng.uniform(30, 226, (40, 2)), 4.0, 0.002)
    return (found + 0.001 * np.sin(np.arange(SIDE) / 20.0)).astype(np.float32)


def write_codes(file: Path, heights: NDArray[np.float32]) -> Path:
    codes = np.round((heights / RANGE + 0.5) * 65535)
    assert 0 < codes.min() < codes.max() < 65535
    Image.fromarray(codes.astype(np.uint16)).save(file)
    return file


@pytest.fixture(scope="module")
def traced(tmp_path_factory: pytest.TempPathFactory) -> Traced:
    """A relief in 16 bits on a face, traced."""
    folder = tmp_path_factory.mktemp("traced")
    mesh = write_face(folder / "face.npz")
    scan = write_codes(folder / "scan.png", relief())
    told, out = folder / "told.json", folder / "traced"
    with pytest.MonkeyPatch.context() as patch:
        said: list[str] = []
        patch.setattr("rhytid.support.console.note", said.append)
        given = (mesh, scan, "--scale", RANGE, "--out", out, "--json", told, "--verbose")
        assert trace(*given) == 0
    return Traced(mesh, scan, out, "\n".join(said), json.loads(told.read_text()))


def test_files_and_figures(traced: Traced) -> None:
    assert {file.name for file in traced.out.iterdir()} == FILES
    graph = read_graph((traced.out / "graph.safetensors").read_bytes())
    told = traced.told
    assert (graph.wrinkles, graph.pores) == (told["wrinkles"], told["pores"])
    assert graph.wrinkles > 100
    assert (told["unit"], told["resolution"]) == ("cm", SIDE)
    [udim] = told["udims"]
    assert udim["udim"] == 1001
    assert 0.0 < udim["left"] < 0.9
    assert 0.0 < udim["fine_left"] < 0.9
    with Image.open(traced.out / "trace.png") as picture:
        assert picture.width > 3 * SIDE


def test_warned_where_lines_explain_next_to_nothing(traced: Traced, tmp_path: Path, capfd) -> None:
    """Noise, with one short line in it."""
    assert "scan-lines" not in {warning["code"] for warning in traced.told["warnings"]}
    rng, out, told = np.random.default_rng(3), tmp_path / "traced", tmp_path / "told.json"
    noise = 0.001 * rng.normal(size=(SIDE, SIDE)).clip(-3, 3)
    noise[100:103, 60:70] -= 0.004
    scan = write_codes(tmp_path / "scan.png", noise)
    given = (traced.mesh, scan, "--scale", RANGE, "--out", out, "--json", told)
    assert trace(*given) == 0
    assert "scan-lines: UDIM 1001: lines and pores leave " in capfd.readouterr().err
    refused = tmp_path / "refused"
    assert trace(*given, "--out", refused, "--strict", "--allow", "scan-seams") == 1
    assert "--allow scan-lines would allow" in capfd.readouterr().err
    assert not list(refused.iterdir())

    baked = ["bake", traced.mesh, "--scan", scan, "--scale", RANGE, "--method", "neutral"]
    baked += ["--out", tmp_path / "maps", "--store", tmp_path / "store"]
    assert main([*map(str, baked)]) == 0
    assert "scan-lines: UDIM 1001: lines and pores leave " in capfd.readouterr().err
    # It is kept with the asset.
    assert main([*map(str, baked), "--strict", "--allow", "scan-seams"]) == 1
    assert "--allow scan-lines would allow" in capfd.readouterr().err


def test_floats_without_a_scale_are_lengths(
    traced: Traced, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In every command that reads them."""
    scan, said = tmp_path / "scan.tif", []
    Image.fromarray(relief()).save(scan)
    monkeypatch.setattr("rhytid.baking.run_warnings.note", said.append)
    told = "without --scale the value 1 of these floats is taken for 1 cm"
    assert main(["check", str(traced.mesh), "--scan", str(scan)]) == 0
    assert said == [f"rhytid check: notice: {told}"]
    with RunWarnings("bake", strict=False) as warnings:
        scanned_skin(SkinRequest({}, scan=[scan]), mesh_file(traced.mesh), {}, warnings)
    assert said[1:] == [f"rhytid bake: notice: {told}"]


def test_scan_is_residual_and_neutral(traced: Traced, tmp_path: Path) -> None:
    """Within half a step of 16 bits, at every texel of a chart."""
    neutral = neutral_map(traced.mesh, traced.out, tmp_path)
    residual, facts = read_exr(traced.out / "residual.1001.exr")
    with Image.open(traced.scan) as image:
        scan = (np.asarray(image, np.float64) / 65535 - 0.5) * RANGE
    assert facts["unit"] == "cm"
    assert np.abs(neutral).max() > 20 * STEP
    chart = inside(traced.mesh)
    off = np.abs(residual.astype(np.float64) + neutral - scan)[chart]
    assert off.max() < 0.5 * STEP
    border = scipy.ndimage.binary_dilation(chart) & ~chart
    assert np.isin(residual[border], residual[chart]).mean() > 0.95  # padded


@pytest.mark.parametrize("way", ["scan", "residual"])
def test_packages_have_the_residual(traced: Traced, tmp_path: Path, way: str) -> None:
    given: tuple[object, ...] = ("--scan", traced.scan, "--scale", RANGE, "--resolution", SIDE)
    if way == "residual":
        files = "graph.safetensors", "residual.<UDIM>.exr"
        given = "--graph", traced.out / files[0], "--residual", traced.out / files[1]
    out = tmp_path / "skin"
    exported = ["export", out, "--mesh", traced.mesh, "--levels", 1, *given]
    assert main([*map(str, exported)]) == 0
    manifest = json.loads((out / "manifest.json").read_text())
    assert (manifest["version"], manifest["resolution"]) == (3, SIDE)
    assert manifest["residual"]["step"] < 2 * STEP


def test_grown_skin_fills_in_what_is_masked_out(
    traced: Traced, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """On the left; on the right, from the border on, residual and neutral are the scan."""
    mask, settings, out = tmp_path / "mask.png", tmp_path / "given.json", tmp_path / "traced"
    grey = np.repeat(np.arange(SIDE) > 0.4 * SIDE, SIDE).reshape(SIDE, SIDE).T
    Image.fromarray((255 * grey).astype(np.uint8)).save(mask)
    settings.write_text(json.dumps({"graph": {"spacing": 1.0, "events": 0.0}}))
    given = (traced.mesh, traced.scan, "--scale", RANGE, "--out", out, "--settings", settings)
    assert trace(*given, "--scan-mask", mask, "--fill", 1000) == 1
    assert "1000 mesh units wide" in capsys.readouterr().err
    assert not list(out.glob("*"))
    assert trace(*given, "--scan-mask", mask, "--fill", 0.5) == 0
    kept = json.loads((out / "settings.json").read_text())["shape"]
    assert (kept["grain"], kept["undulation"]) == (0.02, 0.18)
    # `bake --graph` grows nothing, and would warn of settings by which skin grows.
    assert json.loads((out / "settings.json").read_text())["graph"] == {"spacing": 1.0}
    found = neutral_map(traced.mesh, out, tmp_path / "maps")
    found = found + read_exr(out / "residual.1001.exr")[0]
    with Image.open(traced.scan) as image:
        off = np.abs(found - (np.asarray(image, np.float64) / 65535 - 0.5) * RANGE)
    chart = inside(traced.mesh)
    assert off[:, 160:][chart[:, 160:]].max() < 0.5 * STEP
    assert np.median(off[:, :90][chart[:, :90]]) > 100 * STEP


def test_told_where_skin_has_nothing_to_fill(
    traced: Traced, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is the scan without grown lines, and without grain."""
    out = tmp_path / "traced"
    given = (traced.mesh, traced.scan, "--scale", RANGE, "--out", out, "--fill", 0.5)
    assert trace(*given) == 0
    assert "scan-fill: UDIM 1001: skin is to fill in" in capsys.readouterr().err
    for file in ("graph.safetensors", "settings.json"):
        assert (out / file).read_bytes() == (traced.out / file).read_bytes()
    found = neutral_map(traced.mesh, out, tmp_path) + read_exr(out / "residual.1001.exr")[0]
    with Image.open(traced.scan) as image:
        off = np.abs(found - (np.asarray(image, np.float64) / 65535 - 0.5) * RANGE)
    assert off[inside(traced.mesh)].max() < 0.5 * STEP
    baked = ["bake", traced.mesh, "--scan", traced.scan, "--scale", RANGE, "--fill", 0.5]
    baked += ["--method", "neutral", "--out", tmp_path / "scan", "--store", tmp_path / "store"]
    assert main([*map(str, baked), "--strict", "--allow", "mesh-size"]) == 1
    assert "scan-fill: UDIM 1001: skin is to fill in" in capsys.readouterr().err


def test_a_mask_without_a_place_is_told_how_masks_are_named(tmp_path: Path) -> None:
    file = tmp_path / "left.png"
    Image.fromarray(np.zeros((4, 4), np.uint8)).save(file)
    with pytest.raises(InputError, match=r"left\.png names no UDIM.*as in mask\.1001\.png"):
        mask_files([file], sheet(udims=2))


def test_one_name_stands_for_the_painted_maps_of_all_udims(tmp_path: Path) -> None:
    mesh, every = sheet(udims=2), tmp_path / "m.<UDIM>.png"
    files = [tmp_path / f"m.{udim}.png" for udim in (1001, 1002)]
    for file, grey in zip(files, GREYS.values(), strict=True):
        Image.new("L", (4, 4), grey).save(file)
    for named in ([every], files):
        assert {udim: map[0, 0] for udim, map in mask_files(named, mesh).items()} == GREYS
        stiffness, controls = stiffness_files(named, mesh), control_files({"turn": named}, mesh)
        assert stiffness is not None
        assert controls is not None
        for maps in (stiffness.maps, controls.maps["turn"]):
            assert {udim: map[0, 0] for udim, map in maps.items()} == GREYS
    with pytest.raises(InputError, match=r"other\.<UDIM>\.png: there is no such file for any UDIM"):
        mask_files([tmp_path / "other.<UDIM>.png"], mesh)


@pytest.mark.parametrize("way", ["scan", "residual"])
def test_baked_maps_are_the_scan_at_rest(
    traced: Traced, tmp_path: Path, way: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """In one command, and from the files of `trace`: within half a step of 16 bits."""
    given: tuple[object, ...] = ("--scan", traced.scan, "--scale", RANGE)
    if way == "residual":
        files = "graph.safetensors", "residual.<UDIM>.exr"
        given = "--graph", traced.out / files[0], "--residual", traced.out / files[1]
    baked = ["bake", traced.mesh, "--out", tmp_path, *given]
    assert main([*map(str, baked)]) == 0
    [file] = tmp_path.glob("*.exr")
    with Image.open(traced.scan) as image:
        scan = (np.asarray(image, np.float64) / 65535 - 0.5) * RANGE
    off = np.abs(read_exr(file)[0] - scan)[inside(traced.mesh)]
    assert off.max() < 0.5 * STEP
    assert main([*map(str, baked)]) == 0
    assert "1 already there" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (("--scan", "a.png", "--graph", "g"), "--scan is traced to a graph, --graph gives one"),
        (("--residual", "a.exr"), "--residual is what a traced graph does not draw: give --graph"),
        (("--scan", "a.png", "--set", "age=60"), "--scan gives lines that are traced: use one"),
        (("--fill", "2"), "--fill says how to read displacement: give --scan, too"),
        (("--scale", "2"), "--scale says how to read displacement: give --scan, too"),
    ],
)
def test_options_that_do_not_fit_are_refused(
    traced: Traced, tmp_path: Path, given: tuple[str, ...], said: str,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    words = [str(traced.scan) if word in ("a.png", "a.exr", "g") else word for word in given]
    with pytest.raises(SystemExit):
        main(["bake", str(traced.mesh), "--out", str(tmp_path), *words])
    assert said in " ".join(capsys.readouterr().err.split())


def test_a_residual_of_codes_is_refused(traced: Traced, tmp_path: Path) -> None:
    given = ["bake", traced.mesh, "--out", tmp_path, "--graph", traced.out / "graph.safetensors"]
    assert main([*map(str, given), "--residual", str(traced.scan)]) != 0


def test_what_is_of_another_mesh_or_scan_is_told_before_anything_is_built(
    traced: Traced, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    """A frame with other vertices; a residual ten times as deep as skin can be."""
    monkeypatch.setattr("rhytid.engine.engine.open_device", lambda *_: pytest.fail("it opened"))
    frame, deep = tmp_path / "frame.obj", tmp_path / "deep.exr"
    frame.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    deep.write_bytes(exr(np.linspace(0, 5, SIDE * SIDE, dtype=np.float32).reshape(SIDE, SIDE)))
    bake = ["bake", traced.mesh, "--out", tmp_path / "maps"]
    skins = ["--scan", traced.scan, "--scale", RANGE], ["--spacing", 1]
    for skin in skins:
        assert main([*map(str, [*bake, *skin, "--frames", frame])]) == 1
        assert "frame has 3 vertices, the neutral mesh has" in capsys.readouterr().err
    files = "--graph", traced.out / "graph.safetensors", "--residual", deep, "--strict"
    given = [*files, "--settings", traced.out / "settings.json", "--unit", "cm"]
    assert main([*map(str, [*bake, *given])]) == 1
    assert "scan-depth: residual, UDIM 1001: 95 % of it is 48 mm deep" in capsys.readouterr().err


@cache
def inside(mesh: Path) -> NDArray[np.bool_]:
    """(SIDE, SIDE) whether the middle of a texel lies in a triangle."""
    with np.load(mesh) as arrays:
        read = Mesh(*(arrays[name] for name in ("positions", "faces", "uv", "face_uv")))
    x, y = np.meshgrid(np.arange(SIDE) + 0.5, SIDE - 0.5 - np.arange(SIDE))
    found = np.zeros((SIDE, SIDE), bool)
    for first, b, c in local_edges(read, 1001) * SIDE:
        near = texels_around(first + np.array([np.zeros(2), b, c]))
        area = b[0] * c[1] - b[1] * c[0]
        u = ((x[near] - first[0]) * c[1] - (y[near] - first[1]) * c[0]) / area
        v = ((y[near] - first[1]) * b[0] - (x[near] - first[0]) * b[1]) / area
        found[near] |= (u >= 0) & (v >= 0) & (u + v <= 1)
    return found


def texels_around(corners: NDArray[np.float64]) -> tuple[slice, slice]:
    """The rows and columns of the box of a triangle, and one more on each side."""
    (left, low), (right, high) = corners.min(axis=0), corners.max(axis=0)
    spans = (SIDE - high, SIDE - low), (left, right)
    rows, columns = (slice(max(int(a) - 1, 0), int(b) + 2) for a, b in spans)
    return rows, columns


def test_lengths_are_printed_in_millimetres(
    traced: Traced, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = (traced.mesh, traced.scan, "--scale", RANGE, "--unit", "5.5cm")
    assert trace(*given, "--out", tmp_path, "--json", tmp_path / "told.json") == 0
    depth = json.loads((tmp_path / "told.json").read_text())["depth"]
    printed = capsys.readouterr().out
    assert f"a line of weight 1 is {55 * depth:.3g} mm deep" in printed
    assert "relief, mm" in printed


def test_progress_is_told(traced: Traced) -> None:
    for stage in ("lines", "fit", "seams", "residual"):
        assert f"tracing: {stage}, after" in traced.said


def test_each_udim_has_a_residual_and_settings_are_handed_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh, out = two_squares(tmp_path / "two.npz"), tmp_path / "my out"
    waves = 0.01 * np.sin(np.arange(256) / 3.0)[:, None] * np.ones((1, 256))
    for udim, height in ((1001, 1.0), (1002, 0.5)):
        file = tmp_path / f"d.{udim}.exr"
        file.write_bytes(exr((height * waves).astype(np.float32)))
    told, settings = tmp_path / "told.json", tmp_path / "own.json"
    settings.write_text('{"depth": 0.02, "unit": "mm", "shape": {"taper": 0.5}}')
    given = (mesh, tmp_path / "d.<UDIM>.exr", "--settings", settings)
    assert trace(*given, "--out", out, "--json", told) == 0
    printed = capsys.readouterr().out
    assert {f.name for f in out.iterdir()} == FILES | {"residual.1002.exr"}
    command = shlex.split(printed.partition("the lines move with: ")[2])
    residual = str(out / "residual.<UDIM>.exr")
    assert command[command.index("--residual") + 1] == residual
    assert f"'{residual}'" in printed  # a shell would read <UDIM> as a file for its input
    first, second = json.loads(told.read_text())["udims"]
    assert (first["udim"], second["udim"]) == (1001, 1002)
    assert first["relief"] == pytest.approx(2 * second["relief"], rel=1e-4)
    written = json.loads((out / "settings.json").read_text())
    assert written["shape"] == {"taper": 0.5, "grain": 0.0, "undulation": 0.0}
    assert (written["unit"], written["resolution"]) == ("mm", SIDE)
    origin = read_graph((out / "graph.safetensors").read_bytes()).origin
    assert origin is not None
    assert (origin.depth, origin.unit, origin.spacing) == (0.02, "mm", 0.5)


def test_lines_that_reach_into_a_udim_without_a_map_are_taken_away_there(tmp_path: Path) -> None:
    mesh, out, maps = tmp_path / "sheet.npz", tmp_path / "out", tmp_path / "maps"
    wide = sheet(udims=2)
    np.savez(
        mesh, positions=wide.positions, faces=wide.faces, uv=wide.uv, face_uv=wide.face_uv,
        frames=wide.positions[None],
    )  # fmt: skip
    waves = 0.01 * np.sin(np.arange(SIDE) / 3.0)[:, None] * np.ones((1, SIDE))
    scan = tmp_path / "d.1001.exr"
    scan.write_bytes(exr(waves.astype(np.float32)))
    told = tmp_path / "told.json"
    assert trace(mesh, scan, "--partial", "--out", out, "--json", told) == 0
    assert (out / "residual.1002.exr").is_file()
    graph, counted = (
        read_graph((out / "graph.safetensors").read_bytes()),
        json.loads(told.read_text()),
    )
    assert (counted["pores"], counted["wrinkles"]) == graph.counts()
    assert counted["wrinkles"] < graph.wrinkles  # copies over the seam are the same lines
    files = "--graph", out / "graph.safetensors", "--residual", out / "residual.<UDIM>.exr"
    settings = "--settings", out / "settings.json"
    baked = ["bake", mesh, "--out", maps, "--method", "neutral", *files, *settings]
    assert main([*map(str, baked)]) == 0
    [smooth] = maps.glob("*.1002.*.exr")
    assert np.abs(read_exr(smooth)[0]).max() < 1e-6


def two_squares(file: Path) -> Path:
    """Side by side, a UDIM each."""
    square = np.array([[0.05, 0.05], [0.95, 0.05], [0.95, 0.95], [0.05, 0.95]])
    uv = np.concatenate([square, square + np.array([1, 0])])
    points = np.pad(uv * 4, ((0, 0), (0, 1))).astype(np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]], np.int32)
    np.savez(file, **SmallMesh(points, faces, uv, faces)._asdict())
    return file


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ([], "has codes, which have no length of their own: --scale, the length"),
        (["--scale", "1", "--resolution", "300"], "resolution"),
        (["--scale", "0.02", "--settings", "furlong.json"], "has no known length"),
        (["--scale", "90", "--strict"], "--strict"),
        (["--scale", "1", "--settings", "wrong.json"], "depth"),
    ],
)
def test_bad_input_is_refused_before_a_device_opens(
    traced: Traced,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    options: list[str],
    said: str,
) -> None:
    monkeypatch.setattr("rhytid.engine.engine.open_device", lambda *_: pytest.fail("it opened"))
    monkeypatch.chdir(tmp_path)
    Path("furlong.json").write_text('{"unit": "furlong"}')
    Path("wrong.json").write_text('{"depth": -1}')
    assert trace(traced.mesh, traced.scan, *options, "--out", "out") == 1
    assert said in capsys.readouterr().err
    assert not Path("out").exists()


def test_a_scan_without_relief_is_refused(
    traced: Traced, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flat = tmp_path / "flat.exr"
    flat.write_bytes(exr(np.full((16, 16), 0.5, np.float32)))
    assert trace(traced.mesh, flat, "--out", tmp_path / "out") == 1
    assert "there is no relief in the scan" in capsys.readouterr().err


@pytest.mark.parametrize("place", ["rhytid.tracing.trace.fitted", "rhytid.cli.trace._draw"])
def test_an_interrupted_trace_leaves_nothing(
    traced: Traced, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: str
) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(place, interrupt)
    out = tmp_path / "out"
    assert trace(traced.mesh, traced.scan, "--scale", RANGE, "--out", out) == 130
    assert list(out.iterdir()) == []
