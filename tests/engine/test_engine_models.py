"""Stretch models and merges through the engine: what a query names, and the maps it reads."""

from __future__ import annotations

from dataclasses import asdict, replace
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest

from engine.engines import BINNED, MIB, assembled, built, new_asset, running, same
from meshes import deform
from pipeline.scenes import DEPTH, Scene, random_graph, settings_of, sheet
from reference import drawing
from rhytid.domain.asset_settings import PRESETS
from rhytid.domain.methods import METHODS, STRETCH_MODELS
from rhytid.domain.tiles import TileAddress
from rhytid.engine.assets import builder
from rhytid.engine.frames import Frame
from rhytid.engine.messages import MapQuery, NewAsset
from rhytid.engine.tiles.service import displacement_scale
from rhytid.errors import NotFoundError, SettingsError

ROWS = [MapQuery(method, model) for method, model in product(METHODS, STRETCH_MODELS)]
ADDRESS = TileAddress(1001, 0, 1, 2)
PLACES = [(row, column) for row in range(4) for column in range(4)]
BENT = deform(sheet().positions, 3, 0.15)
MELLOW = {"merge": "mellow", "depth_factored": True}


def named(query):
    return f"{query.method}-{query.stretch}"


def test_every_model_has_a_key_and_a_map_of_its_own(made):
    for method in ("redraw", "binned"):
        queries = [MapQuery(method, model) for model in STRETCH_MODELS]
        keys = {made.engine.tiles.plan(made.asset, "bent", query, ADDRESS).key for query in queries}
        keys |= {
            made.engine.tiles.plan_map(made.asset, "bent", query, 1001, 0).key for query in queries
        }
        assert len(keys) == 2 * len(queries)
        maps = [
            made.engine.tiles.plan_map(made.asset, "bent", query, 1001, 0).draw()
            for query in queries
        ]
        for one, other in ((0, 1), (0, 2), (1, 2)):
            assert np.abs(maps[one] - maps[other]).max() > 0.05 * DEPTH


@pytest.mark.parametrize("query", ROWS, ids=named)
def test_tiles_of_every_row_are_the_map_and_those_of_positions_sent_along(made, query):
    whole = made.engine.tiles.plan_map(made.asset, "bent", query, 1002, 1).draw()
    assert same([whole], [assembled(made.engine, made.asset, "bent", query, 1002, 1)])
    positions = made.engine.frames.positions(made.asset, "bent")
    once = [made.engine.tiles.draw(made.asset, Frame.of(positions), query, ADDRESS).tile]
    assert same(once, [made.engine.tiles.plan(made.asset, "bent", query, ADDRESS).draw()])


@pytest.mark.parametrize("model", STRETCH_MODELS)
def test_the_neutral_is_unstretched_by_every_model(made, model):
    for method in ("redraw", "binned"):
        found = made.engine.tiles.plan_map(
            made.asset, "neutral", MapQuery(method, model), 1001, 0
        ).draw()
        plain = made.engine.tiles.plan_map(made.asset, "neutral", MapQuery(method), 1001, 0).draw()
        assert same([found], [plain])


@pytest.mark.parametrize("model", STRETCH_MODELS)
def test_redraw_by_a_model_is_that_of_double(made, device, model):
    positions = made.engine.frames.positions(made.asset, "bent")
    scene = Scene(device, sheet(udims=2), random_graph(1, span=2.0), settings_of())
    points = drawing.crop(64, 64, 64, 64, 256)
    wanted = scene.expected(points, positions, 1002, model).reshape(64, 64)
    found = made.engine.tiles.plan(
        made.asset, "bent", MapQuery("redraw", model), TileAddress(1002, 0, 1, 1)
    ).draw()
    assert np.abs(found - wanted).max() <= 1e-4 * DEPTH


def test_the_layers_of_a_mellow_merge_are_valleys_and_bulges(engine):
    asset = built(engine, new_asset(bins=MELLOW, shape={"pore_bulge": 4.0}))
    manifest = engine.tiles.bins(asset)
    assert manifest.layers == {"wrinkles": 4, "pores": 1, "wrinkle_bulges": 4, "pore_bulges": 1}
    assert (manifest.merge, manifest.depth_factored) == ("mellow", True)
    # With the depth factored out, the steps of every layer and sample are the same.
    assert manifest.steps.keys() == manifest.layers.keys()
    steps = np.array(list(manifest.steps.values()))
    np.testing.assert_allclose(steps, DEPTH * 1.2 / 127, rtol=1e-6)
    for layer, count in manifest.layers.items():
        sign = 1 if layer.endswith("bulges") else -1
        for bin, sample in product(range(count), range(3)):
            addresses = [TileAddress(1001, 0, row, column) for row, column in PLACES]
            codes = np.stack(
                [engine.tiles.bin_tile(asset, a, layer, bin, sample) for a in addresses]
            )
            assert (codes * sign >= 0).all(), layer
            assert (codes != 0).any(), layer
    for layer, bin in (("wrinkle_bulges", 4), ("pore_bulges", 1), ("bulges", 0)):
        with pytest.raises(NotFoundError, match=layer):
            engine.tiles.bin_tile(asset, ADDRESS, layer, bin, 0)


def test_tilts_are_a_layer_of_one_sample(engine):
    asset = built(engine, new_asset(bins={"depth_factored": True, "tilt": True, "samples": 5}))
    manifest = engine.tiles.bins(asset)
    assert manifest.layers == {"wrinkles": 4, "pores": 1, "wrinkle_tilts": 4}
    assert manifest.steps["wrinkle_tilts"] == (1 / 127,)
    tilts = [engine.tiles.bin_tile(asset, ADDRESS, "wrinkle_tilts", bin, 0) for bin in range(4)]
    assert len({codes.tobytes() for codes in tilts}) == 4
    assert max(np.abs(codes).max() for codes in tilts) > 60
    for bin, sample in ((4, 0), (0, 1)):
        with pytest.raises(NotFoundError, match="wrinkle_tilts: 0 to"):
            engine.tiles.bin_tile(asset, ADDRESS, "wrinkle_tilts", bin, sample)


@pytest.mark.slow
@pytest.mark.parametrize("merge", ["soft", "mellow"])
def test_pores_have_samples_of_their_own(engine, merge):
    asset = built(engine, new_asset(bins={"pore_samples": 7, "merge": merge}))
    plain = built(engine, new_asset(bins={"samples": 7, "merge": merge}))
    manifest = engine.tiles.bins(asset)
    for layer in manifest.layers:
        samples = 7 if layer.startswith("pore") else 3
        assert len(manifest.steps[layer]) == samples
        with pytest.raises(NotFoundError, match=f"sample {samples} of layer {layer}"):
            engine.tiles.bin_tile(asset, ADDRESS, layer, 0, samples)
        for sample in range(samples):
            same_r = sample if samples == 7 else 3 * sample
            found = engine.tiles.bin_tile(asset, ADDRESS, layer, 0, sample)
            wanted = engine.tiles.bin_tile(plain, ADDRESS, layer, 0, same_r)
            np.testing.assert_array_equal(found, wanted)


def test_min_has_no_layers_of_bulges(made):
    with pytest.raises(NotFoundError, match="layer 'wrinkle_bulges': one of wrinkles, pores"):
        made.engine.tiles.bin_tile(made.asset, ADDRESS, "wrinkle_bulges", 0, 0)


def test_binned_of_neutral_is_the_mellow_merge_of_the_middle_samples(engine):
    asset = built(engine, new_asset(bins={"merge": "mellow"}))
    manifest, heights = engine.tiles.bins(asset), {-1: [], 1: []}
    for layer, count in manifest.layers.items():
        sign = 1 if layer.endswith("bulges") else -1
        for bin in range(count):
            codes = engine.tiles.bin_tile(asset, ADDRESS, layer, bin, 1)
            heights[sign].append(sign * codes * manifest.steps[layer][1] / DEPTH)
    valleys, bulges = (drawing.mellow_max(np.stack(heights[s], -1), 20.0) for s in (-1, 1))
    found = engine.tiles.plan(asset, "neutral", BINNED, ADDRESS).draw()
    np.testing.assert_allclose(found, DEPTH * (bulges - valleys), atol=2e-6 * DEPTH, rtol=0)
    redrawn = engine.tiles.plan(asset, "neutral", MapQuery("redraw"), ADDRESS).draw()
    # Five layers by half a step of 1.2/127, in the valleys and in the bulges.
    assert np.abs(found - redrawn).max() <= 5 * 1.2 / 127 * DEPTH


BEST = {"merge": "soft", "depth_factored": True, "tilt": True, "reach": 1.5}


@pytest.mark.slow
@pytest.mark.parametrize(
    "changes",
    [{"merge": "signed"}, MELLOW, BEST, {"merge": "mellow"}, {"depth_factored": True}],
)
def test_changing_the_merge_gives_the_bits_of_an_asset_made_so(engine, changes):
    asset = built(engine, new_asset())
    engine.frames.put(asset, "bent", BENT)
    plan = engine.tiles.plan_map(asset, "bent", BINNED, 1001, 0)
    before, key = plan.draw(), plan.key
    engine.assets.change(asset, {"bins": changes})
    assert engine.tiles.plan_map(asset, "bent", BINNED, 1001, 0).key != key
    made_so = built(engine, new_asset(bins=changes))
    engine.frames.put(made_so, "bent", BENT)
    found = [
        engine.tiles.plan_map(name, "bent", BINNED, 1001, 0).draw() for name in (asset, made_so)
    ]
    assert same(found[:1], found[1:])
    assert not same(found[:1], [before])
    papers = {"merge": "min", "depth_factored": False, "tilt": False, "reach": 1.0}
    engine.assets.change(asset, {"bins": papers})
    assert same([engine.tiles.plan_map(asset, "bent", BINNED, 1001, 0).draw()], [before])


@pytest.mark.slow
def test_a_preset_can_be_changed_like_the_bins(engine):
    asset = built(engine, new_asset(bins={"r_max": 0.1, "count": 8}))
    engine.frames.put(asset, "bent", BENT)
    settings = engine.assets.change(asset, {"preset": "best", "bins": {"bits": 16}}).settings
    best = {**asdict(PRESETS["best"].bins), "r_max": 0.1, "bits": 16}
    assert (settings["preset"], settings["bins"]) == ("best", best)
    # A change leaves what a graph grew by, which says how far codes of grain go.
    graph = PRESETS["paper"].graph
    made_so = built(engine, new_asset(preset="best", graph=graph, bins={"r_max": 0.1, "bits": 16}))
    engine.frames.put(made_so, "bent", BENT)
    found = [
        engine.tiles.plan_map(name, "bent", BINNED, 1001, 0).draw() for name in (asset, made_so)
    ]
    assert same(found[:1], found[1:])
    with pytest.raises(SettingsError, match="preset is"):
        engine.assets.change(asset, {"preset": "fastest"})
    assert engine.assets.info(asset).settings == settings


@pytest.mark.slow
@pytest.mark.parametrize("merge", ["min", "soft", "signed", "mellow"])
def test_factored_maps_stay_within_the_scale_of_the_asset(engine, merge):
    """Where wrinkles meet, maps hold 1.2 depths, and compression makes four times that of it."""
    crowd = random_graph(9, 400, (0.05, 0.1))
    crowd = replace(crowd, edge_weight=np.ones(400), node_weight=np.ones(800))
    settings = settings_of(bins={"merge": merge, "depth_factored": True, "bits": 16})
    asset = built(engine, NewAsset(sheet(), settings, crowd))
    engine.frames.put(asset, "crushed", sheet().positions * 0.01)
    found = engine.tiles.plan_map(asset, "crushed", BINNED, 1001, 0).draw()
    scale = engine.tiles.plan(asset, "neutral", BINNED, ADDRESS).header.scale
    assert 4.2 * DEPTH < np.abs(found).max() <= scale


@pytest.mark.parametrize("part", ["rank", "patches", "events"])
def test_the_scale_of_uneven_skin_is_twice_as_large(part):
    none = {"rank": 0.0, "patches": 0.0, "events": 0.0}
    even, uneven = (
        displacement_scale(SimpleNamespace(settings=settings, residual=None))
        for amount in (0.0, 1.0)
        for settings in [settings_of(graph={**none, part: amount})]
    )
    assert uneven == pytest.approx(2.0 * even)
    assert even > 3.5 * DEPTH


def test_maps_of_a_mellow_merge_are_twice_the_memory(tmp_path):
    """What an asset says that its maps need is what they take."""
    with running(tmp_path, device_memory=64 * MIB) as engine:
        for merge, parts in (("min", 1), ("mellow", 2)):
            asset = built(engine, new_asset(bins={"merge": merge}))
            resident = engine._on_device.loaded(engine.assets._assets.get(asset))
            tiles = [
                engine._on_device.run(resident.bins.tile, TileAddress(1001, 0, row, column))
                for row, column in product(range(4), repeat=2)
            ]
            taken = sum(tile.nbytes for tile in tiles)
            assert sum(tile.codes.nbytes for tile in tiles) == 256**2 * 5 * 3 * parts
            assert resident.bins.size() == pytest.approx(taken, rel=0.02)


@pytest.mark.parametrize(("share", "ahead"), [(1.01, True), (0.99, False)])
def test_maps_are_made_after_a_build_where_they_fit(tmp_path, monkeypatch, share, ahead):
    """share: of the memory of the device that maps may take, in what these take."""
    with running(tmp_path, device_memory=64 * MIB) as engine:
        first = built(engine, new_asset())
        size = engine._on_device.loaded(engine.assets._assets.get(first)).bins.size()
        monkeypatch.setattr(builder, "_BINS_SHARE", share * size / (64 * MIB))
        before = engine._device.budget.used
        built(engine, new_asset(seed=2))
        assert (engine._device.budget.used > before + 0.9 * size) == ahead
