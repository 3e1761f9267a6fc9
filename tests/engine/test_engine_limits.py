"""Limits: device memory, frame memory, the queue. What does not fit is refused with numbers, and
the engine goes on."""

from __future__ import annotations

import re
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from api.asking import NPY, is_problem, npy
from api.live import serving
from engine.engines import (
    BINNED,
    CONVOLVED,
    MIB,
    REDRAW,
    built,
    finish,
    maps,
    new_asset,
    running,
    same,
    settle,
)
from engine.test_engine_together import until
from meshes import deform
from pipeline.scenes import random_graph, settings_of, sheet
from rhytid.domain.tiles import TileAddress
from rhytid.engine.device_assets.mesh import RECENT_FRAMES
from rhytid.engine.frames import Frame, FrameMemory, Frames, LogStretch
from rhytid.engine.messages import NewAsset
from rhytid.errors import (
    BusyError,
    DeviceMemoryError,
    FrameMemoryError,
    NotFoundError,
    ReadOnlyError,
)

ADDRESS = TileAddress(1001, 0, 0, 0)
BENT = deform(sheet().positions, 1, 0.15)
# Four floats per texel and codes of 15 maps: what a tile of 64² texels needs to be blended.
TILE_BYTES = 64 * 64 * (15 + 16)


def used(engine):
    return next(info.used for info in engine.devices() if info.selected)


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    """A store with an asset of 512² texels, its id, the bytes that it keeps on the device, and its
    maps as made with plenty of memory."""
    store = tmp_path_factory.mktemp("stored")
    with running(store) as engine:
        asset = built(engine, new_asset(resolution=512, tile_size=64))
        engine.frames.put(asset, "bent", BENT)
        plenty = [maps(engine, asset, "bent", level) for level in (0, 2)]
    with running(store, device_memory=3 * MIB) as engine:  # too little to make bins ahead
        settle(engine, asset)
        resident = used(engine)
    return store, asset, resident, plenty


def test_a_map_that_does_not_fit_is_drawn_in_smaller_pieces_and_leaves_nothing(stored):
    store, asset, resident, plenty = stored
    budget = resident + 512 * 512  # a quarter of one map
    with running(store, device_memory=budget) as engine:
        settle(engine, asset)
        engine.frames.put(asset, "bent", BENT)
        engine.tiles.plan(asset, "bent", REDRAW, ADDRESS).draw()
        before = used(engine)
        for _ in range(3):
            assert same(
                [engine.tiles.plan_map(asset, "bent", REDRAW, 1001, 0).draw()], [plenty[0][1]]
            )
            assert used(engine) <= before
        found = engine.tiles.plan(asset, "bent", REDRAW, ADDRESS).draw()
        assert used(engine) <= before  # less the stretch, of which its scales are kept
        assert np.abs(found).max() > 0


def test_a_tile_that_does_not_fit_is_refused_with_numbers_and_leaves_nothing(stored):
    store, asset, _, _ = stored
    with running(store, device_memory=3 * MIB) as engine:
        settle(engine, asset)
        budget = used(engine) + 64 * 64  # a quarter of one tile
        engine._device.budget.limit = budget
        for wanted in (ADDRESS, TileAddress(1001, 2, 0, 0)):
            with pytest.raises(DeviceMemoryError, match=rf"\d+ bytes .* {budget} bytes"):
                engine.tiles.plan(asset, "neutral", REDRAW, wanted).draw()
            with pytest.raises(DeviceMemoryError, match=rf"\d+ bytes .* {budget} bytes"):
                engine.tiles.plan_map(asset, "neutral", REDRAW, 1001, wanted.level).draw()
        assert used(engine) <= budget


def test_only_what_the_last_frames_need_stays_on_the_device(stored):
    store, asset, _, _ = stored
    with running(store) as engine:
        settle(engine, asset)
        use, first = [], None
        for frame in range(RECENT_FRAMES + 5):
            engine.frames.put(asset, "bent", deform(sheet().positions, frame, 0.15))
            for query in (REDRAW, BINNED):
                tile = engine.tiles.plan(asset, "bent", query, ADDRESS).draw()
            first = tile if first is None else first
            use.append(used(engine))
        assert use[0] < use[1] < use[RECENT_FRAMES - 2]
        assert len(set(use[RECENT_FRAMES:])) == 1
        engine.frames.put(asset, "bent", deform(sheet().positions, 0, 0.15))
        assert same([engine.tiles.plan(asset, "bent", BINNED, ADDRESS).draw()], [first])


@pytest.mark.slow
def test_bins_made_one_by_one_under_a_small_budget_are_the_same_bits(stored):
    store, asset, resident, plenty = stored
    with running(store, device_memory=resident + 3 * TILE_BYTES + 256 * 256 * 8) as engine:
        settle(engine, asset)
        engine.frames.put(asset, "bent", BENT)
        for level, wanted in zip((0, 2), plenty, strict=True):
            found = engine.tiles.plan_map(asset, "bent", BINNED, 1001, level).draw()
            assert same([found], [wanted[2]])
        assert used(engine) <= resident + 3 * TILE_BYTES + 256 * 256 * 8


def test_neutral_tiles_kept_under_a_small_budget_are_the_same_bits(stored):
    store, asset, resident, plenty = stored
    # Around a tile of 64² texels: 128² triangles, 192² of the neutral map, drawn as 256² at first.
    budget = resident + 4 * (128**2 + 192**2 + 256**2 + 2 * 128**2)
    with running(store, device_memory=budget) as engine:
        settle(engine, asset)
        engine.frames.put(asset, "bent", BENT)
        for _ in range(2):
            found = engine.tiles.plan_map(asset, "bent", CONVOLVED, 1001, 0).draw()
            assert same([found], [plenty[0][3]])
        assert used(engine) <= budget


def test_an_asset_that_does_not_fit_fails_with_numbers_and_leaves_nothing(tmp_path):
    with running(tmp_path, device_memory=20_000) as engine:
        assert engine.ready()
        info = engine.assets.create(new_asset())
        job = finish(engine, info.job)
        assert job.state == "failed"
        failed = engine.assets.info(info.id)
        assert failed.state == "failed"
        assert failed.reason is not None
        assert "budget of 20000 bytes" in failed.reason
        assert used(engine) == 0
        assert engine.ready()
    with running(tmp_path) as engine:  # with more memory it can be built after all
        settle(engine, info.id)
        assert engine.assets.info(info.id).state == "ready"


def test_a_change_that_does_not_fit_leaves_the_asset_as_it_was(tmp_path):
    many = NewAsset(sheet(), settings_of(), random_graph(9, 3000, (0.002, 0.01), (0.002, 0.01)))
    with running(tmp_path, device_memory=MIB) as engine:  # too little to make bins ahead
        asset = built(engine, many)
        resident = used(engine)
    budget = resident + 130_000  # a tile can be drawn; half of the elements take more
    with running(tmp_path, device_memory=budget) as engine:
        settle(engine, asset)
        engine.frames.put(asset, "bent", BENT)
        tile = engine.tiles.plan(asset, "bent", REDRAW, ADDRESS).draw()
        key = engine.tiles.plan(asset, "bent", REDRAW, ADDRESS).key
        with pytest.raises(DeviceMemoryError, match=f"{budget} bytes"):
            engine.assets.change(asset, {"response": {"alpha_w": 2.0}})
        assert engine.assets.info(asset).settings["response"]["alpha_w"] == 1.0
        assert engine.tiles.plan(asset, "bent", REDRAW, ADDRESS).key == key
        assert same([engine.tiles.plan(asset, "bent", REDRAW, ADDRESS).draw()], [tile])
        assert used(engine) <= budget
    with running(tmp_path) as engine:
        settle(engine, asset)
        assert engine.assets.info(asset).settings["response"]["alpha_w"] == 1.0


def test_frames_beyond_their_memory_are_refused_with_numbers(tmp_path):
    size = BENT.nbytes
    with running(tmp_path, frame_memory=2 * size + 10) as engine:
        asset = built(engine, new_asset())
        engine.frames.put(asset, "a", BENT)
        engine.frames.put(asset, "b", BENT)
        full = rf"{2 * size} of {2 * size + 10} bytes.*{size} more"
        with pytest.raises(FrameMemoryError, match=full):
            engine.frames.put(asset, "c", BENT)
        with serving(engine) as client:
            path = f"/v1/assets/{asset}/frames/c"
            answer = client.put(path, content=npy(BENT), headers=NPY)
        assert re.search(full, is_problem(answer, 507, "frame-memory"))
        engine.frames.put(asset, "b", BENT)  # in place of what is there
        engine.frames.delete(asset, "a")
        engine.frames.put(asset, "c", BENT)
        assert [frame.name for frame in engine.frames.all(asset)] == ["neutral", "b", "c"]
        engine.assets.delete(asset)
        other = built(engine, new_asset(seed=2))
        engine.frames.put(other, "a", BENT)
        engine.frames.put(other, "b", BENT)


def test_neutral_is_read_only(engine):
    asset = built(engine, new_asset())
    with pytest.raises(ReadOnlyError):
        engine.frames.put(asset, "neutral", BENT)
    with pytest.raises(ReadOnlyError):
        engine.frames.delete(asset, "neutral")


def test_a_full_queue_is_busy_and_recovers(tmp_path):
    with running(tmp_path, queue=1) as engine:
        asset = built(engine, new_asset())
        at_work, free = threading.Event(), threading.Event()

        def occupy():
            at_work.set()
            assert free.wait(60)

        threads = [threading.Thread(target=engine._on_device.run, args=(occupy,))]
        threads[0].start()
        assert at_work.wait(60)
        threads.append(threading.Thread(target=engine._on_device.run, args=(lambda: None,)))
        threads[1].start()
        try:
            while engine.waiting < 1:
                threads[1].join(0.001)
            with pytest.raises(BusyError, match="1 request waits") as raised:
                engine.tiles.plan(asset, "neutral", REDRAW, ADDRESS).draw()
            assert raised.value.retry_after > 0
            assert engine.tiles.plan(asset, "neutral", REDRAW, ADDRESS).key  # needs no device
            with ThreadPoolExecutor(1) as pool:
                ready = pool.submit(engine.ready)
                until(lambda: bool(engine._worker._first))
                free.set()
                assert ready.result(60)  # a device at work is ready
        finally:
            free.set()
            for thread in threads:
                thread.join()
        assert engine.tiles.plan(asset, "neutral", REDRAW, ADDRESS).draw().shape == (64, 64)


def test_many_callers_get_the_same_bits(engine):
    asset = built(engine, new_asset())
    engine.frames.put(asset, "bent", BENT)
    wanted = maps(engine, asset, "bent")
    found = [None] * 6

    def call(index):
        found[index] = maps(engine, asset, "bent")

    threads = [threading.Thread(target=call, args=(i,)) for i in range(len(found))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(same(one, wanted) for one in found)


def test_places_that_do_not_exist_are_not_found(engine):
    asset = built(engine, new_asset())
    for address, named in (
        (TileAddress(1002, 0, 0, 0), "UDIM 1002"),
        (TileAddress(1001, 9, 0, 0), "level 9"),
        (TileAddress(1001, 0, 4, 0), "row 4"),
        (TileAddress(1001, 0, 0, 4), "column 4"),
    ):
        with pytest.raises(NotFoundError, match=named):
            engine.tiles.plan(asset, "neutral", REDRAW, address).draw()
        with pytest.raises(NotFoundError, match=named):
            engine.tiles.plan(asset, "neutral", REDRAW, address)
    with pytest.raises(NotFoundError, match="0123456789abcdef"):
        engine.assets.info("0123456789abcdef")
    with pytest.raises(NotFoundError, match="no frame 'none': there is neutral alone"):
        engine.tiles.plan(asset, "none", REDRAW, ADDRESS).draw()


@pytest.mark.parametrize(
    ("count", "told"),
    [
        (1, "there are neutral and f0$"),
        (7, "there are neutral, f0, f1, f2, f3, f4, f5 and f6$"),
        (8, "there are neutral, f0, f1, f2, f3, f4, f5, f6 and 1 more$"),
        (900, " and 893 more$"),
    ],
)
def test_who_asks_for_no_frame_is_told_of_those_there_are(count: int, told: str) -> None:
    frames, still = Frames(FrameMemory(1 << 20), "a"), np.zeros((1, 3), np.float32)
    for number in range(count):
        frames.put(f"f{number}", Frame.of(still), LogStretch.of(np.ones((1, 2), np.float32)))
    with pytest.raises(NotFoundError, match=told):
        frames.get("none")
