"""What is in a skin package."""

from __future__ import annotations

import json
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

import rhytid_viewer
from exports.skin_package.conftest import Written
from exports.skin_package.ktx2 import Texture, read_ktx2
from pipeline.scenes import settings_of
from rhytid.domain.tiles import TileAddress
from rhytid.errors import LimitError, SettingsError
from rhytid.exports.skin_package import cushion_lines, package, texture_arrays
from rhytid.exports.skin_package.cushion_lines import used_lines
from rhytid.exports.skin_package.manifest import Manifest, schema
from rhytid.exports.skin_package.maps import SkinMaps, check_settings
from rhytid.exports.skin_package.package import PackageWriter
from rhytid.exports.skin_package.runtime import stretch
from rhytid.exports.skin_package.texture_arrays import Paging, SetFiles, in_sets, pyramid
from rhytid.formats.gltf import read_glb_shapes
from rhytid.formats.ktx2 import ktx2_pieces
from rhytid.pipeline.cushion import SAMPLES
from rhytid.pipeline.elements import LineSources


def texture(written: Written, name: str) -> Texture:
    return read_ktx2(written.folder / "textures" / f"{name}.1001.ktx2")


def of_sets(written: Written, name: str, level: int = 0) -> NDArray[np.int8]:
    """(N S, n, n) the codes that the numbers of a texture stand for."""
    codes = texture(written, f"{name}_codes").levels[0]
    numbers = texture(written, name).levels[level]
    found: NDArray[np.int8] = codes.reshape(len(codes), -1)[:, numbers].swapaxes(0, 1)
    return found.reshape(-1, *numbers.shape[1:])


def manifest(written: Written) -> Manifest:
    return Manifest.model_validate_json((written.folder / "manifest.json").read_bytes())


def test_the_manifest_fits_its_schema_and_names_every_file(written: Written) -> None:
    found = manifest(written)
    shaders = [
        f
        for s in found.shaders.values()
        for f in (*s.libraries.values(), s.vertex, *s.passes.values(), *s.moments.values())
    ]
    assert found.cushion is not None
    assert found.stretch.folds is not None
    cushion, wrinkles = found.cushion, found.wrinkles
    arrays = [
        found.textures, found.triangles, wrinkles.textures, wrinkles.codes,
        cushion.textures, cushion.owners, cushion.lines,
    ]  # fmt: skip
    named = {
        "manifest.json", "manifest.schema.json", found.mesh.file, found.stretch.rest,
        found.stretch.python, found.stretch.javascript, *shaders,
        found.stretch.folds.python, found.stretch.folds.javascript,
        *found.stretch.compute.values(),
        found.materialx.document, *found.materialx.implementations.values(),
        *(file for array in arrays for file in array.files.values()), *rhytid_viewer.laid_out(),
    }  # fmt: skip
    there = {str(f.relative_to(written.folder)) for f in written.folder.rglob("*") if f.is_file()}

    assert there == named
    assert json.loads((written.folder / "manifest.schema.json").read_bytes()) == schema()


def test_texture_bytes_are_those_of_the_files(written: Written) -> None:
    files = [read_ktx2(file) for file in (written.folder / "textures").iterdir()]
    sizes = [[level.nbytes for level in file.levels] for file in files]

    assert manifest(written).texture_bytes == sum(map(sum, sizes))
    assert manifest(written).texture_bytes_of_level_0 == sum(size[0] for size in sizes)


def test_level_0_has_the_codes_of_the_maps(written: Written) -> None:
    found, bins = texture(written, "maps").levels[0], of_sets(written, "wrinkles")
    tiles = written.engine.tiles
    for layer in manifest(written).layers:
        for n in range(layer.bins):
            for sample in range(len(layer.samples)):
                maps = bins if layer.name == "wrinkles" else found
                at = layer.first + n * len(layer.samples) + sample
                for row, column in ((0, 0), (1, 0)):
                    address = TileAddress(1001, 0, row, column)
                    codes = tiles.bin_tile(written.asset, address, layer.name, n, sample)
                    square = maps[at, 128 * row :, 128 * column :][:128, :128]
                    assert np.array_equal(square, np.maximum(codes, -127)), layer.name
    assert len(found) == manifest(written).textures.maps == 10
    assert len(bins) == 12


def test_cushions_have_their_apron(written: Written) -> None:
    found, cushion = texture(written, "cushions").levels[0], manifest(written).cushion
    assert cushion is not None
    address = TileAddress(1001, 0, 0, 1)
    row, column = (128 * at // cushion.factor for at in (0, 1))
    for at, (layer, sample) in enumerate(
        [*(("cushions", m) for m in range(SAMPLES)), ("cushion_places", 0)]
    ):
        codes = written.engine.tiles.bin_tile(written.asset, address, layer, 0, sample)
        assert np.array_equal(found[at, row:, column:][: len(codes), : len(codes)], codes)
    assert found.shape[1] == 256 // cushion.factor + 2 * cushion.apron
    assert texture(written, "cushion_owners").levels[0].shape == (1, *found.shape[1:])


def test_owners_name_the_lines_that_they_are(written: Written) -> None:
    owners = texture(written, "cushion_owners").levels[0][0].astype(int)
    table = texture(written, "cushion_lines").levels[0].reshape(4, -1).astype(np.int64)
    lines, cushion = (
        written.engine.tiles.cushion_lines(written.asset, 1001),
        manifest(written).cushion,
    )
    assert cushion is not None
    factor = cushion.factor
    rows = np.full(owners.shape, -1)
    for row, column in ((0, 0), (0, 1), (1, 0), (1, 1)):
        address = TileAddress(1001, 0, row, column)
        codes = written.engine.tiles.bin_tile(written.asset, address, "cushion_owners")
        y, x = (128 * at // factor for at in (row, column))
        rows[y : y + len(codes), x : x + len(codes)] = codes
    owned = rows >= 0
    of = np.argsort(lines.rows)[np.searchsorted(np.sort(lines.rows), rows[owned])]
    code = table[1][owners[owned]]
    directions = (np.stack([code & 65535, code >> 16], axis=1) - 32768) / 32767

    assert owned.mean() > 0.5
    assert not owned.all()
    assert np.array_equal(table[0][owners[owned]], lines.triangle[of])
    assert np.abs(directions - lines.directions[of]).max() <= 0.5 / 32767 + 1e-9
    assert len(np.unique(owners[~owned])) == 1
    assert table[0][owners[~owned][0]] == len(written.mesh.faces)


def test_lines_that_continue_one_another_find_each_other() -> None:
    lines = LineSources(
        rows=np.arange(10, 15, dtype=np.int32),
        triangle=np.arange(5, dtype=np.int32),
        directions=np.tile([0.6, -0.8], (5, 1)),
        partners=np.array([[-1, 3], [-1, -1], [0, -1], [1, -1], [-1, 2]], np.int32),
    )
    numbers, table = used_lines(np.array([[13, -1], [10, 13]]), lines, 7)

    assert numbers.tolist() == [[2, 3], [0, 2]]  # of 10, 11 and 13, then of none
    assert table[0].tolist() == [0, 1, 3, 7]
    assert table[2:, :3].tolist() == [[0, 0, 2], [3, 0, 0]]
    assert table[2:, 3].tolist() == [0, 0]


def test_too_many_owners_are_refused_with_the_tile_that_has_them(
    written: Written, monkeypatch: pytest.MonkeyPatch
) -> None:
    maps = SkinMaps.of(written.engine, written.asset)
    first, other = (TileAddress(1001, 0, 0, column) for column in (0, 1))
    codes = written.engine.tiles.bin_tile(written.asset, first, "cushion_owners")
    owned = len(np.unique(codes[codes >= 0]))
    monkeypatch.setattr(cushion_lines, "MOST_SIDE", 1)
    monkeypatch.setattr(cushion_lines, "LINES_A_ROW", owned + 1)
    made = maps.empty(1001)
    maps.fill(made, first)
    maps.fill(made, first)
    with pytest.raises(LimitError, match=f"more than a texture holds, {owned}"):
        maps.fill(made, other)


def test_the_arrays_of_lines_take_what_is_counted() -> None:
    count = 200_000
    rows = np.arange(count, dtype=np.int32)
    owners = np.resize(rows, (1, 512, 512))
    tracemalloc.start()
    along, partners = np.tile([0.6, -0.8], (count, 1)), np.stack([rows - 1, rows - 2], axis=1)
    lines = LineSources(rows, rows.copy(), along, np.maximum(partners, -1))
    used_lines(owners, lines, 7)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < cushion_lines.LINE_BYTES * count + 25 * owners.size


def test_coarser_levels_are_rounded_means(written: Written) -> None:
    levels = texture(written, "maps").levels
    bins = [of_sets(written, "wrinkles", n) for n in range(9)]
    levels = [np.concatenate(pair) for pair in zip(levels, bins, strict=True)]
    for n in (1, 4, 8):
        side = 256 >> n
        means = levels[0].reshape(-1, side, 1 << n, side, 1 << n).mean(axis=(2, 4))
        assert np.abs(levels[n] - means).max() <= 0.5 + 1e-5
    assert len(levels) == 9


def test_triangles_are_those_of_the_texels(written: Written) -> None:
    found = texture(written, "triangles")

    assert found.format == 74
    assert np.array_equal(found.levels[0][0], written.engine.tiles.triangles(written.asset, 1001))


def test_files_say_what_they_are(written: Written) -> None:
    found = texture(written, "maps")

    assert found.keys == {"KTXorientation": "rd", "KTXwriter": "rhytid"}
    assert found.channel == (0x40, -127, 127)  # signed red


def test_the_mesh_loads_with_its_seams_split(written: Written) -> None:
    loaded = trimesh.load(written.folder / "skin.glb", process=False, force="mesh")
    found = manifest(written)
    source = loaded.vertex_attributes["_VERTEX"].astype(int).reshape(-1)
    assert found.unit_in_metres is not None
    positions = np.asarray(loaded.vertices) / found.unit_in_metres

    assert np.array_equal(source[: found.mesh.vertices], np.arange(found.mesh.vertices))
    assert len(source) > found.mesh.vertices == len(written.mesh.positions)
    assert np.allclose(positions, written.mesh.positions[source], atol=1e-6)
    assert np.array_equal(source[loaded.faces], written.mesh.faces)
    uv = np.asarray(loaded.visual.uv)[loaded.faces]
    assert np.allclose(uv, written.mesh.triangle_uv(), atol=1e-6)


def test_shapes_are_morph_targets_by_name(written: Written) -> None:
    mesh, shapes = read_glb_shapes((written.folder / "skin.glb").read_bytes())
    assert shapes is not None
    count = len(written.mesh.positions)

    assert shapes.names == ("smile", "frown") == tuple(manifest(written).mesh.shapes)
    assert np.allclose(shapes.positions[:, :count], written.shapes.positions, atol=1e-6)
    assert np.array_equal(mesh.positions[:count], written.mesh.positions)


def test_rest_is_that_of_the_mesh(written: Written) -> None:
    found, mesh = stretch.read_rest(written.folder / "triangles.bin"), written.mesh

    assert found.shape == (len(mesh.faces), 8)
    assert np.array_equal(found, stretch.rest_of(mesh.positions, mesh.faces, mesh.triangle_uv()))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"bins": {"merge": "mellow"}}, "bins.merge is mellow"),
        ({"bins": {"bits": 16}}, "bins.bits is 16"),
        ({"angles": "surface"}, "angles is surface"),
    ],
)
def test_settings_that_the_shader_does_not_know_are_refused(changes: object, said: str) -> None:
    with pytest.raises(SettingsError, match=said):
        check_settings(settings_of(**changes))  # type: ignore[arg-type]


def test_maps_that_webgl_has_no_layers_for_are_refused() -> None:
    assert Paging.of(4096, 64).count == 4
    with pytest.raises(LimitError, match=r"65 maps .* are 260 layers of 2048; WebGL2 has 256"):
        Paging.of(4096, 65)
    check_settings(settings_of(preset="best", resolution=8192))
    with pytest.raises(LimitError, match="10 maps of 16384"):
        check_settings(settings_of(preset="best", resolution=16384))


def test_pages_are_cut_row_by_row() -> None:
    maps = np.arange(2 * 8 * 8).reshape(2, 8, 8).astype(np.int8)
    pages = Paging(8, 4).cut(maps)

    assert pages.shape == (8, 4, 4)
    for at, page in enumerate(pages):
        row, column = divmod(at // 2, 2)
        assert np.array_equal(page, maps[at % 2, 4 * row :, 4 * column :][:4, :4])


@pytest.mark.parametrize("samples", [3, 5])
def test_sets_are_the_codes_that_occur(samples: int) -> None:
    levels = [
        np.random.default_rng(side).integers(-128, 128, (2 * samples, side, side), np.int8)
        for side in (40, 20)
    ]
    numbers, codes = in_sets(levels, samples)

    assert codes.shape == (samples, 4, 1024)
    assert max(int(number.max()) for number in numbers) < 2 * (40**2 + 20**2)
    for number, level in zip(numbers, levels, strict=True):
        found = codes.reshape(samples, -1)[:, number].swapaxes(0, 1)
        assert np.array_equal(found.reshape(level.shape), level)


def test_more_sets_than_a_texture_holds_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(texture_arrays, "MOST_ROWS", 1)
    level = np.random.default_rng(1).integers(-128, 128, (3, 40, 40), np.int8)
    with pytest.raises(LimitError, match="sets of codes are more than a texture holds, 1024"):
        in_sets([level], 3)


@pytest.mark.parametrize("table", [1 << 10, 1 << 23])
def test_sets_are_numbered_in_order_whatever_a_table_holds(
    table: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(texture_arrays, "TABLE", table)
    monkeypatch.setattr(texture_arrays, "STRIP", 1000)
    level = np.random.default_rng(2).integers(-20, 20, (8, 60, 60), np.int8)
    (numbers,), codes = in_sets([level], 4)
    rows = level.reshape(2, 4, -1).swapaxes(1, 2).reshape(-1, 4)
    wanted, places = np.unique(rows.view(np.uint8), axis=0, return_inverse=True)

    assert np.array_equal(codes.reshape(4, -1)[:, : len(wanted)].T.view(np.uint8), wanted)
    assert np.array_equal(numbers.reshape(-1), places.reshape(-1))


def test_sets_take_little_memory() -> None:
    level = np.random.default_rng(4).integers(-128, 128, (4, 1024, 1024), np.int8)
    tracemalloc.start()
    _, codes = in_sets([level], 4)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert codes.size > 3 << 20
    assert most < 10 * level.nbytes
    assert most < 4 * 1024**2 + texture_arrays.BESIDE


@pytest.mark.parametrize("levels", [1, None])
def test_a_package_takes_the_memory_that_it_says(
    levels: int | None, written: Written, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(package, "BESIDE", 1 << 20)  # few sets occur here
    maps, peaks = SkinMaps.of(written.engine, written.asset), []
    for name in ("one", "two", "three"):  # threads of other tests can only add to it
        (tmp_path / name).mkdir()
        writer = PackageWriter(maps, written.mesh, written.shapes, tmp_path / name, levels)
        tracemalloc.start()
        for step in writer.steps():
            step()
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert min(peaks) < writer.host_bytes < 2 * min(peaks)


def test_levels_of_an_array_are_aligned(tmp_path: Path) -> None:
    levels = pyramid(np.arange(3 * 4 * 4).reshape(3, 4, 4).astype(np.int8), 3)
    file = tmp_path / "a.ktx2"
    file.write_bytes(b"".join(ktx2_pieces("r8snorm", (3, 4, 4), levels)))

    for found, level in zip(read_ktx2(file).levels, levels, strict=True):
        assert np.array_equal(found, level)


def test_udims_with_fewer_sets_take_fewer_bytes(tmp_path: Path) -> None:
    (tmp_path / "textures").mkdir()
    files = SetFiles(tmp_path / "textures", "wrinkles", 1, 3)
    random = np.random.default_rng(3)
    few, many = (random.integers(-most, most, (3, 512, 512), np.int8) for most in (2, 100))
    files.write(1001, [many])
    files.write(1002, [few])
    numbers, codes = files.manifest_entry()

    assert numbers.format == "R32_UINT"
    assert [read_ktx2(tmp_path / numbers.files[udim]).format for udim in ("1001", "1002")] == [
        98,
        74,
    ]
    for udim, maps in (("1001", many), ("1002", few)):
        found = read_ktx2(tmp_path / codes.files[udim]).levels[0].reshape(3, -1)
        assert np.array_equal(
            found[:, read_ktx2(tmp_path / numbers.files[udim]).levels[0][0]], maps
        )
    assert numbers.bytes == 6 * 512**2
