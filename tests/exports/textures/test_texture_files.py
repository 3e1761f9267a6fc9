"""Files of every profile, read back by OpenImageIO."""

from __future__ import annotations

import json
import tracemalloc
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from exports.textures.patches import all_triangles, curved, grid_mesh
from exports.textures.reading import Texture, read_texture
from rhytid.baking.output import BakeSize, Output, mesh_facts
from rhytid.domain.mesh import Mesh
from rhytid.errors import InputError, QueryError
from rhytid.exports.textures import COMPRESSIONS, PROFILE_NAMES, writers
from rhytid.exports.textures import frame_map as frame_maps
from rhytid.exports.textures.frame_map import (
    Chart,
    FrameMap,
    Padding,
    VertexField,
    _nearest_inside,
    local_edges,
    texels_inside,
)
from rhytid.exports.textures.profiles import PROFILES, profiles_of
from rhytid.exports.textures.stretch import stretch_map
from rhytid.exports.textures.tangents import Posed
from rhytid.formats import exr_encoder, png
from rhytid.formats.tile_header import TileHeader

SIDE, DEPTH, SCALE, PADDED = 128, 0.01, 0.04, 8
HEADER = TileHeader("cm", "0007", "a1b2", "redraw", "tensor", "nearest", 1002, 0, 0, 0, SCALE)
MESH = grid_mesh(curved, 4)
HEIGHTS = np.random.default_rng(3).uniform(-0.03, 0.02, (SIDE, SIDE)).astype(np.float32)
STRETCH = np.random.default_rng(6).uniform(-0.5, 0.5, (len(MESH.positions), 7))
MOMENTS = (
    np.random.default_rng(7).uniform(0, 0.5, (SIDE // 4, SIDE // 4, 5)).astype(np.float32),
    np.ones((SIDE // 4, SIDE // 4), np.float32),
)
WEIGHTS = np.random.default_rng(4).uniform(0, 1, (len(MESH.faces), 3, 2))


@pytest.fixture(scope="module")
def drawn() -> FrameMap:
    return frame_map(MESH, all_triangles(MESH, SIDE))


def codes_of_normals(inside: NDArray[np.bool_], green: int) -> NDArray[np.uint16]:
    """Of unit vectors, green against v where it is -1; straight outside."""
    vectors = np.random.default_rng(8).normal((0.0, 0.0, 1.0), (0.3, 0.3, 0.0), (*inside.shape, 3))
    vectors[~inside] = 0.0, 0.0, 1.0
    vectors /= np.linalg.norm(vectors, axis=-1, keepdims=True)
    return ((vectors * [1, green, 1] * 0.5 + 0.5) * 65535 + 0.5).astype(np.uint16)


def frame_map(mesh: Mesh, triangles: NDArray[np.int32]) -> FrameMap:
    """HEIGHTS on a mesh, whose texels show these triangles."""
    chart = Chart.of(mesh, 1001, triangles)
    padding = Padding.of(mesh, 1001, triangles, PADDED)
    posed = Posed.of(mesh, mesh.positions)
    found = lambda: padding, lambda: chart, lambda: posed, lambda: WEIGHTS
    stretch, blood = VertexField(STRETCH, mesh.faces), VertexField(STRETCH[:, :1], mesh.faces)
    fields = lambda: stretch, lambda: blood, {"fps": 25.0}
    heights = lambda: HEIGHTS, lambda: HEIGHTS
    made = lambda level: MOMENTS, partial(codes_of_normals, chart.inside)
    return FrameMap(HEADER, DEPTH, *heights, *found, *fields, *made)


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


@pytest.mark.parametrize("compression", ["zip", "none", "piz"])
def test_half_floats_that_are_drawn_as_such_are_the_same_file(
    compression: str, drawn: FrameMap, tmp_path: Path
) -> None:
    profile, files = PROFILES["half"].compressed(compression), []
    for texels in (HEIGHTS, HEIGHTS.astype(np.float16)):
        files.append(tmp_path / f"{texels.dtype}.exr")
        profile.write(files[-1], replace(drawn, halves=lambda found=texels: found), {})
    assert files[0].read_bytes() == files[1].read_bytes()


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

    # OpenImageIO takes a PNG file that says nothing for sRGB.
    assert found.attributes["oiio:ColorSpace"].startswith("lin_")
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


@pytest.mark.parametrize(("name", "green"), [("normal-gl", 1), ("normal-dx", -1)])
def test_green_is_up_in_gl(name: str, green: int, drawn: FrameMap, tmp_path: Path) -> None:
    found = written(name, drawn, tmp_path)

    wanted = drawn.normals(green)
    drawn.padding().fill(wanted)
    np.testing.assert_array_equal(found.texels, wanted)
    assert number(found, "maximum") == pytest.approx(wanted.max() / 65535 * 2 - 1)


def test_cavity_is_what_lies_below_its_surroundings(drawn: FrameMap, tmp_path: Path) -> None:
    heights = np.full((SIDE, SIDE), -0.5, np.float32)
    heights[40, 40] = -0.5 - 0.5 * DEPTH
    heights[80, 80] = -0.5 - 5 * DEPTH
    heights[100, 20] = -0.5 + 5 * DEPTH
    dented = replace(drawn, heights=lambda: heights)

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


def test_stretch_has_three_signed_channels_by_name(drawn: FrameMap, tmp_path: Path) -> None:
    found = written("stretch", drawn, tmp_path)

    assert found.channels == ("R", "G", "B")
    wanted = stretch_map(drawn.chart(), drawn.posed(), drawn.stretch()).astype(np.float16)
    np.testing.assert_array_equal(found.texels, wanted, strict=True)
    assert (number(found, "minimum"), number(found, "maximum")) == (wanted.min(), wanted.max())
    # As a copy for another frame has it, whose bytes are not encoded again.
    file = next(tmp_path.iterdir())
    file.write_bytes(b"".join(exr_encoder.renamed(file.read_bytes(), "frame", "000012")))
    again = read_texture(file)
    assert again.attributes["frame"] == "000012"
    np.testing.assert_array_equal(again.texels, wanted)


def test_blood_is_in_the_middle_at_rest(drawn: FrameMap, tmp_path: Path) -> None:
    """And black where the area is half, white where it is double."""
    late = np.log([[1.0], [0.5], [2.0], [0.25]])
    shown = []
    for one in late:
        field = VertexField(np.repeat(one[None], len(MESH.positions), axis=0), MESH.faces)
        found = written("blood", replace(drawn, blood=lambda field=field: field), tmp_path)
        shown.append(np.unique(found.texels).tolist())
        next(tmp_path.iterdir()).unlink()
    assert shown == [[32768], [1], [65535], [0]]


def test_png_has_its_facts_in_a_file_beside_it(drawn: FrameMap, tmp_path: Path) -> None:
    output = Output(tmp_path, "face", profiles_of(["png16", "float", "normal-dx"]))
    output.describe(drawn, lambda: mesh_facts(MESH))

    assert {file.name for file in tmp_path.iterdir()} == {"face.png16.json", "face.normal-dx.json"}
    told = json.loads((tmp_path / "face.png16.json").read_text())
    assert told["files"] == "face.png16.<UDIM>.<FRAME>.png"
    assert (told["scale"], told["midlevel"], told["unit"]) == (SCALE, 32768 / 65535, "cm")
    assert (told["vertices"], told["triangles"]) == (len(MESH.positions), len(MESH.faces))
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

    monkeypatch.setattr(writers.importlib, "import_module", absent)
    assert profiles_of(["float", "weights"])
    with pytest.raises(InputError, match=r"in a clone of rhytid: pip install '\.\[tx\]'"):
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
    part = frame_map(MESH, triangles)
    texels: dict[str, NDArray[Any]] = {}
    for name in ("normal-gl", "cavity", "weights"):
        (tmp_path / name).mkdir()
        texels[name] = written(name, part, tmp_path / name).texels

    beyond = np.s_[:, SIDE // 2 :]
    assert (texels["normal-gl"][beyond] == [32768, 32768, 65535]).all()
    assert (texels["cavity"][beyond] == 255).all()
    assert texels["weights"][beyond][..., :2].min() > 0


def third() -> tuple[FrameMap, int]:
    """A map whose first columns alone are inside, and the last of them; padding follows."""
    uv = MESH.uv * (1 / 3, 1.0)
    mesh = Mesh(MESH.positions, MESH.faces, uv, MESH.face_uv)
    triangles = all_triangles(mesh, SIDE)
    last = int(np.flatnonzero((triangles < len(mesh.faces)).all(axis=0)).max())
    triangles[:, last + 1 : last + 1 + PADDED] = triangles[:, last, None]
    part = frame_map(mesh, triangles)
    inside = part.chart().inside
    assert inside[:, : last + 1].all()
    assert not inside[:, last + 1 :].any()
    return part, last


@pytest.mark.parametrize("name", ["float", "half", "png16", "mip", "tx"])
def test_displacement_is_padded_in_every_profile(name: str, tmp_path: Path) -> None:
    """Within the padding it is what the nearest column inside has."""
    part, last = third()
    texels = written(name, part, tmp_path).texels[..., 0].astype(np.float64)
    heights = (texels - 32768) / 32767 * SCALE if name == "png16" else texels

    edge = HEIGHTS[:, last, None]
    within = heights[:, last + 1 : last + 1 + PADDED]
    assert np.abs(within - edge).max() < 2e-5
    np.testing.assert_allclose(heights[:, : last + 1], HEIGHTS[:, : last + 1], atol=2e-5)
    if name in ("float", "half"):
        beyond = np.s_[:, last + 1 + PADDED :]
        np.testing.assert_allclose(heights[beyond], HEIGHTS[beyond], atol=2e-5)


def test_some_texels_of_a_map_have_the_sources_that_all_have() -> None:
    part, _ = third()
    padding, every = part.padding(), np.arange(SIDE * SIDE, dtype=np.int32)
    some = np.random.default_rng(1).permutation(every).reshape(4, -1)
    padded = padding.padded(HEIGHTS).reshape(-1)

    assert (padding.sources_of(every) != every).sum() == len(padding.texels) > 0
    np.testing.assert_array_equal(HEIGHTS.reshape(-1)[padding.sources_of(some)], padded[some])
    none = Padding(np.zeros(0, np.int32), np.zeros(0, np.int32))
    np.testing.assert_array_equal(none.sources_of(some), some)


def test_padding_is_found_in_parts_of_a_map(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same texels, whatever the number of texels that are searched at once."""
    mesh = grid_mesh(curved, 3)
    slanting = np.array([[0.5, 0.2], [-0.2, 0.5]])
    mesh = Mesh(mesh.positions, mesh.faces, mesh.uv @ slanting + (0.25, 0.2), mesh.face_uv)
    triangles = all_triangles(mesh, SIDE)
    shown = triangles < len(mesh.faces)
    near = ndimage.distance_transform_edt(~shown, return_indices=True)
    padded = np.where(near[0] <= PADDED, triangles[tuple(near[1])], len(mesh.faces))
    whole = Padding.of(mesh, 1001, padded.astype(np.int32), PADDED)
    monkeypatch.setattr("rhytid.exports.textures.frame_map._BLOCK", 10)
    parts = Padding.of(mesh, 1001, padded.astype(np.int32), PADDED)

    assert len(whole.texels) == ((near[0] > 0) & (near[0] <= PADDED)).sum() > 500
    np.testing.assert_array_equal(whole.texels, parts.texels)
    for found in (whole, parts):
        away = [np.stack(np.divmod(n, SIDE)) for n in (found.texels, found.sources)]
        np.testing.assert_allclose(
            np.hypot(*(away[0] - away[1])), near[0].reshape(-1)[found.texels], atol=1e-12
        )


def test_displacement_goes_on_outside_of_islands(tmp_path: Path) -> None:
    """Two thirds of a map are outside, padding or not, and have what the nearest column inside has,
    in every level; the same in normals and cavity within the padding."""
    part, last = third()
    within = np.s_[:, last + 1 : last + 1 + PADDED]

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
        assert (texels[:, last + 1 + PADDED :] == texels[0, -1]).all()


def part_of(name: str, drawn: FrameMap, folder: Path, level: int = 0) -> NDArray[Any]:
    """Texels of a file in a folder of its own."""
    own = folder / f"{name}{level}"
    own.mkdir()
    return written(name, drawn, own, level).texels


def test_a_first_triangle_without_area_in_uv_takes_part_in_nothing() -> None:
    flat = np.zeros((1, 3), MESH.face_uv.dtype)
    mesh = Mesh(
        MESH.positions,
        np.concatenate([MESH.faces[:1], MESH.faces]),
        MESH.uv,
        np.concatenate([flat, MESH.face_uv]),
    )
    shown = all_triangles(MESH, SIDE)
    texels = np.where(shown < len(MESH.faces), shown + 1, len(mesh.faces)).astype(np.int32)

    found = Padding.of(mesh, 1001, texels, PADDED)

    wanted = Padding.of(MESH, 1001, shown, PADDED)
    np.testing.assert_array_equal(found.texels, wanted.texels)
    np.testing.assert_array_equal(found.sources, wanted.sources)


@pytest.mark.parametrize("seed", range(6))
def test_nearest_texels_are_found_in_blocks(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Within reach as in the whole map; what has none within reach takes one of its rows, or is
    left out where they have none."""
    monkeypatch.setattr("rhytid.exports.textures.frame_map._BLOCK", 16)
    random, side, reach = np.random.default_rng(seed), 96, 5
    inside = random.random((side, side)) < (0.002 if seed % 2 else 0.05)
    inside[:40] = False
    outside = ~inside & (random.random((side, side)) < 0.7)

    texels, sources = _nearest_inside(outside, inside, reach)

    assert (np.diff(texels) > 0).all()
    assert outside.reshape(-1)[texels].all()
    assert inside.reshape(-1)[sources].all()
    least = ndimage.distance_transform_edt(~inside)
    for top in range(0, side, 16):  # of the rows around a block, where there are any
        rows = slice(max(top - reach, 0), top + 16 + reach)
        if inside[rows].any():
            around = ndimage.distance_transform_edt(~inside[rows])
            least[top : top + 16] = around[top - rows.start : top - rows.start + 16]
    found = np.hypot(*(np.stack(np.divmod(texels, side)) - np.stack(np.divmod(sources, side))))
    np.testing.assert_allclose(found, least.reshape(-1)[texels])
    assert set(np.flatnonzero(outside & (least <= reach))) <= set(texels)
    assert not len(texels) or texels.min() >= 16 * side  # rows that have one only far below


def test_whether_texels_are_inside_is_that_of_each_texel() -> None:
    """Texels of one triangle in a row are decided by the first and the last of them."""
    triangles = np.random.default_rng(3).integers(0, len(MESH.faces), (SIDE, SIDE // 8))
    mixed = np.repeat(triangles, 8, axis=1).astype(np.int32)
    edges = local_edges(MESH, 1001)
    for given in (mixed, np.minimum(all_triangles(MESH, SIDE), len(MESH.faces) - 1)):
        first, along, across = np.moveaxis(edges[given], 2, 0)
        column, row = np.meshgrid(np.arange(SIDE) + 0.5, np.arange(SIDE) + 0.5)
        place = np.stack([column / SIDE, 1 - row / SIDE], axis=-1) - first
        area = along[..., 0] * across[..., 1] - along[..., 1] * across[..., 0]
        second = (place[..., 0] * across[..., 1] - place[..., 1] * across[..., 0]) / area
        third_ = (place[..., 1] * along[..., 0] - place[..., 0] * along[..., 1]) / area
        wanted = np.minimum(1 - second - third_, np.minimum(second, third_)) >= -1e-4
        np.testing.assert_array_equal(texels_inside(given, edges), wanted)


_PACKED = [(name, one) for name in ("float", "half") for one in COMPRESSIONS if one != "zip"]


@pytest.mark.parametrize(
    ("name", "compression"), [*((name, "zip") for name in PROFILE_NAMES), *_PACKED]
)
def test_a_file_takes_no_more_memory_than_told(
    name: str, compression: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    side, strip = 512, 1 << 12  # so that strips are as small beside it as they are beside 4096²
    for module, size in ((frame_maps, "_TEXELS"), (exr_encoder, "_STRIP"), (png, "_STRIP")):
        monkeypatch.setattr(module, size, strip)
    noise = np.random.default_rng(5).uniform(-0.03, 0.02, (side, side)).astype(np.float32)
    codes = codes_of_normals(np.ones((side, side), np.bool_), 1)
    first, drawn = (
        replace(
            frame_map(MESH, all_triangles(MESH, side)),
            heights=lambda: noise,
            halves=lambda: noise,
            normals=lambda green: codes.copy(),
        )
        for _ in range(2)
    )
    profile = PROFILES[name].compressed(compression)
    facts = profile.all_facts(drawn)
    # What the first file of a process imports is no memory of a file.
    profile.write(tmp_path / f"first{profile.extension}", first, facts)

    tracemalloc.start()
    try:
        profile.write(tmp_path / f"map{profile.extension}", drawn, facts)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()

    assert peak <= profile.working_bytes * side**2
