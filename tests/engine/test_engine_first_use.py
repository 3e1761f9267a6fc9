"""What is prepared of an asset on first use, and not before."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from engine.engines import built, finish, new_asset, rest, running
from pipeline.scenes import sheet
from rhytid.domain.uv_layout import usual_uv_length
from rhytid.engine.assets import asset as assets
from rhytid.engine.assets import upload
from rhytid.engine.assets.asset import Asset
from rhytid.errors import StorageError
from rhytid.storage.records import StoredRequest
from rhytid.storage.store import AssetStore


@pytest.fixture
def prepared(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What was prepared of assets."""
    found: list[str] = []

    def told(name: str, make: Any) -> Any:
        def prepare(*arguments: Any, **named: Any) -> Any:
            found.append(name)
            return make(*arguments, **named)

        return prepare

    of = Asset.of.__func__  # type: ignore[attr-defined]
    monkeypatch.setattr(Asset, "of", classmethod(told("asset", of)))
    for module in (assets, upload):
        for name in ("usual_uv_length", "FrameCheck"):
            if hasattr(module, name):
                monkeypatch.setattr(module, name, told(name, getattr(module, name)))
    return found


def test_opening_a_store_prepares_nothing_that_may_never_be_asked_for(
    tmp_path: Path, prepared: list[str]
) -> None:
    with running(tmp_path) as engine:
        names = [built(engine, new_asset(seed=seed)) for seed in (1, 2)]
        before = engine.assets.all()
    prepared.clear()
    with running(tmp_path) as engine:
        assert sorted(engine.assets.all(), key=str) == sorted(
            [replace(info, job=None) for info in before], key=str
        )
        assert prepared == ["asset", "asset"]
        for scale in (1.0, 1000.0):
            found = engine.frames.put(names[0], "frame", sheet().positions * np.float32(scale))
            assert [warning.code for warning in found.warnings] == ["frame-scaled"][scale == 1.0 :]
        assert prepared == ["asset", "asset", "FrameCheck"]


def test_sending_known_content_prepares_nothing(tmp_path: Path, prepared: list[str]) -> None:
    frames = sheet().positions[None] * np.float32(1000.0)
    new = replace(new_asset(), frames=frames)
    with running(tmp_path) as engine:
        first = engine.assets.create(new)
        finish(engine, first.job)
        prepared.clear()
        again = engine.assets.create(new)
        assert prepared == []
        assert [w.code for w in again.warnings] == [w.code for w in first.warnings]
        assert "frame-scaled" in [w.code for w in again.warnings]
        rest(engine)


def test_a_store_of_before_finds_out_how_long_uv_are(tmp_path: Path) -> None:
    wanted = new_asset(unit="cm", shape={"grain": 0.1})
    with running(tmp_path) as engine:
        asset = built(engine, wanted)
        found = engine.assets.info(asset)
        stored = engine._store.asset(asset)
        assert stored.extra["uv_length"] == usual_uv_length(wanted.mesh)
    with AssetStore(tmp_path) as store:
        store.delete(asset)
        extra = {name: value for name, value in stored.extra.items() if name != "uv_length"}
        store.put_asset(asset, stored.mesh, stored.graph, stored.settings, extra)
    with running(tmp_path) as engine:
        assert engine.assets.info(asset).notices == found.notices != ()


def test_a_store_that_fails_once_is_asked_again_how_long_uv_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A store of a release that kept a length of 0, when it could not be found out."""
    wanted = new_asset(unit="cm", shape={"grain": 0.1})
    with running(tmp_path) as engine:
        asset = built(engine, wanted)
        found = engine.assets.info(asset)
        stored = engine._store.asset(asset)
    with AssetStore(tmp_path) as store:
        store.delete(asset)
        extra = {**stored.extra, "uv_length": 0.0}
        store.put_asset(asset, stored.mesh, stored.graph, stored.settings, extra)
    with running(tmp_path) as engine:
        with monkeypatch.context() as patch:
            patch.setattr("rhytid.storage.store.read_file", _fails)
            assert engine.assets.info(asset).notices == ()
        assert engine.assets.info(asset).notices == found.notices != ()


def _fails(*_: object) -> bytes:
    raise StorageError("the disk fails")


def test_a_build_that_goes_on_keeps_how_long_uv_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wanted, asset = new_asset(), "0" * 16
    with AssetStore(tmp_path) as store:
        store.put_request(asset, StoredRequest(wanted.mesh, wanted.settings, wanted.graph))
    monkeypatch.setattr("rhytid.storage.store.read_file", _fails)
    with running(tmp_path) as engine:
        engine.assets.info(asset)  # its notices need it, while it builds
        rest(engine)
        stored = engine._store.asset(asset)
    assert stored.extra["uv_length"] == usual_uv_length(wanted.mesh)
