"""Skin packages of a server: made once, as jobs, and thrown away with what they were made of."""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from engine.engines import MIB, built, finish, new_asset, rest, running
from rhytid.domain.stiffness import Stiffness
from rhytid.engine import packages as module
from rhytid.engine.engine import Engine
from rhytid.engine.messages import JobInfo, Package
from rhytid.errors import (
    CancelledError,
    ConflictError,
    DiskFullError,
    LimitError,
    NotFoundError,
)
from rhytid.skin_package.package import PackageWriter
from skin_package.conftest import write_package


@pytest.fixture
def engine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Engine]:
    monkeypatch.setattr(module, "PATIENCE", 60.0)
    with running(tmp_path / "store") as found:
        yield found


def made(engine: Engine, asset: str, levels: int = 1) -> Package:
    found = engine.packages.of(asset, levels)
    assert isinstance(found, Package)
    return found


def kept(engine: Engine) -> list[Path]:
    """Every package on disk; nothing else is left behind."""
    store = engine._store._folders.partial.parent
    assert list((store / "partial").iterdir()) == []
    return sorted((store / "packages").glob("*/*"))


def test_it_is_what_export_writes(engine: Engine, tmp_path: Path) -> None:
    asset = built(engine, new_asset(preset="best"))
    found = made(engine, asset)
    write_package(engine, asset, tmp_path / "skin", levels=1)
    wanted = [file for file in (tmp_path / "skin").rglob("*") if file.is_file()]
    assert len(wanted) == len(found.files) > 10
    for file in wanted:
        name = file.relative_to(tmp_path / "skin").as_posix()
        assert (found.folder / name).read_bytes() == file.read_bytes(), name
        assert found.files[name] == file.stat().st_size


def test_it_is_made_once_and_survives_a_restart(engine: Engine, tmp_path: Path) -> None:
    asset = built(engine, new_asset())
    found = made(engine, asset)
    jobs = len(engine.jobs._known())
    assert made(engine, asset) == found
    assert len(engine.jobs._known()) == jobs
    more = made(engine, asset, levels=3)
    assert sum(more.files.values()) > sum(found.files.values())
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
    manifest = json.loads((changed.folder / "manifest.json").read_text())
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

    monkeypatch.setattr("rhytid.durable.write_pieces", full)
    with pytest.raises(DiskFullError):
        engine.packages.of(asset)
    assert kept(engine) == []


def test_those_asked_for_longest_ago_make_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "PATIENCE", 60.0)
    with running(tmp_path, packages=3 * MIB) as engine:
        assets = [built(engine, new_asset(seed=seed)) for seed in (1, 2, 3)]
        size = sum(made(engine, assets[0]).files.values())
        assert 1 * MIB < size < 3 * MIB / 2
        made(engine, assets[1])
        for asset, seconds in zip(assets[:2], (2000, 1000), strict=True):
            folder = made(engine, asset).folder
            os.utime(folder, (seconds, seconds))
        made(engine, assets[2])
        assert sorted(file.parent.name for file in kept(engine)) == sorted(assets[::2])
        engine._store.packages._limit = MIB
        with pytest.raises(LimitError, match="RHYTID_PACKAGES_MB"):
            engine.packages.of(assets[1])


def test_packages_of_no_asset_are_swept(tmp_path: Path) -> None:
    (tmp_path / "packages" / "0123456789abcdef" / "a").mkdir(parents=True)
    with running(tmp_path) as engine:
        assert kept(engine) == []
