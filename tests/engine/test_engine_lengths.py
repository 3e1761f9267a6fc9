"""One graph has one depth by every road, and says it in its file; spacing is a length on skin."""

from __future__ import annotations

import json
from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
from PIL import Image
from scipy.spatial import cKDTree

from engine.engines import BINNED, CONVOLVED, REDRAW, built, maps, new_asset, running, same, settle
from rhytid.cli import main
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import GraphOrigin, WrinkleGraph
from rhytid.domain.graph_geometry import surface_points
from rhytid.domain.mesh import Mesh
from rhytid.domain.painted_maps import Controls
from rhytid.domain.patch_noise import LONGEST
from rhytid.domain.skin import depth_factor
from rhytid.engine.messages import NewAsset
from rhytid.errors import GraphError, LimitError, SettingsError
from rhytid.exports.textures.frame_map import Padding
from rhytid.formats.exr import read_exr
from rhytid.formats.graphs import read_graph, write_graph
from rhytid.storage.canonical import canonical
from rhytid.storage.records import StoredAsset
from rhytid.storage.store import AssetStore
from rhytid.synthesis.pore_density import EDGES_PER_PORE, PACKING, SPACING
from synthesis import sheets

# Each spacing would have kernels of its own.
pytestmark = pytest.mark.usefixtures("no_maps_ahead")

# 4 cm a side: 9,700 wrinkles where pores are half a millimetre apart.
MESH = sheets.sheet(scale=4.0)
SIZE = {"resolution": 512, "tile_size": 256}
SPARSE = {**SIZE, "graph": {"spacing": 0.2}}
WHITE = Controls({"density": {1001: np.ones((8, 8), np.float32)}})


@pytest.fixture(scope="module")
def engine(tmp_path_factory):
    with running(tmp_path_factory.mktemp("store")) as engine:
        yield engine


def grown(engine, mesh=MESH, controls=None, **settings):
    return built(engine, NewAsset(mesh, AssetSettings.parse(settings), controls=controls))


def lengths(engine, asset):
    settings = engine.assets.info(asset).settings
    return settings["depth"], settings["convolve"]["sigma"], settings["shape"]["wave_frequency"]


def apart(mesh: Mesh, graph: WrinkleGraph) -> float:
    """Mean distance of the pores that are drawn to the nearest."""
    shown = graph.pore_weight > 0
    assert graph.node_triangle is not None
    places = surface_points(mesh, graph.node_uv[shown], graph.node_triangle[shown])
    return float(cKDTree(places).query(places, k=2)[0][:, 1].mean())


@pytest.mark.slow
def test_the_deepest_lines_of_the_old_are_deeper_and_stay_so(tmp_path):
    graph = SPARSE["graph"]
    with running(tmp_path) as engine:
        young = grown(engine, **SPARSE)
        old = grown(engine, **SIZE, graph={**graph, "age": 65})
        assert lengths(engine, young)[0] == pytest.approx(0.15 * 0.2)
        assert lengths(engine, old)[0] == pytest.approx(depth_factor(65.0) * 0.15 * 0.2)
        assert engine.assets.graph(old).origin.depth == lengths(engine, old)[0]
        # Set explicitly, it is that; null is that of the age again, after a restart, too.
        engine.assets.change(old, {"depth": 0.01})
        assert lengths(engine, old)[0] == 0.01
    with running(tmp_path) as engine:
        settle(engine, old)
        engine.assets.change(old, {"depth": None})
        assert lengths(engine, old)[0] == pytest.approx(depth_factor(65.0) * 0.15 * 0.2)


@pytest.mark.slow
@pytest.mark.parametrize("controls", [None, WHITE], ids=["even", "painted"])
def test_a_graph_that_is_sent_back_is_drawn_as_before(engine, controls):
    first = grown(engine, controls=controls, **SPARSE)
    assert lengths(engine, first)[0] == pytest.approx(0.15 * 0.2)
    data = write_graph(engine.assets.graph(first))
    sent = NewAsset(MESH, AssetSettings.parse(SIZE), read_graph(data))
    second = built(engine, sent)
    assert second != first
    assert lengths(engine, second) == lengths(engine, first)
    for query in (REDRAW, CONVOLVED, BINNED):
        one, two = (
            engine.tiles.plan_map(id, "neutral", query, 1001, 0).draw() for id in (first, second)
        )
        assert same([one], [two])
    assert read_graph(write_graph(engine.assets.graph(second))).origin == read_graph(data).origin


RELIEF = {"graph": {"spacing": 0.3, "seed": 7}, "shape": {"grain_size": 0.1}}


@pytest.mark.slow
@pytest.mark.parametrize(
    "more",
    [
        {},
        {"unit": "ell", "shape": {"undulation_size": 0.9}},
        {"graph": {"spacing": 0.3, "seed": 7, "age": 60, "region": "cheek", "strength": 2.0}},
    ],
    ids=["usual", "no-unit-of-length", "old"],
)
def test_a_graph_alone_draws_the_relief_that_it_was_drawn_with(engine, more):
    """Grain and undulation, which no array of it holds: another seed was 0.29 of depth apart."""
    first = grown(engine, **SIZE, **{**RELIEF, **more})
    graph = read_graph(write_graph(engine.assets.graph(first)))
    second = built(engine, NewAsset(MESH, AssetSettings.parse(SIZE), graph))
    for preset in ("best", "paper"):
        for asset in (first, second):
            engine.assets.change(asset, {"preset": preset})
            engine.frames.put(asset, "smile", bent())
        one, two = (both(engine, asset) for asset in (first, second))
        assert same(one, two)


def test_waves_of_patches_are_those_of_the_lines_where_the_unit_is_unknown(engine):
    """A broader undulation, and a count in place of the spacing, change no patches."""
    skin = {"patches": 1.0, "wrinkles": 900, "seed": 7}
    first = grown(engine, **SIZE, unit="ell", graph=skin)
    graph = read_graph(write_graph(engine.assets.graph(first)))
    even = SPACING * np.sqrt(PACKING * 16.0 * EDGES_PER_PORE / 900)
    assert graph.origin.patch_size == pytest.approx(LONGEST.of_spacing * even, rel=0.01)
    engine.assets.change(first, {"shape": {"undulation_size": 0.9}})
    settle(engine, first)
    assert engine.assets.graph(first).origin.patch_size == graph.origin.patch_size
    second = built(engine, NewAsset(MESH, AssetSettings.parse(SIZE), graph))
    assert engine.assets.graph(second).origin.patch_size == graph.origin.patch_size
    assert engine.assets.graph(grown(engine, **SPARSE)).origin.patch_size is None


def bent():
    x, y, z = MESH.positions.astype(np.float64).T
    return np.stack([x * (1 + 0.1 * np.sin(y)), y, z + 0.2 * np.sin(2 * x)], axis=-1)


def both(engine, asset):
    return maps(engine, asset, "neutral") + maps(engine, asset, "smile")


def test_settings_go_before_the_relief_of_a_file(engine):
    graph = engine.assets.graph(grown(engine, **SIZE, **RELIEF))
    assert (graph.origin.seed, graph.origin.grain_size) == (7, 0.1)
    told = {"graph": {"seed": 1}, "shape": {"grain_size": 0.05}}
    asset = built(engine, NewAsset(MESH, AssetSettings.parse({**SIZE, **told}), graph))
    settings = engine.assets.info(asset).settings
    assert (settings["graph"]["seed"], settings["shape"]["grain_size"]) == (1, 0.05)
    engine.assets.change(asset, {"shape": {"grain_size": None}})
    assert engine.assets.info(asset).settings["shape"]["grain_size"] == 0.1
    # A file of before says neither: it has the usual ones, and the asset that it had.
    before = replace(graph, origin=replace(graph.origin, seed=None, grain_size=None))
    made = [
        built(engine, NewAsset(MESH, AssetSettings.parse({**SIZE, **said}), before))
        for said in ({}, {"graph": {"seed": 1}})
    ]
    assert made[0] == made[1]
    settings = engine.assets.info(made[0]).settings
    assert (settings["graph"]["seed"], settings["shape"]["grain_size"]) == (1, 0.02)


@pytest.mark.slow
def test_the_command_line_and_the_service_take_the_same_depth(engine, tmp_path, capsys):
    """Painted four times as dense: the pores alone would say half the depth."""
    mesh, out = tmp_path / "mesh.npz", tmp_path / "g.safetensors"
    arrays = {name: getattr(MESH, name) for name in ("positions", "faces", "uv", "face_uv")}
    np.savez(mesh, **arrays, frames=MESH.positions[None])
    grey = tmp_path / "density.1001.png"
    grey.write_bytes(white_png())
    given = ["synthesize", str(mesh), "--out", str(out), "--spacing", "0.2", "--seed", "7"]
    assert main([*given, "--map", f"density={grey}", "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["depth"] == pytest.approx(0.15 * 0.2)
    assert main(["graph", str(mesh), str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["depth"] == figures["depth"]
    served = built(engine, NewAsset(MESH, AssetSettings.parse(SIZE), read_graph(out.read_bytes())))
    assert lengths(engine, served) == lengths(engine, grown(engine, controls=WHITE, **SPARSE))
    assert engine.assets.info(served).settings["graph"]["seed"] == 7
    bake = ["bake", "--mesh", str(mesh), "--out", str(tmp_path / "maps"), "--graph", str(out)]
    assert main([*bake, "--resolution", "512"]) == 0
    baked = read_exr(tmp_path / "maps" / "mesh.1001.0001.exr")[0]
    drawn = engine.tiles.plan_map(served, "neutral", REDRAW, 1001, 0).draw()
    # Files are padded beside the charts.
    padding = Padding.of(MESH, 1001, engine.tiles.triangles(served, 1001), 16)
    assert np.abs(baked - padding.padded(drawn)).max() < 1e-5 * 0.03


def white_png():
    file = BytesIO()
    Image.fromarray(np.full((8, 8), 255, np.uint8)).save(file, format="png")
    return file.getvalue()


@pytest.mark.parametrize("controls", [None, WHITE], ids=["even", "painted"])
def test_the_spacing_told_is_that_of_the_pores(engine, controls):
    asset = grown(engine, controls=controls, **SPARSE)
    graph, told = engine.assets.graph(asset), engine.assets.info(asset).statistics
    found = apart(MESH, graph)
    assert told["distance"] == pytest.approx(found, rel=1e-4)
    assert found == pytest.approx(0.2 if controls is None else 0.1, rel=0.02)
    assert told["spacing"] == graph.origin.spacing == pytest.approx(0.2)


@pytest.mark.parametrize("controls", [None, WHITE], ids=["even", "painted"])
@pytest.mark.parametrize("grown_by", [{"wrinkles": 900}, {"spacing": 0.2, "density": 4.0}], ids=str)
def test_one_graph_has_one_spacing_by_every_way(engine, tmp_path, capsys, controls, grown_by):
    """In its file, in what is told of it, of it sent back and at another size, and in its depth."""
    first = grown(engine, controls=controls, **SIZE, graph=grown_by)
    file = tmp_path / "g.safetensors"
    file.write_bytes(write_graph(engine.assets.graph(first)))
    sent = NewAsset(MESH, AssetSettings.parse(SIZE), read_graph(file.read_bytes()))
    second, third = built(engine, sent), engine.assets.resized(first, 256)
    settle(engine, third.id)
    wanted = engine.assets.graph(first).origin.spacing
    for asset in (first, second, third.id):
        assert engine.assets.info(asset).statistics["spacing"] == wanted
        assert engine.assets.graph(asset).origin.spacing == wanted
        engine.assets.change(asset, {"depth": None})
        assert lengths(engine, asset)[0] == 0.15 * wanted
    mesh = tmp_path / "mesh.npz"
    np.savez(mesh, **{n: getattr(MESH, n) for n in ("positions", "faces", "uv", "face_uv")})
    assert main(["graph", str(mesh), str(file), "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["spacing"] == wanted
    assert figures["depth"] == 0.15 * wanted


def test_the_density_of_the_settings_brings_pores_nearer_and_makes_them_shallower(engine):
    """As it does where the number is given."""
    asset = grown(engine, **SIZE, graph={"spacing": 0.2, "density": 4.0})
    assert engine.assets.info(asset).statistics["distance"] == pytest.approx(0.1, rel=0.02)
    assert lengths(engine, asset)[0] == pytest.approx(0.15 * 0.1)


@pytest.mark.slow
def test_the_same_skin_in_another_unit(engine):
    """40 mm are 4 cm: the same pores, and depths that are the same length."""
    even = {**SIZE, "graph": {"patches": 0.0}}
    centimetres = grown(engine, **even)
    scaled = replace(MESH, positions=MESH.positions * 10)
    millimetres = grown(engine, scaled, unit="mm", **even)
    one, two = (engine.assets.info(id) for id in (centimetres, millimetres))
    assert one.wrinkles == two.wrinkles
    assert one.statistics["distance"] == pytest.approx(0.05, rel=0.01)
    assert two.statistics["distance"] == pytest.approx(0.5, rel=0.01)
    assert one.settings["depth"] == pytest.approx(0.0075)
    assert two.settings["depth"] == pytest.approx(0.075)


def test_a_graph_in_millimetres_is_converted_to_the_unit_of_the_mesh(engine):
    large = replace(MESH, positions=MESH.positions * 10)
    asset = grown(engine, large, unit="mm", **SIZE, graph={"spacing": 2.0})
    graph = engine.assets.graph(asset)
    assert graph.origin.unit == "mm"
    told = AssetSettings.parse({**SIZE, "unit": "cm"})
    assert lengths(engine, built(engine, NewAsset(MESH, told, graph))) == pytest.approx(
        (0.03, 0.05, 2.0)
    )
    untold = built(engine, NewAsset(MESH, AssetSettings.parse(SIZE), graph))
    assert engine.assets.info(untold).settings["unit"] == "mm"
    assert lengths(engine, untold) == pytest.approx((0.3, 0.5, 0.2))
    odd = AssetSettings.parse({**SIZE, "unit": "furlong"})
    with pytest.raises(SettingsError, match="graph is in 'mm' and the mesh in 'furlong'"):
        engine.assets.create(NewAsset(MESH, odd, graph))


def test_explicit_settings_go_before_the_file_and_null_is_the_file_again(engine):
    first = grown(engine, **SPARSE, depth=0.07)
    assert engine.assets.graph(first).origin.depth == 0.07
    graph = engine.assets.graph(first)
    second = built(engine, NewAsset(MESH, AssetSettings.parse({**SIZE, "depth": 0.01}), graph))
    assert lengths(engine, second)[0] == 0.01
    engine.assets.change(second, {"depth": None})
    assert lengths(engine, second)[0] == 0.07
    engine.assets.change(second, {"depth": 0.02})
    assert engine.assets.graph(second).origin.depth == 0.02
    engine.assets.change(first, {"depth": None})
    assert lengths(engine, first)[0] == pytest.approx(0.03)


@pytest.mark.slow
def test_a_graph_of_another_mesh_is_refused_unless_forced(engine):
    graph = engine.assets.graph(grown(engine, **SPARSE))
    other = sheets.sheet(lambda xy: 0.1 + 0.7 * xy, scale=4.0)
    new = NewAsset(other, AssetSettings.parse(SIZE), graph)
    with pytest.raises(GraphError, match=r"made for another mesh.*--force"):
        engine.assets.create(new)
    forced = built(engine, replace(new, force=True))
    assert engine.assets.graph(forced).origin == GraphOrigin.of(
        other, "cm", AssetSettings.parse(engine.assets.info(forced).settings).lengths(0.2), 1
    )
    moved = replace(MESH, positions=MESH.positions[:, [1, 0, 2]])  # another head of one topology
    assert built(engine, NewAsset(moved, AssetSettings.parse(SIZE), graph))


@pytest.mark.slow
def test_lengths_survive_a_restart_and_null_means_the_same_after_it(tmp_path):
    with running(tmp_path) as engine:
        first = grown(engine, controls=WHITE, **SPARSE)
        graph = replace(engine.assets.graph(first), origin=GraphOrigin(depth=0.05, unit="cm"))
        second = built(engine, NewAsset(MESH, AssetSettings.parse(SIZE), graph))
        before = [
            (engine.assets.info(id).settings, engine.assets.info(id).statistics)
            for id in (first, second)
        ]
    with running(tmp_path) as engine:
        for id, wanted in zip((first, second), before, strict=True):
            settle(engine, id)
            assert told(engine, id) == wanted
            engine.assets.change(id, {"depth": 0.9})
            engine.assets.change(id, {"depth": None})
            assert told(engine, id) == wanted


def told(engine, asset):
    info = engine.assets.info(asset)
    return info.settings, info.statistics


@pytest.mark.slow
def test_an_asset_of_an_earlier_version_is_read_and_told_truly(tmp_path, monkeypatch):
    """It kept one spacing, that which depth came from, and its settings knew no other."""
    with running(tmp_path) as engine:
        asset = built(engine, new_asset(depth=None))
        before = engine.assets.info(asset)
    monkeypatch.setattr(StoredAsset, "files", files_of_earlier)
    with AssetStore(tmp_path) as store:
        kept = store.asset(asset)
        store.delete(asset)
        store.put_asset(asset, kept.mesh, kept.graph, kept.settings, {"spacing": 0.25})
    with running(tmp_path) as engine:
        settle(engine, asset)
        found = engine.assets.info(asset)
        assert found.settings["depth"] == before.settings["depth"]
        assert found.statistics == {**before.statistics, "spacing": 0.25}
        engine.assets.change(asset, {"depth": 0.5})
        engine.assets.change(asset, {"depth": None})
        assert engine.assets.info(asset).settings["depth"] == pytest.approx(0.15 * 0.25)


def files_of_earlier(stored, files=StoredAsset.files):
    settings = stored.settings.as_json()
    del settings["graph"]["spacing"]
    settings["graph"]["wrinkles"] = 300_000
    facts = canonical({"settings": settings, "extra": stored.extra})
    return {**files(stored), "facts.json": facts}


def test_too_many_or_too_few_for_the_spacing_are_refused_with_one_that_fits(engine):
    wide = sheets.sheet(scale=1000.0)
    with pytest.raises(LimitError, match=r"graph.spacing is 0.05 .*can hold (\S+) or more") as told:
        engine.assets.create(NewAsset(wide, AssetSettings.parse(SIZE)))
    assert 0.1 < float(str(told.value).split("can hold ")[1].split()[0]) < 1.0
    tiny = sheets.sheet(scale=0.1)
    with pytest.raises(Exception, match=r"at least 100, graph.spacing of (\S+) or less") as told:
        engine.assets.create(NewAsset(tiny, AssetSettings.parse(SIZE)))
    fit = float(str(told.value).split("graph.spacing of ")[1].split()[0])
    # So small a mesh is all one patch of skin, with fewer pores or more.
    made = grown(engine, tiny, **SIZE, graph={"spacing": fit, "patches": 0.0})
    # The area tells so small a number to a tenth: where exactly pores find room decides.
    assert engine.assets.info(made).wrinkles == pytest.approx(100, rel=0.1)
