"""Skin packages of a server: made once, as jobs, and thrown away with what they were made of."""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from engine.engines import MIB, built, finish, new_asset, rest, running
from exports.skin_package.conftest import write_package
from rhytid.domain.painted_maps import Stiffness
from rhytid.engine import packages as module
from rhytid.engine.engine import Engine
from rhytid.engine.messages import JobInfo, Package
from rhytid.errors import (
    CancelledError,
    ChangedError,
    ConflictError,
    DiskFullError,
    HostMemoryError,
    LimitError,
    NotFoundError,
)
from rhytid.exports.skin_package.package import PackageWriter
from rhytid.storage.packages import PackageCache
from rhytid.storage.store import AssetStore


@pytest.fixture
def engine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Engine]:
    monkeypatch.setattr(module, "PATIENCE", 60.0)
    with running(tmp_path / "store") as found:
        yield found


def made(engine: Engine, asset: str, levels: int = 1) -> Package:
    found = engine.packages.of(asset, levels)
    assert isinstance(found, Package)
    return found


def read(package: Package, name: str) -> bytes:
    place = package.files[name]
    return package.file.read_bytes()[place.start : place.stop]


def kept(engine: Engine) -> list[Path]:
    """Every package on disk; nothing else is left behind."""
    store = engine._store._folders.partial.parent
    assert list((store / "partial").iterdir()) == []
    return sorted((store / "packages").glob("*/*"))


@pytest.mark.slow
def test_it_is_what_export_writes(engine: Engine, tmp_path: Path) -> None:
    asset = built(engine, new_asset(preset="best"))
    found = made(engine, asset)
    write_package(engine, asset, tmp_path / "skin", levels=1)
    wanted = [file for file in (tmp_path / "skin").rglob("*") if file.is_file()]
    assert len(wanted) == len(found.files) > 10
    for file in wanted:
        name = file.relative_to(tmp_path / "skin").as_posix()
        assert read(found, name) == file.read_bytes(), name


def test_it_is_made_once_and_survives_a_restart(engine: Engine, tmp_path: Path) -> None:
    asset = built(engine, new_asset())
    found = made(engine, asset)
    jobs = len(engine.jobs._known())
    assert made(engine, asset) == found
    assert len(engine.jobs._known()) == jobs
    more = made(engine, asset, levels=3)
    assert more.nbytes > found.nbytes
    engine.close()
    with running(tmp_path / "store") as again:
        assert made(again, asset) == found
        assert [job.info.kind for job in again.jobs._known()].count("package") == 0


def test_it_goes_with_the_asset_and_with_its_settings(engine: Engine) -> None:
    asset = built(engine, new_asset())
    found = made(engine, asset)
    engine.assets.change(asset, {"bins": {"r_max": 0.3}})
    rest(engine)
    assert kept(engine) == []
    changed = made(engine, asset)
    manifest = json.loads(read(changed, "manifest.json"))
    assert (manifest["blend"]["r_max"], changed.key == found.key) == (0.3, False)
    engine.assets.delete(asset)
    assert kept(engine) == []
    with pytest.raises(NotFoundError):
        engine.packages.of(asset)


def test_what_a_package_cannot_hold_is_a_conflict(engine: Engine) -> None:
    asset = built(engine, new_asset(bins={"merge": "mellow"}))
    with pytest.raises(ConflictError, match=r"cannot be packaged: bins\.merge is mellow"):
        engine.packages.of(asset)
    stiff = Stiffness({1001: np.zeros((4, 4), np.float32)})
    asset = built(engine, replace(new_asset(), stiffness=stiff))
    with pytest.raises(ConflictError, match=r"cannot be packaged: .* stiffness map"):
        engine.packages.of(asset)


def test_long_ones_are_jobs_that_can_be_cancelled(
    engine: Engine, monkeypatch: pytest.MonkeyPatch
) -> None:
    asset = built(engine, new_asset())
    monkeypatch.setattr(module, "PATIENCE", 0.0)
    steps = PackageWriter.steps
    cancelled = threading.Event()
    monkeypatch.setattr(PackageWriter, "steps", lambda self: [*steps(self), cancelled.wait])

    job = engine.packages.of(asset)
    again = engine.packages.of(asset)
    assert isinstance(job, JobInfo)
    assert (job.kind, job.asset) == ("package", asset)
    assert isinstance(again, JobInfo)
    assert again.id == job.id
    engine.jobs.cancel(job.id)
    cancelled.set()
    assert finish(engine, job.id).state == "cancelled"
    assert kept(engine) == []
    monkeypatch.setattr(PackageWriter, "steps", steps)
    monkeypatch.setattr(module, "PATIENCE", 60.0)
    assert "manifest.json" in made(engine, asset).files


def test_an_asset_that_is_deleted_while_it_is_made_is_not_there(
    engine: Engine, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its files are gone below the job, which is no fault of the disk."""
    asset, mesh = built(engine, new_asset()), AssetStore.mesh

    def deleted(self: AssetStore, id: str) -> Any:
        engine.assets.delete(asset)
        return mesh(self, id)

    monkeypatch.setattr(AssetStore, "mesh", deleted)
    with pytest.raises(NotFoundError, match="was removed"):
        engine.packages.of(asset)
    rest(engine)
    assert kept(engine) == []


def test_settings_that_change_while_it_is_made_end_it(
    engine: Engine, monkeypatch: pytest.MonkeyPatch
) -> None:
    asset = built(engine, new_asset())
    steps = PackageWriter.steps

    def change() -> None:
        engine.assets.change(asset, {"bins": {"r_max": 0.25}})

    monkeypatch.setattr(PackageWriter, "steps", lambda self: [change, *steps(self)])
    with pytest.raises(CancelledError, match="ask for its package again"):
        engine.packages.of(asset)
    rest(engine)
    assert kept(engine) == []


def test_a_full_disk_is_told_and_leaves_nothing(
    engine: Engine, monkeypatch: pytest.MonkeyPatch
) -> None:
    asset = built(engine, new_asset())

    def full(*_: Any) -> None:
        raise OSError(28, os.strerror(28))

    monkeypatch.setattr("rhytid.support.atomic_files.write_pieces", full)
    with pytest.raises(DiskFullError):
        engine.packages.of(asset)
    assert kept(engine) == []


@pytest.mark.slow
def test_those_asked_for_longest_ago_make_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "PATIENCE", 60.0)
    with running(tmp_path, packages=3 * MIB) as engine:
        assets = [built(engine, new_asset(seed=seed)) for seed in (1, 2, 3)]
        size = made(engine, assets[0]).nbytes
        assert 1 * MIB < size < 3 * MIB / 2
        made(engine, assets[1])
        for asset, seconds in zip(assets[:2], (2000, 1000), strict=True):
            os.utime(made(engine, asset).file, (seconds, seconds))
        made(engine, assets[2])
        assert sorted(file.parent.name for file in kept(engine)) == sorted(assets[::2])
        engine._store.packages._limit = MIB
        with pytest.raises(LimitError, match="RHYTID_PACKAGES_MB"):
            engine.packages.of(assets[1])


def test_packages_of_no_asset_are_swept(tmp_path: Path) -> None:
    AssetStore(tmp_path).close()
    home = tmp_path / "packages" / "0123456789abcdef"
    home.mkdir(parents=True)
    (home / f"{'0' * 32}.zip").touch()
    with running(tmp_path) as engine:
        assert kept(engine) == []
        assert not home.exists()


def test_a_packages_folder_that_is_none_keeps_no_store_closed(tmp_path: Path) -> None:
    AssetStore(tmp_path).close()
    (tmp_path / "packages").write_bytes(b"")
    with running(tmp_path) as engine:
        asset = built(engine, new_asset())
        assert engine.packages.of(asset, begin=False) is None
        engine.assets.delete(asset)


def test_levels_beyond_one_texel_are_the_same_package(engine: Engine) -> None:
    asset = built(engine, new_asset())
    keys = [made(engine, asset, levels).key for levels in (9, 10, 16)]
    assert len(set(keys)) == 1
    assert made(engine, asset, 8).key != keys[0]


def test_another_key_is_told_that_the_asset_has_changed(engine: Engine) -> None:
    asset = built(engine, new_asset())
    found = made(engine, asset)
    assert engine.packages.of(asset, key=found.key) == found
    engine.assets.change(asset, {"bins": {"r_max": 0.3}})
    rest(engine)
    jobs = len(engine.jobs._known())
    with pytest.raises(ChangedError, match="begin again"):
        engine.packages.of(asset, key=found.key)
    assert len(engine.jobs._known()) == jobs


@pytest.mark.slow
def test_damaged_ones_are_made_again(engine: Engine) -> None:
    asset = built(engine, new_asset())
    found = made(engine, asset)
    whole = found.file.read_bytes()
    texture = found.files["textures/maps.1001.ktx2"]
    manifest = found.files["manifest.json"]
    ruined = (
        b"",
        whole[: texture.start + 100],
        whole[: texture.start] + whole[texture.start + 100 :],
        whole[: manifest.start] + b"?" + whole[manifest.start + 1 :],
    )
    for data in ruined:
        aside = found.file.with_name("aside")
        aside.write_bytes(data)
        aside.replace(found.file)
        assert made(engine, asset).files == found.files
        assert found.file.read_bytes() == whole
    found.file.unlink()
    found.file.mkdir()
    (found.file / "file").touch()
    assert made(engine, asset).files == found.files


def test_the_asset_is_free_while_room_is_made(
    engine: Engine, monkeypatch: pytest.MonkeyPatch
) -> None:
    asset = built(engine, new_asset())
    lock = engine.packages._assets.get(asset).lock
    free: list[bool] = []

    def look(_: PackageCache, nbytes: int) -> None:
        with ThreadPoolExecutor(1) as other:  # the thread that asks may hold it
            taken = other.submit(lock.acquire, False).result()
            free.append(taken)
            if taken:
                other.submit(lock.release).result()

    monkeypatch.setattr(PackageCache, "make_room", look)
    made(engine, asset)
    assert free == [True, True]


def test_two_requests_at_once_make_it_once(engine: Engine) -> None:
    asset = built(engine, new_asset())
    with ThreadPoolExecutor(8) as threads:
        found = list(threads.map(lambda _: made(engine, asset), range(8)))
    assert len({one.key for one in found}) == 1
    assert [job.info.kind for job in engine.jobs._known()].count("package") == 1


def test_a_server_that_ends_while_one_is_made_makes_it_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with running(tmp_path) as engine:
        asset = built(engine, new_asset())
    # What a server leaves behind that is killed.
    left = tmp_path / "partial" / ("0" * 32)
    (left / "files").mkdir(parents=True)
    (left / "package.zip").write_bytes(b"PK")
    monkeypatch.setattr(module, "PATIENCE", 60.0)
    with running(tmp_path) as engine:
        assert list((tmp_path / "partial").iterdir()) == []
        assert "manifest.json" in made(engine, asset).files


@pytest.mark.slow
def test_small_assets_leave_the_thread_of_small_jobs_free(
    engine: Engine, monkeypatch: pytest.MonkeyPatch
) -> None:
    assets = [built(engine, new_asset(seed=seed)) for seed in (1, 2)]
    monkeypatch.setattr(module, "PATIENCE", 0.0)
    steps = PackageWriter.steps
    go = threading.Event()
    monkeypatch.setattr(PackageWriter, "steps", lambda self: [go.wait, *steps(self)])
    try:
        jobs = [engine.packages.of(asset) for asset in assets]
        other = engine.assets.create(new_asset(seed=3))
        assert engine.jobs.get(str(other.job)).wait(20)
    finally:
        go.set()
    for job in jobs:
        assert isinstance(job, JobInfo)
        assert finish(engine, job.id).state == "done"


def test_an_engine_that_is_closed_while_one_is_made_makes_it_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "PATIENCE", 0.0)
    steps = PackageWriter.steps
    making, closing = threading.Event(), threading.Event()
    held = [making.set, closing.wait]
    with running(tmp_path) as engine:
        asset = built(engine, new_asset())
        monkeypatch.setattr(PackageWriter, "steps", lambda self: [*held, *steps(self)])
        job = engine.packages.of(asset)
        assert isinstance(job, JobInfo)
        assert making.wait(60)
        threading.Timer(0.2, closing.set).start()
    assert list((tmp_path / "partial").iterdir()) == []
    monkeypatch.setattr(PackageWriter, "steps", steps)
    monkeypatch.setattr(module, "PATIENCE", 60.0)
    with running(tmp_path) as engine:
        assert engine.packages.of(asset, begin=False) is None
        assert "manifest.json" in made(engine, asset).files


def test_memory_is_held_while_it_is_made(engine: Engine, monkeypatch: pytest.MonkeyPatch) -> None:
    asset = built(engine, new_asset())
    steps = PackageWriter.steps
    held: list[int] = []

    def look() -> None:
        held.append(engine.memory.used_for("jobs"))

    monkeypatch.setattr(PackageWriter, "steps", lambda self: [*steps(self), look])
    made(engine, asset)
    assert held[0] > 0
    assert engine.memory.used_for("jobs") == 0
    monkeypatch.setattr(engine.memory, "limit", held[0] - 1)
    with pytest.raises(HostMemoryError, match="RHYTID_HOST_MEMORY_MB"):
        engine.packages.of(asset, levels=2)
    assert engine.memory.used_for("jobs") == 0
