"""Machines that go in step with a shared store: each has what the others have changed."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from engine.engines import REDRAW, built, draw, new_asset, rest, running
from engine.test_engine_shared import FIRST, jobs
from meshes import deform
from pipeline.scenes import sheet
from processes.served import await_value
from rhytid.domain.expressions import Expressions
from rhytid.engine.assets.builder import AssetBuilder
from rhytid.engine.engine import Engine
from rhytid.errors import (
    ConflictError,
    NotFoundError,
    SharedDamageError,
    SharedStoreError,
)
from rhytid.storage.shared.shared_store import SharedStore, manifest_digest
from storage.backends import new_folder

BENT = deform(sheet().positions, 3, 0.15)


@pytest.fixture
def shared(place: str) -> str:
    """The shared store of both."""
    return place


@contextmanager
def two(tmp_path: Path, shared: str, **changes: Any) -> Iterator[tuple[Engine, Engine]]:
    """Engines of two machines."""
    given: Any = {"shared_store": shared, "in_step": True, **changes}
    with running(tmp_path / "a", **given) as one, running(tmp_path / "b", **given) as other:
        yield one, other


def follow(engine: Engine, asset: str, *, replace: bool = True) -> Any:
    found = engine.assets.follow(asset, replace=replace)
    assert found is not None
    return found


def with_shapes(scale: float = 1.0) -> Any:
    mesh = sheet()
    moved = Expressions.checked(scale * mesh.positions[None], len(mesh.positions), ["jawOpen"])
    return replace(new_asset(mesh), shapes=moved)


def test_what_one_builds_and_changes_the_other_has(tmp_path: Path, shared: str) -> None:
    with two(tmp_path, shared) as (one, other):
        info = one.assets.create(new_asset())
        asset = info.id
        assert one.jobs.get(info.job or "").wait(60)
        there = SharedStore.at(shared)
        assert there.holds(asset), "a build that has ended is shared"
        found = follow(other, asset)
        assert (found.info.state, found.replaced) == ("ready", True)
        assert found.manifest == manifest_digest(there.index(asset).encode())

        other.frames.put(asset, "bent", BENT)
        before = draw(other, asset, "bent", REDRAW, FIRST)
        one.assets.change(asset, {"shape": {"wrinkle_bulge": 5.0}})
        found = follow(other, asset, replace=False)
        assert not found.replaced
        assert found.info.settings == one.assets.info(asset).settings
        one.frames.put(asset, "bent", BENT)
        wanted = draw(one, asset, "bent", REDRAW, FIRST)
        assert np.array_equal(draw(other, asset, "bent", REDRAW, FIRST), wanted)
        assert not np.array_equal(before, wanted)
        assert follow(other, asset) == replace(found, info=follow(other, asset).info)
        rest(other)
        assert jobs(other, "push") == [], "what was followed is not pushed back"


def test_other_shapes_are_fetched_where_that_is_allowed(tmp_path: Path, shared: str) -> None:
    with two(tmp_path, shared) as (one, other):
        asset = built(one, with_shapes())
        follow(other, asset)
        other.frames.put(asset, "bent", BENT)
        built(one, with_shapes(2.0))
        assert other.assets.follow(asset, replace=False) is None
        assert other.frames.info(asset, "bent")
        found = follow(other, asset)
        assert found.replaced
        assert other.assets.shapes(asset).positions[0, 0, 0] == pytest.approx(
            one.assets.shapes(asset).positions[0, 0, 0]
        )
        with pytest.raises(NotFoundError):
            other.frames.info(asset, "bent")
        assert other.frames.put(asset, "bent", BENT).name == "bent"


def test_what_one_removes_the_other_has_no_more(tmp_path: Path, shared: str) -> None:
    with two(tmp_path, shared) as (one, other):
        asset = built(one, new_asset())
        follow(other, asset)
        one.assets.delete(asset, shared=True)
        with pytest.raises(NotFoundError):
            follow(other, asset)
        assert other.assets.all() == []
        assert not any((tmp_path / "b" / "assets").iterdir())
        assert SharedStore.at(shared).ids() == []


def test_what_is_not_shared_yet_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shared = str(new_folder(tmp_path))

    def away(*arguments: Any, **named: Any) -> None:
        raise SharedStoreError("it is away")

    with two(tmp_path, shared) as (one, other):
        asset = built(one, new_asset())
        follow(other, asset)
        with monkeypatch.context() as patch:
            patch.setattr("rhytid.engine.shared_calls.FORGOTTEN", 0.0)
            patch.setattr(SharedStore, "push", away)
            with pytest.raises(SharedStoreError):
                one.assets.change(asset, {"depth": 0.5})
            unshared = built(one, new_asset(seed=2))
            assert one.assets.info(unshared).state == "ready", "it is pushed later"
        one.shared._calls._failures.forget("")  # type: ignore[union-attr]
        other.assets.change(asset, {"depth": 0.25})
        assert follow(one, asset).info.settings["depth"] == 0.5
        assert follow(one, unshared).info.state == "ready"
        assert not one.assets.leave(asset)
        assert not one.assets.leave(unshared)
        one.shared.push(asset)
        rest(one)
        assert follow(other, asset).info.settings["depth"] == 0.5, "the last push stays"


def test_an_asset_leaves_by_the_rule_of_the_limit_and_comes_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shared = str(new_folder(tmp_path))
    with running(tmp_path / "a", shared_store=shared, in_step=True) as engine:
        asset = built(engine, new_asset())
        engine.frames.put(asset, "bent", BENT)
        assert not engine.assets.leave(asset), "it was used a moment ago"
        monkeypatch.setattr("rhytid.engine.local_copies.RESTING", 0.0)
        held = threading.Event()
        done = threading.Event()

        def hold() -> None:
            with engine.assets._assets.find(asset).lock:  # type: ignore[union-attr]
                held.set()
                done.wait(60)

        holding = threading.Thread(target=hold)
        holding.start()
        held.wait(60)
        assert not engine.assets.leave(asset), "its lock is not waited for"
        done.set()
        holding.join()
        assert engine.assets.leave(asset)
        assert engine.assets._assets.frame_memory._used == 0
        assert engine.assets.all() == []
        assert engine.assets.leave(asset), "it is not here"
        assert engine.assets.info(asset).state == "ready"
    with running(tmp_path / "c") as alone:
        other = built(alone, new_asset(seed=3))
        assert not alone.assets.leave(other), "there is no other copy"


def test_a_failed_build_gives_way_to_what_another_machine_built(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shared = str(new_folder(tmp_path))

    def fail(*arguments: Any) -> None:
        raise ConflictError("no")

    with two(tmp_path, shared) as (one, other):
        with monkeypatch.context() as patch:
            patch.setattr(AssetBuilder, "_build", fail)
            asset = one.assets.create(new_asset()).id
            rest(one)
        assert follow(one, asset).info.state == "failed"
        built(other, new_asset())
        found = follow(one, asset)
        assert (found.info.state, found.replaced) == ("ready", True)


def test_damaged_settings_are_named_and_replaced_by_others(tmp_path: Path) -> None:
    place = new_folder(tmp_path)
    with two(tmp_path, str(place)) as (one, other):
        asset = built(one, new_asset())
        follow(other, asset)
        before = set((place / "objects" / asset).iterdir())
        one.assets.change(asset, {"depth": 0.5})
        [settings] = set((place / "objects" / asset).iterdir()) - before
        settings.write_bytes(b"{" * settings.stat().st_size)
        with pytest.raises(SharedDamageError, match=settings.name):
            other.assets.follow(asset, replace=True)
        one.assets.change(asset, {"depth": 0.25})
        assert follow(other, asset).info.settings["depth"] == 0.25


def test_two_machines_that_build_and_remove_at_once_agree(tmp_path: Path) -> None:
    shared = str(new_folder(tmp_path))
    with two(tmp_path, shared) as (one, other):
        begin = threading.Barrier(2)

        def build(engine: Engine) -> None:
            begin.wait(60)
            built(engine, new_asset())

        threads = [threading.Thread(target=build, args=(each,)) for each in (one, other)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(120)
        [asset] = SharedStore.at(shared).ids()
        assert SharedStore.at(shared).holds(asset)
        assert follow(one, asset).manifest == follow(other, asset).manifest


def test_a_change_waits_for_the_push_that_came_in_place_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A push that is tried again cancels the one that waits; it fails, and the change with it."""
    shared = str(new_folder(tmp_path))
    busy, going = threading.Event(), threading.Event()
    push = SharedStore.push

    def slowly(store: SharedStore, made: Any, report: Any, **named: Any) -> bool:
        busy.set()
        assert going.wait(60)
        if made.index.asset == asset:
            raise SharedStoreError("it is away")
        return push(store, made, report, **named)

    with running(tmp_path / "a", shared_store=shared, in_step=True) as engine:
        other, asset = (built(engine, new_asset(seed=seed)) for seed in (1, 2))
        monkeypatch.setattr(SharedStore, "push", slowly)
        failed: list[BaseException] = []

        def change() -> None:
            try:
                engine.assets.change(asset, {"depth": 0.5})
            except SharedStoreError as error:
                failed.append(error)

        first = threading.Thread(target=lambda: engine.assets.change(other, {"depth": 0.5}))
        first.start()
        assert busy.wait(60), "the thread that pushes is at work"
        changing = threading.Thread(target=change)
        changing.start()
        await_value(lambda: [job for job in engine.jobs.of(asset) if not job.ended])
        again = engine.shared.push(asset)
        changing.join(1)
        assert changing.is_alive()
        going.set()
        changing.join(60)
        first.join(60)
        assert again is not None
        assert again.info.state == "failed"
        assert len(failed) == 1
        assert engine.shared._pushes == {}
