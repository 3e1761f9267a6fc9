"""Engines that share a store: what one builds, the others fetch."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pytest

from api.asking import is_problem
from api.live import serving
from engine.engines import REDRAW, built, finish, maps, new_asset, rest, running, same
from meshes import deform
from pipeline.scenes import sheet
from rhytid.domain.expressions import Expressions
from rhytid.domain.residual import Residual
from rhytid.domain.tiles import TileAddress
from rhytid.engine.assets.builder import AssetBuilder
from rhytid.engine.engine import Engine
from rhytid.errors import (
    FetchingError,
    NotFoundError,
    NotReadyError,
    QueryError,
    SharedDamageError,
    SharedStoreError,
)
from rhytid.storage.shared.shared_store import SharedStore
from storage.backends import new_folder

T = TypeVar("T")
FIRST = TileAddress(1001, 0, 0, 0)
LONG = 60.0


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return new_folder(tmp_path)


@pytest.fixture
def unbuilt(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """From its call on nothing can be built."""

    def forbid() -> None:
        monkeypatch.setattr(AssetBuilder, "_build", None)

    return forbid


def patiently(call: Callable[[], T]) -> T:
    """What a client gets that asks again while the asset is fetched."""
    until = time.monotonic() + LONG
    while time.monotonic() < until:
        with suppress(FetchingError, NotReadyError):
            return call()
        time.sleep(0.05)
    raise AssertionError("it is never there")


def jobs(engine: Engine, kind: str) -> list[str]:
    """States of the jobs of a kind."""
    rest(engine)
    return [job.info.state for job in engine.jobs._known() if job.info.kind == kind]


@pytest.mark.slow
def test_an_asset_that_is_used_is_fetched(
    bucket: str, tmp_path: Path, unbuilt: Callable[[], None]
) -> None:
    mesh = sheet(udims=2)
    moved = Expressions.checked(mesh.positions[None], len(mesh.positions), ["jawOpen"])
    bent = deform(mesh.positions, 3, 0.15)
    with running(tmp_path / "a", shared_store=bucket) as one:
        asset = built(one, replace(new_asset(mesh), shapes=moved))
        one.assets.change(asset, {"shape": {"wrinkle_bulge": 5.0}})
        rest(one)
        one.frames.put(asset, "bent", bent)
        wanted, known = maps(one, asset, "bent"), one.assets.info(asset)
    unbuilt()
    with running(tmp_path / "b", shared_store=bucket) as other:
        assert other.assets.all() == []
        patiently(lambda: other.frames.put(asset, "bent", bent))
        assert same(maps(other, asset, "bent"), wanted)
        assert other.assets.info(asset).settings == known.settings
        assert other.assets.shapes(asset).names == ("jawOpen",)
        assert jobs(other, "fetch") == ["done"]
        assert jobs(other, "push") == []
    with running(tmp_path / "b") as alone:
        assert [info.id for info in alone.assets.all()] == [asset]


def test_an_asset_that_is_sent_is_fetched_in_place_of_a_build(
    folder: Path, tmp_path: Path, unbuilt: Callable[[], None]
) -> None:
    mesh = sheet()
    relief = np.linspace(0.0, 0.1, 256**2, dtype=np.float32).reshape(256, 256)
    new = replace(
        new_asset(mesh),
        frames=deform(mesh.positions, 3, 0.15)[None],
        residual=Residual.of({1001: relief}),
    )
    with running(tmp_path / "a", shared_store=str(folder)) as one:
        asset = built(one, new)
        wanted = maps(one, asset, "0001")
    unbuilt()
    with running(tmp_path / "b", shared_store=str(folder)) as other:
        assert built(other, new) == asset
        assert same(maps(other, asset, "0001"), wanted)
        assert jobs(other, "push") == []


def test_a_caller_is_told_while_an_asset_is_fetched(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with running(tmp_path / "a", shared_store=str(folder)) as one:
        asset = built(one, new_asset())
    fetch, may = SharedStore.fetch, threading.Event()

    def slow(*arguments: Any, **named: Any) -> Any:
        assert may.wait(LONG)
        return fetch(*arguments, **named)

    monkeypatch.setattr(SharedStore, "fetch", slow)
    monkeypatch.setattr("rhytid.engine.shared_assets.PATIENCE", 0.05)
    path = f"/v1/assets/{asset}/frames/neutral/tiles/1001/0/0/0"
    with running(tmp_path / "b", shared_store=str(folder)) as other, serving(other) as client:
        for _ in range(2):
            answer = client.get(path)
            assert is_problem(answer, 503, "fetching"), answer.text
            assert answer.headers["retry-after"] == "1"
        [job] = [job.info for job in other.jobs._known()]
        assert (job.kind, job.id in answer.json()["detail"]) == ("fetch", True)
        assert client.get(f"/v1/jobs/{job.id}").json()["state"] == "running"
        may.set()
        finish(other, job.id)
        assert client.get(path).status_code == 200


def test_a_silent_shared_store_keeps_few_callers(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers, found = threading.Event(), []

    def silent(self: SharedStore, id: str) -> None:
        answers.wait(LONG)
        raise NotFoundError(id)

    def ask(number: int) -> None:
        try:
            engine.assets.info(f"{number:016x}")
        except (FetchingError, NotFoundError) as error:
            found.append(type(error))

    monkeypatch.setattr("rhytid.engine.shared_calls.TURN", 0.05)
    with running(tmp_path / "b", shared_store=str(folder)) as engine:
        asset = built(engine, new_asset())
        monkeypatch.setattr(SharedStore, "index", silent)
        threads = [threading.Thread(target=ask, args=(number,)) for number in range(12)]
        for thread in threads:
            thread.start()
        until = time.monotonic() + LONG
        while len(found) < 8 and time.monotonic() < until:
            time.sleep(0.01)
        assert found == [FetchingError] * 8
        assert engine.tiles.plan(asset, "neutral", REDRAW, FIRST).draw().any()
        answers.set()
        for thread in threads:
            thread.join(LONG)
        assert found[8:] == [NotFoundError] * 4


def test_a_frame_of_an_unknown_asset_is_not_found(folder: Path, tmp_path: Path) -> None:
    with running(tmp_path / "b", shared_store=str(folder)) as engine:
        for id in ("0" * 16, "no-id", "../../etc"):
            with pytest.raises(NotFoundError):
                engine.tiles.plan(id, "neutral", REDRAW, FIRST)
        assert engine.jobs._known() == []


def test_what_is_deleted_here_is_fetched_again(folder: Path, tmp_path: Path) -> None:
    with running(tmp_path / "a", shared_store=str(folder)) as engine, serving(engine) as client:
        asset = built(engine, new_asset())
        path = f"/v1/assets/{asset}"
        assert client.delete(path).status_code == 204
        assert client.get("/v1/assets").json() == []
        assert patiently(lambda: engine.assets.info(asset)).state == "ready"

        assert client.delete(path, params={"shared": "true"}).status_code == 204
        assert SharedStore.at(str(folder)).ids() == []
        for answer in (client.get(path), client.delete(path, params={"shared": "true"})):
            assert is_problem(answer, 404, "not-found")


def test_what_is_not_here_is_deleted_there(folder: Path, tmp_path: Path) -> None:
    with running(tmp_path / "a", shared_store=str(folder)) as one:
        asset = built(one, new_asset())
    with running(tmp_path / "b", shared_store=str(folder)) as other:
        with pytest.raises(NotFoundError):
            other.assets.delete(asset)
        other.assets.delete(asset, shared=True)
    assert SharedStore.at(str(folder)).ids() == []


def test_without_a_shared_store_nothing_is_deleted_there(engine: Engine) -> None:
    with pytest.raises(QueryError, match="no shared store"):
        engine.assets.delete("0" * 16, shared=True)


def test_what_is_damaged_there_is_built_anew(folder: Path, tmp_path: Path) -> None:
    with running(tmp_path / "a", shared_store=str(folder)) as one:
        asset = built(one, new_asset())
    largest = max((folder / "objects" / asset).iterdir(), key=lambda file: file.stat().st_size)
    data = largest.read_bytes()
    largest.write_bytes(data[:-1] + bytes([data[-1] ^ 1]))
    with running(tmp_path / "b", shared_store=str(folder)) as other, serving(other) as client:
        with pytest.raises(SharedDamageError, match=largest.name):
            patiently(lambda: other.assets.info(asset))
        answer = client.get(f"/v1/assets/{asset}")
        assert is_problem(answer, 409, "shared-damage")
        assert "send it again" in answer.text
        assert str(folder) not in answer.text
        assert built(other, new_asset()) == asset
    assert largest.read_bytes() == data


def test_a_shared_store_that_is_away_stops_nobody(folder: Path, tmp_path: Path) -> None:
    away = tmp_path / "unmounted"
    with running(tmp_path / "a", shared_store=str(folder)) as one, serving(one) as client:
        folder.rename(away)
        asset = built(one, new_asset())
        assert jobs(one, "push") == ["failed"]
        one.assets.change(asset, {"depth": 0.2})
        with pytest.raises(SharedStoreError):
            one.assets.info("1" * 16)
        answer = client.get(f"/v1/assets/{'1' * 16}")
        assert is_problem(answer, 503, "shared-store")
        assert "retry-after" in answer.headers
        assert str(folder) not in answer.text
    away.rename(folder)
    assert SharedStore.at(str(folder)).ids() == []
    with running(tmp_path / "a", shared_store=str(folder)) as again:
        assert jobs(again, "push") == ["done"]
    with running(tmp_path / "a", shared_store=str(folder)) as again:
        assert jobs(again, "push") == []
    with running(tmp_path / "b", shared_store=str(folder)) as other:
        assert patiently(lambda: other.assets.info(asset)).settings["depth"] == 0.2


def test_what_could_not_be_pushed_is_pushed_later(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rhytid.engine.shared_assets.PAUSE", 0.5)
    monkeypatch.setattr("rhytid.engine.shared_calls.FORGOTTEN", 0.1)
    away = tmp_path / "unmounted"
    with running(tmp_path / "a", shared_store=str(folder)) as one:
        folder.rename(away)
        asset = built(one, new_asset())
        away.rename(folder)
        shared, until = SharedStore.at(str(folder)), time.monotonic() + LONG
        while not shared.ids() and time.monotonic() < until:
            time.sleep(0.05)
        assert shared.ids() == [asset]


def test_a_restored_snapshot_is_shared(folder: Path, tmp_path: Path) -> None:
    with running(tmp_path / "a") as one, serving(one) as client:
        asset = built(one, new_asset())
        data = client.get(f"/v1/assets/{asset}/snapshot").content
    with running(tmp_path / "b", shared_store=str(folder)) as other, serving(other) as client:
        tar = {"Content-Type": "application/x-tar"}
        assert client.post("/v1/snapshots", content=data, headers=tar).status_code == 201
        assert jobs(other, "push") == ["done"]
    assert SharedStore.at(str(folder)).ids() == [asset]


def test_shapes_that_come_later_are_shared(folder: Path, tmp_path: Path) -> None:
    mesh = sheet()
    moved = Expressions.checked(mesh.positions[None], len(mesh.positions), ["jawOpen"])
    with running(tmp_path / "a", shared_store=str(folder)) as one:
        asset = built(one, new_asset(mesh))
        one.assets.create(replace(new_asset(mesh), shapes=moved))
        rest(one)
    with running(tmp_path / "b", shared_store=str(folder)) as other:
        names = patiently(lambda: other.assets.shapes(asset)).names
        assert names == ("jawOpen",)


def test_many_callers_fetch_once(folder: Path, tmp_path: Path) -> None:
    with running(tmp_path / "a", shared_store=str(folder)) as one:
        asset = built(one, new_asset())
        wanted = one.tiles.plan(asset, "neutral", REDRAW, FIRST).draw()
    found: list[Any] = []

    def ask() -> None:
        plan = patiently(lambda: other.tiles.plan(asset, "neutral", REDRAW, FIRST))
        found.append(plan.draw())

    with running(tmp_path / "b", shared_store=str(folder)) as other:
        threads = [threading.Thread(target=ask) for _ in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(LONG)
        assert jobs(other, "fetch") == ["done"]
    assert len(found) == 8
    assert all(np.array_equal(one, wanted) for one in found)
