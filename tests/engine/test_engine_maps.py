"""Tiles and maps through the engine: the laws that hold bit for bit, and those with a bound."""

from __future__ import annotations

import numpy as np
import pytest

from engine.engines import (
    BINNED,
    CONVOLVED,
    QUERIES,
    REDRAW,
    assembled,
    built,
    maps,
    new_asset,
    same,
)
from meshes import deform, rotate_translate
from pipeline.scenes import DEPTH, Scene, random_graph, settings_of, sheet
from reference import drawing
from rhytid.device.runtime import Device
from rhytid.domain.mesh import Mesh
from rhytid.domain.methods import SAMPLINGS, STRETCH_MODELS
from rhytid.domain.tiles import TileAddress
from rhytid.engine.device_assets import levels
from rhytid.engine.frames import Frame
from rhytid.engine.messages import MapQuery
from rhytid.errors import DeviceMemoryError, QueryError

UDIMS = (1001, 1002, 1011, 1012)


def ids(query):
    return query.method


@pytest.mark.parametrize("level", [0, 1, 4, 8])
def test_redraw_and_convolved_of_neutral_are_neutral(made, level):
    for udim in UDIMS:
        neutral, redrawn = (
            made.engine.tiles.plan_map(made.asset, "neutral", query, udim, level).draw()
            for query in QUERIES[:2]
        )
        assert same([neutral], [redrawn])
        assert same(
            [neutral],
            [made.engine.tiles.plan_map(made.asset, "neutral", CONVOLVED, udim, level).draw()],
        )
    assert np.abs(neutral).max() > 0


def test_neutral_is_the_same_in_every_frame(made):
    for query in QUERIES:
        frames = [
            made.engine.tiles.plan_map(made.asset, f, query, 1001, 0).draw()
            for f in ("neutral", "bent")
        ]
        assert same(frames[:1], frames[1:]) == (query.method == "neutral")


def test_binned_of_neutral_is_the_middle_sample_of_each_layer(made):
    found = made.engine.tiles.plan_map(made.asset, "neutral", BINNED, 1001, 0).draw()[:64, 64:128]
    steps = made.engine.tiles.bins(made.asset).steps
    layers = [("wrinkles", n) for n in range(4)] + [("pores", 0)]
    codes = [
        made.engine.tiles.bin_tile(made.asset, TileAddress(1001, 0, 0, 1), *la, 1) for la in layers
    ]
    heights = [c * steps[layer][1] for c, (layer, _) in zip(codes, layers, strict=True)]
    np.testing.assert_allclose(found, np.min(heights, axis=0), atol=1e-7 * DEPTH, rtol=0)


@pytest.mark.parametrize("query", QUERIES, ids=ids)
@pytest.mark.parametrize("level", range(9))
def test_tiles_put_together_are_the_map(made, query, level):
    for udim in (1001, 1012):
        whole = made.engine.tiles.plan_map(made.asset, "bent", query, udim, level).draw()
        assert whole.shape == (256 >> level,) * 2
        assert whole.dtype == np.float32
        assert same([whole], [assembled(made.engine, made.asset, "bent", query, udim, level)])


@pytest.mark.parametrize("query", QUERIES, ids=ids)
def test_a_level_is_the_mean_of_the_one_below(made, query):
    fine = made.engine.tiles.plan_map(made.asset, "bent", query, 1001, 0).draw()
    for level in range(1, 9):
        coarse = made.engine.tiles.plan_map(made.asset, "bent", query, 1001, level).draw()
        a, b, c, d = (fine[y::2, x::2] for y in (0, 1) for x in (0, 1))
        np.testing.assert_array_equal(coarse, np.float32(0.25) * ((a + b) + (c + d)))
        fine = coarse


def test_redraw_of_the_engine_is_that_of_double(made, device):
    positions = made.engine.frames.positions(made.asset, "bent")
    scene = Scene(device, sheet(udims=2), random_graph(1, span=2.0), settings_of())
    points = drawing.crop(64, 64, 64, 64, 256)
    wanted = scene.expected(points, positions, 1002).reshape(64, 64)
    found = made.engine.tiles.plan(made.asset, "bent", REDRAW, TileAddress(1002, 0, 1, 1)).draw()
    assert np.abs(found - wanted).max() <= 1e-4 * DEPTH


def test_positions_sent_along_give_the_tiles_of_a_stored_frame(made):
    positions = made.engine.frames.positions(made.asset, "bent")
    addresses = [TileAddress(1012, 0, 3, 2), TileAddress(1001, 2, 0, 0), TileAddress(1001, 8, 0, 0)]
    for query in QUERIES:
        frame = Frame.of(positions)
        once = [made.engine.tiles.draw(made.asset, frame, query, a).tile for a in addresses]
        stored = [made.engine.tiles.plan(made.asset, "bent", query, a).draw() for a in addresses]
        assert same(once, stored)


def test_convolved_goes_with_any_stretch_model(made):
    neutral = made.engine.tiles.plan_map(made.asset, "bent", QUERIES[0], 1001, 0).draw()
    seen = [neutral]
    for model in STRETCH_MODELS:
        query = MapQuery("convolved", model)
        found = made.engine.tiles.plan_map(made.asset, "bent", query, 1001, 0).draw()
        assert same([found], [assembled(made.engine, made.asset, "bent", query, 1001, 0)])
        assert all(np.abs(found - other).max() > 0.1 * DEPTH for other in seen)
        seen.append(found)


@pytest.mark.parametrize("sampling", SAMPLINGS)
def test_convolved_drawn_in_pieces_is_the_same_bits(made, monkeypatch, sampling):
    query = MapQuery("convolved", sampling=sampling)

    def tiles():
        addresses = [TileAddress(1001, 0, 1, 2), TileAddress(1001, 2, 0, 0)]
        return [made.engine.tiles.plan(made.asset, "bent", query, a).draw() for a in addresses]

    plain = tiles()
    made.engine._on_device.run(
        made.engine._on_device.loaded(made.engine.assets._assets.get(made.asset)).mesh.cache.clear
    )
    monkeypatch.setitem(levels._PIECE, "convolved", 64)
    assert same(tiles(), plain)


@pytest.mark.parametrize("query", QUERIES, ids=ids)
def test_pieces_are_read_into_the_map(made, monkeypatch, query):
    plan = made.engine.tiles.plan_map(made.asset, "bent", query, 1001, 0)
    whole, outs, read = plan.draw(), [], Device.read_squares

    def seen(device, places, into):
        outs.extend(into)
        read(device, places, into)

    monkeypatch.setitem(levels._PIECE, query.method, 128)
    monkeypatch.setattr(Device, "read_squares", seen)
    for draw in (plan.draw, plan.draw_halves):
        outs.clear()
        pieces = draw()
        assert same([pieces], [whole.astype(pieces.dtype)])
        assert len(outs) >= 4
        assert all(np.shares_memory(one, pieces) for one in outs)


@pytest.mark.parametrize("query", QUERIES, ids=ids)
@pytest.mark.parametrize("level", [0, 1, 2, 8])
def test_half_floats_of_a_map_are_its_numbers_rounded(made, monkeypatch, query, level):
    def cleared():
        asset = made.engine.assets._assets.get(made.asset)
        loaded = made.engine._on_device.loaded(asset)
        made.engine._on_device.run(loaded.mesh.cache.clear)

    for piece in (2048, 128):
        monkeypatch.setitem(levels._PIECE, query.method, piece)
        for udim in UDIMS[:2]:
            cleared()
            plan = made.engine.tiles.plan_map(made.asset, "bent", query, udim, level)
            fresh, whole, kept = plan.draw_halves(), plan.draw(), plan.draw_halves()
            assert same([fresh, kept], [whole.astype(np.float16)] * 2)


def test_a_planned_map_is_of_its_frame_though_that_is_replaced(engine):
    asset = built(engine, new_asset())
    engine.frames.put(asset, "own", deform(sheet().positions, 4, 0.15))
    plan = engine.tiles.plan_map(asset, "own", REDRAW, 1001, 0)
    whole = plan.draw()
    engine.frames.put(asset, "own", deform(sheet().positions, 5, 0.15))

    assert same([plan.draw(), plan.draw_halves()], [whole, whole.astype(np.float16)])
    assert plan.key != engine.tiles.plan_map(asset, "own", REDRAW, 1001, 0).key


def test_half_floats_of_a_map_are_given_where_memory_is_short(made, monkeypatch):
    plan, finest = made.engine.tiles.plan_map(made.asset, "bent", REDRAW, 1001, 0), []
    whole, squares = plan.draw(), levels.DeviceLevels.squares

    def short(*about):
        finest.append(about)
        raise DeviceMemoryError("no memory")

    monkeypatch.setattr(levels.DeviceLevels, "squares", short)
    found = plan.draw_halves()
    monkeypatch.setattr(levels.DeviceLevels, "squares", squares)
    assert finest
    assert same([found], [whole.astype(np.float16)])


def test_displacement_stays_within_its_scale(made):
    first = TileAddress(1001, 0, 0, 0)
    scale = made.engine.tiles.plan(made.asset, "neutral", REDRAW, first).header.scale
    for found in maps(made.engine, made.asset, "bent"):
        assert np.abs(found).max() <= scale


@pytest.mark.parametrize("other", [128, 256])
def test_tile_size_changes_no_bit(engine, other):
    assets = [built(engine, new_asset(tile_size=size)) for size in (64, other)]
    for asset in assets:
        engine.frames.put(asset, "bent", deform(sheet().positions, 4, 0.15))
    for level in range(9):
        assert same(*(maps(engine, asset, "bent", level) for asset in assets))


def test_a_frame_equal_to_the_neutral_is_the_neutral_to_1e_5(engine):
    asset = built(engine, new_asset())
    engine.frames.put(asset, "same", sheet().positions)
    found, neutral = (
        engine.tiles.plan_map(asset, f, REDRAW, 1001, 0).draw() for f in ("same", "neutral")
    )
    assert np.abs(found - neutral).max() <= 1e-5 * DEPTH


def test_a_rigid_motion_is_the_neutral_up_to_the_rounding_of_positions(engine):
    mesh = sheet()
    asset = built(engine, new_asset(mesh))
    moved = rotate_translate(mesh.positions, 5)
    engine.frames.put(asset, "moved", moved)
    log_stretch = np.abs(np.log(engine.frames.stretch(asset, "moved").ratios)).max()
    # A coordinate rounds by 2^-24 of its size; two ends of an edge, two edges, three coordinates.
    corners = mesh.positions[mesh.faces].astype(np.float64)
    height = smallest_height(corners)
    assert log_stretch <= 2 * 2 * np.sqrt(3) * 2.0**-24 * np.abs(moved).max() / height
    # dh <= depth (beta_d |h| + beta_w |t h'(t)|) |r| = depth (10 + 4 * 1.13) |r| for one pore, less
    # for a wrinkle; where k heights meet, the slopes of the mellow-max add up to k at most.
    found, neutral = (
        engine.tiles.plan_map(asset, f, REDRAW, 1001, 0).draw() for f in ("moved", "neutral")
    )
    overlapping = 8
    assert np.abs(found - neutral).max() <= overlapping * 15 * log_stretch * DEPTH


def smallest_height(corners):
    """The smallest height of triangles (F, 3, 3)."""
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1)
    u, w = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return float((np.linalg.norm(np.cross(u, w), axis=1) / edges.max(axis=1)).min())


@pytest.mark.parametrize(("factor", "bound"), [(2.0**-20, 0.0), (1024.0, 0.0), (1e3, 1e-5)])
def test_a_larger_mesh_with_deeper_wrinkles_is_the_same_picture(engine, factor, bound):
    mesh, scale = sheet(), np.float32(factor)
    larger = Mesh(mesh.positions * scale, mesh.faces, mesh.uv, mesh.face_uv)
    positions = deform(mesh.positions, 6, 0.15)
    pairs = []
    for body, frame, depth in (
        (mesh, positions, DEPTH),
        (larger, positions * scale, DEPTH * factor),
    ):
        asset = built(engine, new_asset(body, depth=depth))
        engine.frames.put(asset, "bent", frame)
        pairs.append(np.stack(maps(engine, asset, "bent")) / depth)
    assert np.abs(pairs[0] - pairs[1]).max() <= bound + 2.0**-23


def test_unknown_queries_are_refused():
    for bad in ({"method": "other"}, {"stretch": "other"}, {"sampling": "other"}):
        with pytest.raises(QueryError, match="other"):
            MapQuery(**bad)
