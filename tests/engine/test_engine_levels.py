"""Levels of a frame: means of level 0 in every method, drawn piece by piece, kept, and the same
bits whatever was asked first and whatever was dropped."""

from __future__ import annotations

import threading
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from engine.engines import (
    BINNED,
    CONVOLVED,
    MIB,
    QUERIES,
    REDRAW,
    assembled,
    built,
    draw,
    new_asset,
    running,
    same,
    settle,
)
from meshes import deform
from pipeline.scenes import sheet
from reference import pyramid
from rhytid.domain.painted_maps import Stiffness
from rhytid.domain.tiles import TileAddress
from rhytid.engine.device_assets import levels
from rhytid.engine.device_assets.drawing import DeviceDrawing
from rhytid.engine.device_assets.levels import DeviceFinest, DeviceLevels
from rhytid.engine.messages import MapQuery, NewAsset
from rhytid.engine.tiles import maps
from rhytid.errors import BusyError, ChangingError, ConflictError, DeviceMemoryError, NotFoundError

BENT, OTHER = (deform(sheet().positions, seed, 0.15) for seed in (1, 2))
LEVELS = range(9)
COARSE = TileAddress(1001, 3, 0, 0)
SMOOTH = tuple(MapQuery(q.method, sampling="smooth") for q in (BINNED, CONVOLVED))
CHOICES = [{"merge": "min", "depth_factored": False, "tilt": False}, {"merge": "soft"}]


def ids(query):
    return f"{query.method}-{query.sampling}"


def addresses(levels=LEVELS):
    grid = new_asset().settings.grid
    return [address for level in levels for address in grid.addresses(1001, level)]


def until(reached):
    for _ in range(6000):
        if reached():
            return
        time.sleep(0.01)
    raise AssertionError("it never came")


def every_map(engine, asset, query, frame="bent"):
    return [engine.tiles.plan_map(asset, frame, query, 1001, level).draw() for level in LEVELS]


@pytest.fixture
def small_pieces(monkeypatch):
    """Maps of 256² texels in 4 or 16 pieces, the mip tail from level 2 on."""
    sides = {"neutral": 128, "redraw": 128, "binned": 64, "convolved": 128}
    monkeypatch.setattr(levels, "_PIECE", sides)
    monkeypatch.setattr(levels, "_TAIL", 64)


@pytest.fixture
def asset(engine, small_pieces):
    asset = built(engine, new_asset())
    engine.frames.put(asset, "bent", BENT)
    return asset


@pytest.fixture
def drawn(monkeypatch):
    """Of each task on the device that draws: the texels of level 0, and what was drawn."""
    found = []

    squares = DeviceDrawing.squares

    def spy(self, frame, query, *about):
        made = squares(self, frame, query, *about)
        texels = (buffer.nbytes // 4 for buffer in made)
        # Less the room for a vector behind what is blended: sides are whole blocks.
        found.append(sum(count - count % 4096 for count in texels))
        return made

    monkeypatch.setattr(DeviceDrawing, "squares", spy)
    return found


@pytest.mark.parametrize("query", [BINNED, REDRAW], ids=ids)
def test_maps_that_are_gone_give_their_memory_to_the_next_ones(engine, asset, query):
    engine.frames.put(asset, "other", OTHER)
    frames = ("bent", "other", "bent", "other")

    def drawn(frame):
        return engine.tiles.plan_map(asset, frame, query, 1001, 0).draw()

    wanted, places, others = [drawn(frame) for frame in frames], set(), []
    with engine.tiles.memory_kept():
        for frame, map in zip(frames, wanted, strict=True):
            found = drawn(frame)
            assert np.array_equal(found, map)
            places.add(found.__array_interface__["data"][0])
            del found
            others.append(np.empty_like(map))  # what malloc would give the next one
    assert len(places) == 1


@pytest.mark.parametrize(
    ("query", "bins"),
    # Only `binned` reads them.
    [*((query, CHOICES[0]) for query in QUERIES), *((q, CHOICES[1]) for q in (BINNED, *SMOOTH))],
    ids=lambda of: ids(of) if isinstance(of, MapQuery) else of["merge"],
)
def test_every_level_is_the_mean_of_level_0(engine, query, bins):
    asset = built(engine, new_asset(bins=bins))
    engine.frames.put(asset, "bent", BENT)
    found = every_map(engine, asset, query)
    most = np.abs(found[0]).max()
    assert most > 0
    for level, wanted in zip(found, pyramid.levels(found[0]), strict=True):
        np.testing.assert_allclose(level, wanted, atol=1e-6 * most, rtol=0)


def test_levels_of_a_stiff_face_are_means(engine):
    plain = new_asset()
    map = np.random.default_rng(4).uniform(0, 1, (16, 16)).astype(np.float32)
    stiff = NewAsset(plain.mesh, plain.settings, plain.graph, stiffness=Stiffness({1001: map}))
    asset = built(engine, stiff)
    engine.frames.put(asset, "bent", BENT)
    found = every_map(engine, asset, BINNED)
    for level, wanted in zip(found, pyramid.levels(found[0]), strict=True):
        np.testing.assert_allclose(level, wanted, atol=1e-6 * np.abs(found[0]).max(), rtol=0)


@pytest.mark.parametrize("query", [*QUERIES, *SMOOTH], ids=ids)
def test_pieces_and_tail_are_the_bits_of_one_piece(tmp_path, query, request, monkeypatch):
    def found():
        with running(tmp_path) as engine:
            asset = built(engine, new_asset())
            settle(engine, asset)
            engine.frames.put(asset, "bent", BENT)
            # Tiles first: they are cut out of pieces, maps are put together from them.
            tiles = [assembled(engine, asset, "bent", query, 1001, level) for level in LEVELS]
            return tiles, every_map(engine, asset, query)

    plain, plain_maps = found()
    assert same(plain, plain_maps)
    monkeypatch.setattr(levels, "_TAIL", 64)  # pieces larger than tiles of level 1
    for made in (*found(), *(request.getfixturevalue("small_pieces") or found())):
        assert same(made, plain)


@pytest.mark.parametrize("query", QUERIES, ids=ids)
@pytest.mark.parametrize(
    "way", ["mixed", *(pytest.param(way, marks=pytest.mark.slow) for way in ("up", "down"))]
)
def test_all_levels_draw_every_texel_once(engine, asset, drawn, query, way):
    wanted = addresses()
    if way == "down":
        wanted.reverse()
    elif way == "mixed":
        wanted = [*addresses([3]), *addresses([0]), *addresses([8, 1, 2, 4])]
    for address in wanted:
        engine.tiles.plan(asset, "bent", query, address).draw()
    for level in LEVELS:
        engine.tiles.plan_map(asset, "bent", query, 1001, level).draw()
    assert sum(drawn) == 256**2


@pytest.mark.parametrize("query", QUERIES, ids=ids)
def test_the_second_coarse_tile_draws_nothing(engine, asset, drawn, query, monkeypatch):
    engine.tiles.plan(asset, "bent", query, COARSE).draw()
    assert sum(drawn) == 256**2
    launched = []
    monkeypatch.setattr(engine._device, "launch", lambda *a, **_: launched.append(a[:2]))
    for address in addresses(range(1, 9)):
        engine.tiles.plan(asset, "bent", query, address).draw()
    assert launched == []


@pytest.mark.parametrize("query", QUERIES, ids=ids)
def test_a_coarse_tile_draws_no_more_than_its_pieces(engine, asset, drawn, query):
    engine.tiles.plan(asset, "bent", query, TileAddress(1001, 1, 1, 1)).draw()
    assert sum(drawn) == 128**2


@pytest.mark.parametrize("query", QUERIES, ids=ids)
def test_no_task_draws_more_than_a_piece_and_others_get_their_turn(
    engine, asset, query, monkeypatch
):
    order, waiting = [], threading.Event()
    plain, other = DeviceLevels.squares, DeviceFinest.tiles

    def squares(self, *about):
        order.append("piece")
        if len(order) == 1:  # the other request comes while the first piece is drawn
            waiting.set()
            until(lambda: engine._worker.waiting > 0)
        return plain(self, *about)

    def tiles(self, *about):
        order.append("tile")
        return other(self, *about)

    monkeypatch.setattr(DeviceLevels, "squares", squares)
    monkeypatch.setattr(DeviceFinest, "tiles", tiles)
    with ThreadPoolExecutor(2) as pool:
        coarse = pool.submit(draw, engine, asset, "bent", query, COARSE)
        assert waiting.wait(60)
        pool.submit(draw, engine, asset, "bent", query, TileAddress(1001, 0, 3, 3)).result(60)
        coarse.result(60)
    assert order.index("tile") <= 2
    assert order.count("piece") == (16 if query == BINNED else 4)


@pytest.mark.slow
def test_the_same_bits_under_any_memory_in_any_order(tmp_path):
    wanted = [(query, address) for query in QUERIES for address in addresses()]
    with running(tmp_path) as engine:
        asset = built(engine, new_asset())
        engine.frames.put(asset, "bent", BENT)
        plenty = [engine.tiles.plan(asset, "bent", *one).draw() for one in wanted]
    with running(tmp_path, device_memory=MIB) as engine:  # too little to make bins ahead
        settle(engine, asset)
        engine._on_device.loaded(engine.assets._assets.get(asset))
        resident = engine._device.budget.used
    order = np.random.default_rng(5).permutation(len(wanted))
    # From one tile at a time, with nothing kept, to levels that are kept and dropped in turn.
    least = 64 * 64 * (15 + 5 + 4 * 3)
    for more in (least, 2 * least, 6 * least, MIB):
        with running(tmp_path, device_memory=resident + more) as engine:
            settle(engine, asset)
            engine.frames.put(asset, "bent", BENT)
            for query, address in ((REDRAW, COARSE), (BINNED, COARSE)):
                at = wanted.index((query, address))
                assert same([engine.tiles.plan(asset, "bent", query, address).draw()], [plenty[at]])
            for at in order[:: 1 if more == MIB else 7]:
                query, address = wanted[at]
                if query == CONVOLVED and more < 6 * least:
                    continue  # one tile with its surroundings takes more
                assert same([engine.tiles.plan(asset, "bent", query, address).draw()], [plenty[at]])
            assert engine._device.budget.used <= resident + more


def test_where_memory_is_short_level_0_is_not_kept(tmp_path, drawn):
    with running(tmp_path) as engine:
        asset = built(engine, new_asset())
        budget = engine._device.budget
        budget.limit = budget.used + 10 * 4 * 256**2
        engine.frames.put(asset, "bent", BENT)
        drawn.clear()
        for _ in range(2):
            engine.tiles.plan_map(asset, "bent", REDRAW, 1001, 0).draw()
        assert len(drawn) == 1
        budget.limit = budget.used + 7 * 4 * 256**2
        engine.frames.put(asset, "bent", OTHER)
        for _ in range(2):
            engine.tiles.plan_map(asset, "bent", REDRAW, 1001, 0).draw()
        assert len(drawn) == 3
        engine.tiles.plan(asset, "bent", REDRAW, COARSE).draw()
        engine.tiles.plan(asset, "bent", REDRAW, COARSE).draw()
        assert len(drawn) == 4  # but the levels above are


def test_level_0_is_kept_of_one_frame(engine):
    asset = built(engine, new_asset())
    use = []
    for seed in range(6):
        engine.frames.put(asset, "bent", deform(sheet().positions, seed, 0.1))
        use.append(engine._device.budget.used)
        engine.tiles.plan_map(asset, "bent", REDRAW, 1001, 0).draw()
        use.append(engine._device.budget.used)
    assert use[1] - use[0] > 4 * 256**2
    assert use[-1] - use[1] < 4 * 256**2


def interrupted(monkeypatch, doing):
    """Call `doing` from another thread once the first piece of a square is drawn."""
    plain, begun = maps._Square._some, []

    def some(self, *about):
        found = plain(self, *about)
        begun.append(1)
        doing(len(begun))
        return found

    monkeypatch.setattr(maps._Square, "_some", some)
    return begun


@pytest.mark.parametrize("query", [REDRAW, BINNED], ids=ids)
def test_a_frame_that_is_replaced_meanwhile_is_drawn_as_it_was(engine, asset, query, monkeypatch):
    old = every_map(engine, asset, query)
    engine.frames.put(asset, "bent", OTHER)
    new = every_map(engine, asset, query)
    assert not same(old, new)
    engine.assets.change(asset, {"depth": 0.05})  # nothing is kept any more
    engine.assets.change(asset, {"depth": 0.04})
    scale = 0.04 / new_asset().settings.depth

    def replace(step):
        if step == 2:
            engine.frames.put(asset, "bent", BENT)

    begun = interrupted(monkeypatch, replace)
    found = engine.tiles.plan(asset, "bent", query, COARSE).draw()
    assert len(begun) > 2
    np.testing.assert_allclose(found, new[3] * scale, rtol=1e-5, atol=1e-7)
    found = engine.tiles.plan(asset, "bent", query, COARSE).draw()
    np.testing.assert_allclose(found, old[3] * scale, rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize("query", [REDRAW, BINNED], ids=ids)
@pytest.mark.parametrize(
    "level", [0, 2, *(pytest.param(level, marks=pytest.mark.slow) for level in (1, 3, 8))]
)
def test_settings_that_change_meanwhile_are_those_of_all_texels(
    engine, asset, query, level, monkeypatch
):
    changes = {"shape": {"sharpness": 12.0}}
    engine.assets.change(asset, changes)
    wanted = engine.tiles.plan_map(asset, "bent", query, 1001, level).draw()
    engine.assets.change(asset, {"shape": {"sharpness": 20.0}})
    before = engine.tiles.plan_map(asset, "bent", query, 1001, level).draw()
    assert not same([wanted], [before])
    engine.assets.change(asset, {"shape": {"sharpness": 16.0}})
    begun = interrupted(
        monkeypatch, lambda step: engine.assets.change(asset, changes) if step == 2 else None
    )
    assert same([engine.tiles.plan_map(asset, "bent", query, 1001, level).draw()], [wanted])
    assert len(begun) > 4
    assert same([engine.tiles.plan_map(asset, "bent", query, 1001, level).draw()], [wanted])


def test_settings_that_change_all_the_time_are_a_conflict_for_now(engine, asset, monkeypatch):
    """Clients ask again, as they are told when."""
    interrupted(
        monkeypatch,
        lambda step: engine.assets.change(asset, {"shape": {"sharpness": 10.0 + step % 7}}),
    )
    with pytest.raises(ChangingError, match="change while") as raised:
        engine.tiles.plan(asset, "bent", REDRAW, COARSE).draw()
    assert isinstance(raised.value, ConflictError)
    assert raised.value.retry_after == 1


def test_who_wants_the_same_coarse_tile_gets_the_same_array(engine, asset, drawn, monkeypatch):
    asked = []

    def ask(step):
        if step == 1:
            asked.extend(pool.submit(draw, engine, asset, "bent", REDRAW, COARSE) for _ in range(3))
            until(lambda: engine.tiles._maps.joined == 2 and any(f.done() for f in asked))

    engine.tiles._maps._most = 2
    interrupted(monkeypatch, ask)
    with ThreadPoolExecutor(3) as pool:
        first = engine.tiles.plan(asset, "bent", REDRAW, COARSE).draw()
    errors = [future.exception() for future in asked]
    (refused,) = (error for error in errors if error is not None)
    assert isinstance(refused, BusyError)
    assert "2 requests wait" in str(refused)
    assert all(f.result() is first for f, e in zip(asked, errors, strict=True) if e is None)
    assert not first.flags.writeable
    assert engine.waiting == 0
    assert sum(drawn) == 256**2


def test_an_error_reaches_all_who_wait_for_it(engine, asset, monkeypatch):
    asked = []

    def ask(step):
        asked.append(pool.submit(draw, engine, asset, "bent", REDRAW, COARSE))
        until(lambda: engine.tiles._maps.joined == 1)
        raise DeviceMemoryError("none left")

    interrupted(monkeypatch, ask)
    with ThreadPoolExecutor(1) as pool, pytest.raises(DeviceMemoryError, match="none left"):
        engine.tiles.plan(asset, "bent", REDRAW, COARSE).draw()
    with pytest.raises(DeviceMemoryError, match="none left"):
        asked[0].result(60)
    assert engine.waiting == 0


def test_precomputed_maps_have_level_0_alone(engine, asset):
    with pytest.raises(NotFoundError, match=r"level 1: .* level 0 only.*means"):
        engine.tiles.bin_tile(asset, TileAddress(1001, 1, 0, 0), "wrinkles", 0, 0)
    with pytest.raises(NotFoundError, match="level 9: levels go from 0 to 8"):
        engine.tiles.bin_tile(asset, TileAddress(1001, 9, 0, 0), "wrinkles", 0, 0)
