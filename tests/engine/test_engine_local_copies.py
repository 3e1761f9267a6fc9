"""The local store as a cache of the shared one, with a limit of bytes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from engine.engines import built, maps, new_asset, rest, running, same
from engine.test_engine_shared import jobs, patiently
from meshes import deform
from pipeline.scenes import sheet
from rhytid.engine.engine import Engine
from rhytid.errors import SharedStoreError
from rhytid.storage.shared.shared_store import SharedStore
from storage.backends import new_folder

pytestmark = pytest.mark.usefixtures("no_maps_ahead")

# No asset of these tests is so small.
LITTLE = 1000


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A shared store; assets rest at once."""
    monkeypatch.setattr("rhytid.engine.local_copies.RESTING", 0.0)
    return new_folder(tmp_path)


def ids(engine: Engine) -> list[str]:
    return [info.id for info in engine.assets.all()]


def stored(tmp_path: Path) -> set[str]:
    return {home.name for home in (tmp_path / "a" / "assets").iterdir()}


def size_of(folder: Path, asset: str) -> int:
    return sum(file.stat().st_size for file in (folder / "objects" / asset).iterdir())


def test_what_was_used_longest_ago_leaves_and_comes_back(folder: Path, tmp_path: Path) -> None:
    with running(tmp_path / "a", shared_store=str(folder)) as engine:
        first, second = (built(engine, new_asset(seed=seed)) for seed in (1, 2))
        wanted = maps(engine, first, "neutral")
    # Room for two.
    limit = size_of(folder, first) + size_of(folder, second) + LITTLE
    with running(tmp_path / "a", shared_store=str(folder), store_limit=limit) as engine:
        assert set(ids(engine)) == {first, second}
        engine.assets.info(second)
        engine.assets.info(first)
        third = built(engine, new_asset(seed=3))
        assert ids(engine) == [first, third]
        assert stored(tmp_path) == {first, third}

        assert patiently(lambda: engine.assets.info(second)).state == "ready"
        rest(engine)
        assert set(ids(engine)) == stored(tmp_path) == {second, third}
        assert same(patiently(lambda: maps(engine, first, "neutral")), wanted)
    assert set(SharedStore.at(str(folder)).ids()) == {first, second, third}


def test_what_is_answered_without_a_call_is_used(folder: Path, tmp_path: Path) -> None:
    with running(tmp_path / "a", shared_store=str(folder)) as engine:
        first, second = (built(engine, new_asset(seed=seed)) for seed in (1, 2))
    limit = size_of(folder, first) + size_of(folder, second) + LITTLE
    with running(tmp_path / "a", shared_store=str(folder), store_limit=limit) as engine:
        engine.assets.info(first)
        engine.assets.info(second)
        engine.mark(first, "neutral").changes.use(first)
        third = built(engine, new_asset(seed=3))
        assert ids(engine) == [first, third]


def test_what_only_this_machine_has_stays(folder: Path, tmp_path: Path) -> None:
    """With stored frames, with settings that are not pushed, or gone from the shared store."""
    with running(tmp_path / "a", shared_store=str(folder), store_limit=1) as engine:
        framed = built(engine, new_asset(seed=1))
        engine.frames.put(framed, "bent", deform(sheet().positions, 3, 0.15))
        gone = built(engine, new_asset(seed=2))
        SharedStore.at(str(folder)).remove(gone)
        damaged = built(engine, new_asset(seed=3))
        next((folder / "objects" / damaged).iterdir()).unlink()
        built(engine, new_asset(seed=4))
        last = built(engine, new_asset(seed=5))
        assert ids(engine) == [framed, gone, damaged, last]
        engine.frames.delete(framed, "bent")
        latest = built(engine, new_asset(seed=6))
        assert ids(engine) == [gone, damaged, latest]


def test_what_is_fetched_in_place_of_builds_leaves_too(folder: Path, tmp_path: Path) -> None:
    with running(tmp_path / "a", shared_store=str(folder)) as engine:
        for seed in (1, 2):
            built(engine, new_asset(seed=seed))
    with running(tmp_path / "b", shared_store=str(folder), store_limit=1) as other:
        for seed in (1, 2):
            last = built(other, new_asset(seed=seed))
        assert ids(other) == [last]


def test_what_another_machine_has_changed_leaves_and_comes_back_so(
    folder: Path, tmp_path: Path
) -> None:
    with running(tmp_path / "a", shared_store=str(folder)) as engine:
        asset = built(engine, new_asset(seed=1))
    with running(tmp_path / "b", shared_store=str(folder)) as other:
        patiently(lambda: other.assets.change(asset, {"depth": 0.2}))
        rest(other)
    with running(tmp_path / "a", shared_store=str(folder), store_limit=1) as engine:
        assert engine.assets.info(asset).settings["depth"] != 0.2
        last = built(engine, new_asset(seed=2))
        assert ids(engine) == [last]
        assert patiently(lambda: engine.assets.info(asset)).settings["depth"] == 0.2


def test_a_store_that_is_away_is_asked_once_for_room(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def away(self: SharedStore, id: str) -> bool:
        asked.append(id)
        raise SharedStoreError("away")

    with running(tmp_path / "a", shared_store=str(folder), store_limit=None) as engine:
        all = [built(engine, new_asset(seed=seed)) for seed in (1, 2, 3)]
    with running(tmp_path / "a", shared_store=str(folder), store_limit=1) as engine:
        monkeypatch.setattr(SharedStore, "holds", away)
        engine.shared._make_room()
        assert sorted(ids(engine)) == sorted(all)
    assert len(asked) == 1


def test_what_was_used_a_moment_ago_stays(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rhytid.engine.local_copies.RESTING", 60.0)
    with running(tmp_path / "a", shared_store=str(folder), store_limit=1) as engine:
        all = [built(engine, new_asset(seed=seed)) for seed in (1, 2)]
        assert ids(engine) == all


def test_a_caller_of_what_has_left_asks_again(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A frame is measured while its asset leaves: it is stored when it is sent again."""
    with running(tmp_path / "a", shared_store=str(folder), store_limit=1) as engine:
        asset = built(engine, new_asset(seed=1))
        store, bent = type(engine.frames).store, deform(sheet().positions, 3, 0.15)

        def late(*arguments: Any, **named: Any) -> Any:
            monkeypatch.undo()
            monkeypatch.setattr("rhytid.engine.local_copies.RESTING", 0.0)
            built(engine, new_asset(seed=2))
            assert asset not in ids(engine)
            return store(*arguments, **named)

        monkeypatch.setattr(type(engine.frames), "store", late)
        patiently(lambda: engine.frames.put(asset, "bent", bent))
        assert [frame.name for frame in engine.frames.all(asset)] == ["neutral", "bent"]
        assert jobs(engine, "fetch") == ["done"]
