"""Nobody blocks anybody: assets take turns, and what is heavy is drawn in bounded steps."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from time import sleep
from typing import Any

import pytest

from engine.engines import QUERIES, REDRAW, built, draw, new_asset, running
from engine.test_engine_together import occupied, until
from rhytid.device.launches import DrawingPace
from rhytid.domain.tiles import TileAddress
from rhytid.engine.call_context import drawn_live
from rhytid.engine.engine import Engine
from rhytid.engine.messages import MapQuery
from rhytid.engine.worker import DeviceWorker
from rhytid.errors import BusyError, LimitError
from rhytid.pipeline.redraw import launch_blocks
from rhytid.pipeline.work import BLOCK

WHOLE = TileAddress(1001, 0, 0, 0)
HEAVY = {"tile_size": 256}


def test_turns_are_served_in_rotation() -> None:
    order: list[str] = []
    with closing(DeviceWorker(16)) as worker, ThreadPoolExecutor(16) as pool, occupied(worker):
        for count, turn in enumerate(["heavy"] * 4 + ["light"] * 2 + ["other"], 1):
            pool.submit(worker.call, lambda t=turn, n=count: order.append(f"{t} {n}"), turn)
            until(lambda n=count: worker.waiting == n)  # type: ignore[misc]
    assert order == ["heavy 1", "light 5", "other 7", "heavy 2", "light 6", "heavy 3", "heavy 4"]


def test_who_waits_when_the_worker_ends_is_refused() -> None:
    worker = DeviceWorker(1)
    with ThreadPoolExecutor(3) as pool:
        with occupied(worker):
            asked = [pool.submit(worker.call, lambda: 1)]
            until(lambda: worker.waiting == 1)
            asked.append(pool.submit(worker.call_patiently, lambda: 2))
            closing_it = pool.submit(worker.close)
            for future in asked:
                with pytest.raises(Exception, match="shutting down"):
                    future.result(60)
        closing_it.result(60)


def test_a_probe_that_was_given_up_does_not_hinder_the_end() -> None:
    worker = DeviceWorker(1)
    with ThreadPoolExecutor(1) as pool:
        with occupied(worker):
            for _ in range(3):
                assert not worker.answers(lambda: True, 0)
            assert not worker._first, "nobody asks for them any more"
            closing_it = pool.submit(worker.close)
            until(lambda: worker._closed)
        closing_it.result(60)
    assert not worker.runs


def test_a_probe_that_never_ends_is_not_awaited() -> None:
    free = threading.Event()
    with closing(DeviceWorker(1)) as worker, ThreadPoolExecutor(1) as pool:
        asked = pool.submit(worker.answers, lambda: free.wait(60), 0.2)
        try:
            assert asked.result(30) is False
        finally:
            free.set()


class Shared:
    """A worker whose calls take the time that they are given, and their order."""

    def __init__(self, worker: DeviceWorker, pool: ThreadPoolExecutor) -> None:
        self.worker, self.pool, self.order, self.now = worker, pool, list[str](), 0.0
        worker._clock = lambda: self.now

    def ask(self, name: str, live: bool, seconds: float, turn: str = "asset") -> None:
        """Queue a call."""

        def task() -> None:
            self.order.append(name)
            self.now += seconds

        def call() -> None:
            with drawn_live(live):
                self.worker.call(task, turn)

        before = self.worker.waiting
        self.pool.submit(call)
        until(lambda: self.worker.waiting == before + 1)


@pytest.fixture
def shared() -> Iterator[Shared]:
    with closing(DeviceWorker(64)) as worker, ThreadPoolExecutor(80) as pool:
        yield Shared(worker, pool)


def test_a_live_call_waits_for_the_call_at_work_alone(shared: Shared) -> None:
    with occupied(shared.worker):
        for _ in range(64):
            shared.ask("tile", False, 0.01)
        shared.ask("live", True, 0.01)
    shared.pool.shutdown()
    assert shared.order == ["live", *["tile"] * 64]


@pytest.mark.parametrize(("live", "tile"), [(0.01, 0.01), (0.03, 0.01), (0.01, 0.03)])
def test_live_and_the_rest_have_half_of_the_time_each(
    shared: Shared, live: float, tile: float
) -> None:
    with occupied(shared.worker):
        for number in range(30):
            shared.ask("tile", False, tile, turn=f"asset {number % 3}")
            shared.ask("live", True, live)
    shared.pool.shutdown()
    running = {"live": 0.0, "tile": 0.0}
    until_one_is_through = min(30 * live, 30 * tile)
    for name in shared.order:
        running[name] += live if name == "live" else tile
        if max(running.values()) >= until_one_is_through:
            break
        assert abs(running["live"] - running["tile"]) <= max(live, tile) + 1e-9


def test_who_did_not_wait_has_no_claim_to_time_that_passed(shared: Shared) -> None:
    with occupied(shared.worker):
        for _ in range(20):
            shared.ask("live", True, 1.0)
    until(lambda: len(shared.order) == 20 and not shared.worker._runs)
    shared.order.clear()
    with occupied(shared.worker):
        for _ in range(10):
            shared.ask("tile", False, 1.0)
            shared.ask("live", True, 1.0)
    shared.pool.shutdown()
    assert shared.order == ["live", "tile"] * 10


def test_a_full_queue_leaves_live_calls_theirs() -> None:
    with closing(DeviceWorker(2)) as worker, ThreadPoolExecutor(8) as pool:
        with occupied(worker):
            shared = Shared(worker, pool)
            shared.ask("tile", False, 1.0)
            shared.ask("tile", False, 1.0)
            with pytest.raises(BusyError):
                worker.call(lambda: None)
            shared.ask("live", True, 1.0)
            shared.ask("live", True, 1.0)
            with drawn_live(), pytest.raises(BusyError):
                worker.call(lambda: None)
        pool.shutdown()
    assert sorted(shared.order) == ["live", "live", "tile", "tile"]


def test_a_probe_goes_before_all_that_wait() -> None:
    order: list[str] = []

    def run(name: str) -> bool:
        order.append(name)
        return True

    with closing(DeviceWorker(2)) as worker, ThreadPoolExecutor(3) as pool:
        with occupied(worker):
            for count, name in enumerate(["one", "other"], 1):
                pool.submit(worker.call, lambda name=name: run(name))
                until(lambda n=count: worker.waiting == n)  # type: ignore[misc]
            ready = pool.submit(worker.answers, lambda: run("probe"), 60)
            until(lambda: bool(worker._first))
            assert not worker.answers(lambda: run("late"), 0), "nothing ended meanwhile"
        assert ready.result(60)
    assert order == ["probe", "one", "other"]
    with pytest.raises(BusyError, match="shutting down"):
        worker.answers(lambda: True, 60)


@pytest.fixture
def launches(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The work of every launch over blocks, where a block is more than a piece should be."""
    found: list[float] = []
    monkeypatch.setattr("rhytid.device.launches.PIECE_SECONDS", 1e-6)
    monkeypatch.setattr(DrawingPace, "took", lambda *_: None)

    def spy(device: Any, program: str, kernel: str, settings: Any, square: Any,
            *arguments: Any, **named: Any) -> None:  # fmt: skip
        found.append(square[2])
        launch_blocks(device, program, kernel, settings, square, *arguments, **named)

    for module in ("redraw", "bin_maker"):
        monkeypatch.setattr(f"rhytid.pipeline.{module}.launch_blocks", spy)
    return found


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> dict[MapQuery, bytes]:
    """The tiles of a heavy asset, each drawn at once."""
    with running(tmp_path_factory.mktemp("plain")) as engine:
        asset = built(engine, new_asset(**HEAVY))
        return {query: draw(engine, asset, "neutral", query, WHOLE).tobytes() for query in QUERIES}


@pytest.mark.parametrize("query", QUERIES, ids=lambda query: query.method)
def test_a_heavy_tile_is_drawn_block_by_block_with_the_same_bits(
    engine: Engine, launches: list[float], plain: dict[MapQuery, bytes], query: MapQuery
) -> None:
    asset = built(engine, new_asset(**HEAVY))
    assert launches
    launches.clear()
    assert draw(engine, asset, "neutral", query, WHOLE).tobytes() == plain[query]
    assert set(launches) <= {BLOCK}
    assert query.method == "binned" or len(launches) >= 16  # maps of bins were made ahead


@pytest.mark.slow
@pytest.mark.parametrize("shape", [{}, {"cushion": 0.5}], ids=["plain", "cushion"])
def test_heavy_bins_are_the_same_bits(
    tmp_path: Path, request: pytest.FixtureRequest, shape: dict[str, float]
) -> None:
    def codes(folder: str) -> list[bytes]:
        with running(tmp_path / folder) as engine:
            asset = built(engine, new_asset(**HEAVY, shape=shape))
            query = MapQuery("binned")
            return [draw(engine, asset, "neutral", query, WHOLE).tobytes()]

    at_once = codes("one")
    request.getfixturevalue("launches")
    assert codes("other") == at_once


@pytest.mark.parametrize("query", QUERIES, ids=lambda query: query.method)
def test_another_asset_is_drawn_between_any_two_steps(
    engine: Engine, launches: list[float], query: MapQuery, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whenever the other asset asks, it waits for one step of the heavy one."""
    light = built(engine, new_asset(seed=2))
    heavy = built(engine, new_asset(**HEAVY))
    engine._on_device.run(engine._on_device.loaded(_asset(engine, heavy)).mesh.cache.clear)
    draw(engine, light, "neutral", REDRAW, WHOLE)
    turns = _turns(engine, monkeypatch)
    with ThreadPoolExecutor(2) as pool:
        with occupied(engine._worker):
            first = pool.submit(draw, engine, heavy, "neutral", query, WHOLE)
            until(lambda: engine._worker.waiting == 1)
            asking = pool.submit(_ask, engine, light, 5)
            until(lambda: engine._worker.waiting == 2)
        asking.result(60)
        first.result(60)
    waits = [waited for turn, waited in turns if turn == light]
    assert len(waits) == 5
    assert [turn for turn, _ in turns].count(heavy) >= 16
    assert max(waits) <= 2  # one, and one that begins while the call is put into the queue


def _ask(engine: Engine, asset: str, times: int) -> None:
    for _ in range(times):
        draw(engine, asset, "neutral", REDRAW, WHOLE)


def _asset(engine: Engine, asset: str) -> Any:
    return engine.assets._assets.get(asset)


def _turns(engine: Engine, monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, int]]:
    """Whose calls the device runs from now on, in order, and how many it ran before each while that
    waited."""
    turns: list[tuple[Any, int]] = []
    run = engine._worker._run

    def spy(task: Callable[[], Any], turn: Any, *, block: bool) -> Any:
        before = len(turns)

        def told() -> Any:
            turns.append((turn, len(turns) - before))
            return task()

        return run(told, turn, block=block)

    monkeypatch.setattr(engine._worker, "_run", spy)
    return turns


def test_what_would_take_too_long_is_refused_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with running(tmp_path / "fast") as engine:
        work = engine._on_device.loaded(_asset(engine, built(engine, new_asset()))).mesh.elements
    monkeypatch.setattr("rhytid.pipeline.work._BLOCK_SECONDS", 1e9)
    pace = work[1001].work.total / 10
    monkeypatch.setattr("rhytid.engine.engine.remembered_pace", lambda *_: pace)
    with running(tmp_path / "slow", cache=tmp_path, draw_seconds=1) as engine:
        with pytest.raises(LimitError, match=r"more than 1 s \(RHYTID_DRAW_SECONDS\)"):
            engine.assets.create(new_asset())
        assert engine.assets.all() == []
    with running(tmp_path / "slow", cache=tmp_path, draw_seconds=20) as engine:
        asset = built(engine, new_asset())
        before = draw(engine, asset, "neutral", REDRAW, WHOLE).tobytes()
        builder = engine.assets._builder
        builder._limit = replace(builder._limit, seconds=1)
        with pytest.raises(LimitError, match=r"more than 1 s \(RHYTID_DRAW_SECONDS\)"):
            engine.assets.change(asset, {"shape": {"least_half_width": 4.0}})
        assert draw(engine, asset, "neutral", REDRAW, WHOLE).tobytes() == before
    # What is stored is drawn, whatever the limit is by then.
    with running(tmp_path / "slow", cache=tmp_path, draw_seconds=1) as engine:
        assert draw(engine, asset, "neutral", REDRAW, WHOLE).tobytes() == before


def test_a_call_runs_on_its_own_thread_where_nothing_else_runs() -> None:
    with closing(DeviceWorker(1)) as worker, ThreadPoolExecutor(1) as pool:
        own = pool.submit(threading.get_ident).result()
        with pytest.raises(KeyError):
            pool.submit(worker.call, lambda: {}["absent"]).result(60)
        assert pool.submit(worker.call, threading.get_ident).result(60) == own
        with occupied(worker):
            other = pool.submit(worker.call, threading.get_ident)
            until(lambda: worker.waiting == 1)
        assert other.result(60) not in (threading.get_ident(), own)


def test_an_interrupt_meets_no_task_of_the_device() -> None:
    with closing(DeviceWorker(1)) as worker:
        assert worker.call(threading.current_thread) is not threading.main_thread()


def test_calls_of_many_threads_never_overlap() -> None:
    inside, most = 0, 0

    def task() -> None:
        nonlocal inside, most
        inside += 1
        most = max(most, inside)
        sleep(0.0005)
        inside -= 1

    with closing(DeviceWorker(64)) as worker, ThreadPoolExecutor(8) as pool:
        for done in [pool.submit(worker.call, task, turn) for turn in range(8) for _ in range(8)]:
            done.result(60)
    assert most == 1
