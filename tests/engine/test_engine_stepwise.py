"""Maps made ahead, step by step: others draw in between, and what changes meanwhile is noticed."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from engine.engines import BINNED, CONVOLVED, REDRAW, built, draw, new_asset, rest, running
from rhytid.device.buffer import Buffer
from rhytid.device.runtime import Steps
from rhytid.domain.tiles import TileAddress
from rhytid.engine.call_context import abandoned_when
from rhytid.engine.device_assets.asset import DeviceAsset
from rhytid.engine.device_assets.bins import DeviceBins
from rhytid.engine.device_assets.drawing import DeviceNeutral
from rhytid.engine.device_assets.mesh import DeferredWork
from rhytid.engine.engine import Engine
from rhytid.engine.job import Job
from rhytid.engine.messages import NewAsset
from rhytid.errors import CancelledError
from rhytid.pipeline.bin_maker import BinMaker

ADDRESS = TileAddress(1001, 0, 0, 0)


class Held:
    """Stops the thread that makes maps ahead between two of its steps, once."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.entered, self.free = threading.Event(), threading.Event()
        step, make = Steps.step, BinMaker.tile
        self._making = threading.local()

        def marked(maker: BinMaker, *place: Any) -> Any:
            self._making.steps = 0
            return make(maker, *place)

        def held(steps: Steps, task: Callable[[], Any]) -> Any:
            found = step(steps, task)
            if getattr(self._making, "steps", None) is not None:
                self._making.steps += 1
                if self._making.steps == 3:
                    self.entered.set()
                    assert self.free.wait(60)
            return found

        monkeypatch.setattr(BinMaker, "tile", marked)
        monkeypatch.setattr(Steps, "step", held)


@pytest.fixture
def held(monkeypatch: pytest.MonkeyPatch) -> Iterator[Held]:
    held = Held(monkeypatch)
    yield held
    held.free.set()


def started(engine: Engine, held: Held, new: NewAsset) -> str:
    """An asset whose maps are on their way."""
    asset = engine.assets.create(new).id
    assert held.entered.wait(60)
    return asset


def codes(engine: Engine, asset: str) -> bytes:
    return engine.tiles.bin_tile(asset, ADDRESS, "wrinkles", 0, 0).tobytes()


@pytest.fixture(scope="module")
def wanted(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, bytes]:
    """A tile and codes of it, made by the request that needs them."""
    with running(tmp_path_factory.mktemp("wanted")) as engine:
        asset = built(engine, new_asset())
        for key in list(engine._device.budget._kept):
            if "bins" in key:  # type: ignore[operator]
                engine._on_device.run(engine._device.budget.discard, key)
        return draw(engine, asset, "neutral", BINNED, ADDRESS).tobytes(), codes(engine, asset)


def test_others_draw_between_two_steps_and_results_are_the_same(
    tmp_path: Path, held: Held, wanted: tuple[bytes, bytes]
) -> None:
    with running(tmp_path) as engine:
        asset = started(engine, held, new_asset())
        other = draw(engine, asset, "neutral", REDRAW, ADDRESS)  # while the maps are half made
        assert np.isfinite(other).all()
        assert not held.free.is_set()
        held.free.set()
        rest(engine)
        assert (
            draw(engine, asset, "neutral", BINNED, ADDRESS).tobytes(),
            codes(engine, asset),
        ) == (wanted)


def test_maps_that_a_request_made_meanwhile_stay(
    tmp_path: Path, held: Held, wanted: tuple[bytes, bytes]
) -> None:
    with running(tmp_path) as engine:
        asset = started(engine, held, new_asset())
        assert codes(engine, asset) == wanted[1]
        held.free.set()
        rest(engine)
        used = engine._device.budget.used
        assert codes(engine, asset) == wanted[1]
        assert engine._device.budget.used == used
        engine.assets.delete(asset)
        assert engine._device.budget.used == 0


def test_maps_that_are_there_are_not_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with running(tmp_path) as engine:
        asset = built(engine, new_asset())
        made: list[Any] = []
        make = BinMaker.tile
        monkeypatch.setattr(
            BinMaker, "tile", lambda maker, *place: made.append(place) or make(maker, *place)
        )
        engine.assets._builder.prepare_bins(engine.assets._assets.get(asset))
        rest(engine)
        assert made == []


def test_the_first_maps_are_said_to_wait_for_kernels(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[str] = []
    progress, tell = Job.progress, Job.tell

    def reached(job: Job, share: float, stage: str, detail: str = "") -> None:
        told.append(detail)
        progress(job, share, stage, detail)

    def waits(job: Job, detail: str) -> None:
        tell(job, detail)
        told.append(job.info.detail)

    monkeypatch.setattr(Job, "progress", reached)
    monkeypatch.setattr(Job, "tell", waits)
    with running(tmp_path) as engine:
        built(engine, new_asset())
        first = [one for one in told if one.startswith("tile")]
        told.clear()
        built(engine, new_asset(seed=2))
    steps = list(dict.fromkeys(first))
    assert steps[:3] == ["tile 1 of 16", "tile 1 of 16, compiling kernels", "tile 2 of 16"]
    assert "tile 1 of 16" in told
    assert not any("compiling" in one for one in told)


@pytest.mark.parametrize(
    ("part", "lacks"),
    [
        (DeviceBins, DeferredWork(bins=[ADDRESS])),
        (DeviceNeutral, DeferredWork(neutral=(CONVOLVED, 1001, (0, 0, 64)))),
    ],
)
def test_what_is_kept_stays_whole_when_its_caller_leaves_then(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, part: Any, lacks: DeferredWork
) -> None:
    """Its buffers were given back though it was kept, and became those of others."""
    kept: list[Any] = []
    keep = part._keep

    def noted(self: Any, *arguments: Any) -> Any:
        kept.append(arguments[-1])
        return keep(self, *arguments)

    with running(tmp_path) as engine:
        found = engine.assets._assets.get(built(engine, new_asset()))
        engine._on_device.run(found.on_device.mesh.cache.clear)
        monkeypatch.setattr(part, "_keep", noted)
        with abandoned_when(lambda: bool(kept)), pytest.raises(CancelledError):
            engine._on_device._make(found, lacks)
        (made,) = kept
        of_made = [one for one in vars(made).values() if isinstance(one, Buffer)]
        assert of_made != []
        assert not any(buffer.released for buffer in of_made)


@pytest.mark.parametrize("change", ["settings", "eviction", "removal"])
def test_half_made_maps_are_given_back_when_their_asset_changes(
    tmp_path: Path, held: Held, change: str
) -> None:
    with running(tmp_path) as engine:
        asset = started(engine, held, new_asset())
        if change == "settings":
            engine.assets.change(asset, {"depth": 0.5})
        elif change == "eviction":
            engine._on_device.drop(engine.assets._assets.get(asset))
        else:
            engine.assets.delete(asset)
        held.free.set()
        rest(engine)
        states = {job.info.kind: job.info.state for job in engine.jobs._known()}
        assert states["bins"] == ("cancelled" if change == "removal" else "done")
        if change != "removal":
            assert np.isfinite(draw(engine, asset, "neutral", BINNED, ADDRESS)).all()
            engine.assets.delete(asset)
        assert engine._device.budget.used == 0


def test_nothing_is_warmed_up_with_settings_that_came_meanwhile(
    tmp_path: Path, held: Held, monkeypatch: pytest.MonkeyPatch
) -> None:
    warmed: list[float] = []
    warm_up = DeviceAsset.warm_up_blend

    def counted(resident: DeviceAsset, address: TileAddress) -> None:
        warmed.append(resident.mesh.settings.depth)
        warm_up(resident, address)

    monkeypatch.setattr(DeviceAsset, "warm_up_blend", counted)
    with running(tmp_path) as engine:
        asset = started(engine, held, new_asset())
        engine.assets.change(asset, {"depth": 0.5})
        held.free.set()
        rest(engine)
    assert warmed == [0.5]  # by the job of the change alone


def test_others_run_between_the_kernels_that_are_warmed_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    order: list[str] = []
    others: list[threading.Thread] = []
    stretch, blend = DeviceAsset.warm_up_stretch, DeviceAsset.warm_up_blend

    def first(resident: DeviceAsset) -> None:
        stretch(resident)
        order.append("stretch")
        task = partial(order.append, "other")
        call = partial(engine._on_device.run_patiently, task)
        others.append(threading.Thread(target=call))
        others[-1].start()
        while engine._worker.waiting == 0:
            time.sleep(0.001)

    def then(resident: DeviceAsset, address: TileAddress) -> None:
        order.append("blend")
        blend(resident, address)

    monkeypatch.setattr(DeviceAsset, "warm_up_stretch", first)
    monkeypatch.setattr(DeviceAsset, "warm_up_blend", then)
    with running(tmp_path) as engine:
        built(engine, new_asset())
        for other in others:
            other.join()
    assert order == ["stretch", "other", "blend"]
