"""Files of every profile, read back by OpenImageIO."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from rhytid.cli.bake_output import BakeSize, Output
from rhytid.domain.mesh import Mesh
from rhytid.errors import InputError, QueryError
from rhytid.formats.tile_header import TileHeader
from rhytid.textures import tiled
from rhytid.textures.chart import Chart
from rhytid.textures.frame_map import FrameMap
from rhytid.textures.names import PROFILE_NAMES
from rhytid.textures.profiles import PROFILES, profiles_of
from rhytid.textures.tangents import Posed
from textures.patches import all_triangles, curved, grid_mesh
from textures.reading import Texture, read_texture

SIDE, DEPTH, SCALE = 128, 0.01, 0.04
HEADER = TileHeader("cm", "0007", "a1b2", "redraw", "tensor", "nearest", 1002, 0, 0, 0, SCALE)
MESH = grid_mesh(curved, 4)
HEIGHTS = np.random.default_rng(3).uniform(-0.03, 0.02, (SIDE, SIDE)).astype(np.float32)
WEIGHTS = np.random.default_rng(4).uniform(0, 1, (len(MESH.faces), 3, 2))


@pytest.fixture(scope="module")
def drawn() -> FrameMap:
    chart = Chart.of(MESH, 1001, all_triangles(MESH, SIDE))
    posed = Posed.of(MESH, MESH.positions)
    return FrameMap(HEADER, DEPTH, lambda: HEIGHTS, lambda: chart, lambda: posed, lambda: WEIGHTS)


def written(name: str, drawn: FrameMap, folder: Path, level: int = 0) -> Texture:
    profile = PROFILES[name]
    file = folder / profile.file_name("face", 1002, "0007")
    profile.write(file, drawn, profile.all_facts(drawn))
    assert [left.name for left in folder.iterdir()] == [file.name]
    return read_texture(file, level)


def number(texture: Texture, name: str) -> float:
    return float(texture.attributes[name])


@pytest.mark.parametrize("name", PROFILE_NAMES)
def test_every_file_says_what_it_is(name: str, drawn: FrameMap, tmp_path: Path) -> None:
    found = written(name, drawn, tmp_path)

    told = {
        key: str(found.attributes[key]) for key in ("unit", "frame", "asset", "udim", "profile")
    }
    assert told == {
        "unit": "cm", "frame": "0007", "asset": "a1b2", "udim": "1002", "profile": name,
    }  # fmt: skip
    assert found.attributes["rhytid_version"] == "0.1.0"
    assert found.attributes["colour_space"] == "raw"
    assert {"scale", "midlevel"} <= set(found.attributes)
    assert number(found, "minimum") < number(found, "maximum")


@pytest.mark.parametrize(("name", "kind"), [("float", np.float32), ("half", np.float16)])
def test_floats_are_displacement_itself(
    name: str, kind: Any, drawn: FrameMap, tmp_path: Path
) -> None:
    found = written(name, drawn, tmp_path)

    assert found.channels == ("Y",)
    np.testing.assert_array_equal(found.texels[..., 0], HEIGHTS.astype(kind), strict=True)
    assert found.attributes["oiio:ColorSpace"] == "data"
    assert number(found, "minimum") == HEIGHTS.astype(kind).min()


@pytest.mark.parametrize("name", ["mip", "tx"])
def test_tiled_files_have_every_level_as_means(name: str, drawn: FrameMap, tmp_path: Path) -> None:
    found = written(name, drawn, tmp_path)

    assert found.channels == ("Y",)
    assert found.levels == [(SIDE >> level, 64) for level in range(8)]
    file = next(tmp_path.iterdir())
    for level in range(8):
        blocks = HEIGHTS.astype(np.float64).reshape(SIDE >> level, 1 << level, SIDE >> level, -1)
        wanted = blocks.mean(axis=(1, 3))
        texels = read_texture(file, level).texels[..., 0]
        np.testing.assert_allclose(texels, wanted, rtol=0, atol=1e-8)
    np.testing.assert_array_equal(found.texels[..., 0], HEIGHTS)
    assert found.attributes["textureformat"] == "Plain Texture"


def test_png16_gives_displacement_back(drawn: FrameMap, tmp_path: Path) -> None:
    found = written("png16", drawn, tmp_path)

    assert found.texels.dtype == np.uint16
    codes = found.texels[..., 0].astype(np.float64)
    heights = (codes - 32768) / 32767 * number(found, "scale")
    assert np.abs(heights - HEIGHTS).max() <= SCALE / 32767 / 2 * 1.001
    # What a program does that has 0 to 1 for black to white.
    shown = (codes / 65535 - number(found, "midlevel")) * number(found, "range")
    assert np.abs(shown - HEIGHTS).max() <= SCALE / 32767 / 2 * 1.001


def test_normals_of_both_kinds_differ_in_green_alone(drawn: FrameMap, tmp_path: Path) -> None:
    for name in ("gl", "dx"):
        (tmp_path / name).mkdir()
    gl = written("normal-gl", drawn, tmp_path / "gl").texels.astype(np.int64)
    dx = written("normal-dx", drawn, tmp_path / "dx").texels.astype(np.int64)

    np.testing.assert_array_equal(gl[..., ::2], dx[..., ::2])
    assert np.abs(gl[..., 1] + dx[..., 1] - 65535).max() <= 1
    assert np.ptp(gl[..., 1]) > 1000
    length = np.linalg.norm(gl / 65535 * 2 - 1, axis=-1)
    np.testing.assert_allclose(length, 1.0, atol=4e-5)


def test_green_is_up_in_gl(drawn: FrameMap, tmp_path: Path) -> None:
    """Where the surface rises with v, its normal leans to smaller v: green below the middle."""
    rising = np.linspace(0.3, 0.0, SIDE, dtype=np.float32)[:, None].repeat(SIDE, 1)
    flat = FrameMap(
        HEADER, DEPTH, lambda: rising, drawn.chart, drawn.posed, drawn.weights
    )  # fmt: skip
    found = written("normal-gl", flat, tmp_path)

    assert (found.texels[..., 1] < 32000).all()


def test_cavity_is_what_lies_below_its_surroundings(drawn: FrameMap, tmp_path: Path) -> None:
    heights = np.full((SIDE, SIDE), -0.5, np.float32)
    heights[40, 40] = -0.5 - 0.5 * DEPTH
    heights[80, 80] = -0.5 - 5 * DEPTH
    heights[100, 20] = -0.5 + 5 * DEPTH
    dented = FrameMap(HEADER, DEPTH, lambda: heights, drawn.chart, drawn.posed, drawn.weights)

    found = written("cavity", dented, tmp_path)

    texels = found.texels[..., 0]
    assert texels.dtype == np.uint8
    # Of a square of 3 x 3, one ninth of what is looked for is in the mean.
    assert texels[40, 40] == round(255 * (1 - 0.5 * 8 / 9))
    assert (texels[80, 80], texels[100, 20], texels[10, 10]) == (0, 255, 255)
    assert number(found, "scale") == DEPTH


def test_weights_are_those_of_the_corners(drawn: FrameMap, tmp_path: Path) -> None:
    found = written("weights", drawn, tmp_path)

    assert found.texels.dtype == np.uint8
    assert (found.texels[..., 2] == 0).all()
    triangles = drawn.chart().triangles
    low, high = WEIGHTS.min(axis=1)[triangles], WEIGHTS.max(axis=1)[triangles]
    shown = found.texels[..., :2] / 255
    assert ((shown > low - 0.003) & (shown < high + 0.003)).all()
    assert number(found, "scale") == np.log(2)


def test_png_has_its_facts_in_a_file_beside_it(drawn: FrameMap, tmp_path: Path) -> None:
    output = Output(tmp_path, "face", profiles_of(["png16", "float", "normal-dx"]))
    output.describe(drawn)

    assert {file.name for file in tmp_path.iterdir()} == {"face.png16.json", "face.normal-dx.json"}
    told = json.loads((tmp_path / "face.png16.json").read_text())
    assert told["files"] == "face.png16.<UDIM>.<FRAME>.png"
    assert (told["scale"], told["midlevel"], told["unit"]) == (SCALE, 32768 / 65535, "cm")
    assert json.loads((tmp_path / "face.normal-dx.json").read_text())["green"] == "down"


def test_names_are_those_of_the_table() -> None:
    assert tuple(PROFILES) == PROFILE_NAMES
    names = {name: PROFILES[name].file_name("n", 1002, "0007") for name in PROFILE_NAMES}
    assert names["float"] == names["half"] == "n.1002.0007.exr"
    assert names["tx"] == "n.1002.0007.tx"
    assert names["normal-gl"] == "n.normal-gl.1002.0007.png"
    assert names["weights"] == "n.weights.0007.1002.png"
    assert len(set(names.values())) == len(names) - 1


def test_profiles_that_cannot_be_written_together_or_at_all(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with pytest.raises(QueryError, match="float and half have the same file names"):
        profiles_of(["half", "float"])
    with pytest.raises(QueryError, match="one of float, half"):
        profiles_of(["jpeg"])

    def absent(name: str) -> Any:
        raise ImportError(name)

    monkeypatch.setattr(tiled.importlib, "import_module", absent)
    assert profiles_of(["float", "weights"])
    with pytest.raises(InputError, match=r"pip install 'rhytid\[tx\]'"):
        profiles_of(["tx"])


@pytest.mark.parametrize("name", PROFILE_NAMES)
def test_files_are_no_larger_than_told(name: str, drawn: FrameMap, tmp_path: Path) -> None:
    """But for their headers."""
    written(name, drawn, tmp_path)
    size = BakeSize.of(profiles_of([name]), SIDE, udims=2, frames=3)

    assert size.all == 3 * size.frame
    assert next(tmp_path.iterdir()).stat().st_size <= size.frame / 2 + 4096


def test_size_in_words() -> None:
    size = BakeSize.of(profiles_of(["float", "png16"]), 4096, udims=2, frames=50)
    assert size.text() == (
        "maps: up to 201 MB per frame, 10.1 GB for 50 frames, before compression"
    )


def test_beyond_the_padding_nothing_is_dark(tmp_path: Path, drawn: FrameMap) -> None:
    """Half of a map shows no triangle: it is flat, white, and weighted as the nearest texel that
    does."""
    triangles = all_triangles(MESH, SIDE)
    triangles[:, SIDE // 2 :] = len(MESH.faces)
    chart = Chart.of(MESH, 1001, triangles)
    part = FrameMap(HEADER, DEPTH, drawn.heights, lambda: chart, drawn.posed, drawn.weights)
    texels: dict[str, NDArray[Any]] = {}
    for name in ("normal-gl", "cavity", "weights"):
        (tmp_path / name).mkdir()
        texels[name] = written(name, part, tmp_path / name).texels

    beyond = np.s_[:, SIDE // 2 :]
    assert (texels["normal-gl"][beyond] == [32768, 32768, 65535]).all()
    assert (texels["cavity"][beyond] == 255).all()
    assert texels["weights"][beyond][..., :2].min() > 0


def test_displacement_goes_on_outside_of_islands(tmp_path: Path, drawn: FrameMap) -> None:
    """Two thirds of a map are outside, padding or not, and have what the nearest column inside has,
    in every level; the same in normals and cavity within the padding."""
    uv = MESH.uv * (1 / 3, 1.0)
    mesh = Mesh(MESH.positions, MESH.faces, uv, MESH.face_uv)
    triangles = all_triangles(mesh, SIDE)
    last = int(np.flatnonzero((triangles < len(mesh.faces)).all(axis=0)).max())
    within = np.s_[:, last + 1 : last + 9]
    triangles[within] = triangles[:, last, None]
    chart = Chart.of(mesh, 1001, triangles)
    posed = Posed.of(mesh, mesh.positions)
    part = FrameMap(HEADER, DEPTH, drawn.heights, lambda: chart, lambda: posed, drawn.weights)
    assert chart.inside[:, : last + 1].all()
    assert not chart.inside[:, last + 1 :].any()

    padded = HEIGHTS.copy()
    padded[:, last + 1 :] = HEIGHTS[:, last, None]
    for level in (0, 3):
        texels = part_of("mip", part, tmp_path, level)
        side = SIDE >> level
        wanted = padded.astype(np.float64).reshape(side, 1 << level, side, -1).mean(axis=(1, 3))
        np.testing.assert_allclose(texels[..., 0], wanted, rtol=0, atol=1e-8)
    codes = part_of("png16", part, tmp_path)[..., 0].astype(np.float64)
    assert np.abs((codes - 32768) / 32767 * SCALE - padded).max() < SCALE / 60000
    for name in ("normal-gl", "cavity"):
        texels = part_of(name, part, tmp_path)
        edge = texels[:, last, None]
        assert (texels[within] == edge).all()
        assert np.ptp(edge) > 100
        assert (texels[:, last + 9 :] == texels[0, -1]).all()


def part_of(name: str, drawn: FrameMap, folder: Path, level: int = 0) -> NDArray[Any]:
    """Texels of a file in a folder of its own."""
    own = folder / f"{name}{level}"
    own.mkdir()
    return written(name, drawn, own, level).texels
