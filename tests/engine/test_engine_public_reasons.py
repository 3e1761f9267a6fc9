"""What callers read of a job that failed: never where the server keeps its files."""

from __future__ import annotations

import errno
import logging
from pathlib import Path
from typing import Any

import httpx
import pytest

from api.asking import NPY, npy
from api.live import serving
from engine.engines import built, finish, new_asset, rest, running
from meshes import deform
from rhytid.baking.assets import build
from rhytid.baking.run_warnings import RunWarnings
from rhytid.engine.engine import Engine
from rhytid.errors import ConflictError, DiskFullError, KernelBuildError, StorageError
from rhytid.support import atomic_files

WORDS = DiskFullError.public


class FullDisk:
    """Every file that is written meets a full disk, once it is `full`."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.full = False
        self._write = atomic_files.write_pieces
        patch.setattr(atomic_files, "write_pieces", self)

    def __call__(self, path: Path, pieces: Any) -> None:
        if self.full:
            raise OSError(errno.ENOSPC, "No space left on device", str(path))
        self._write(path, pieces)


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> FullDisk:
    return FullDisk(monkeypatch)


def everything(client: httpx.Client, engine: Engine, asset: str) -> str:
    """All that callers read of an asset, its jobs and its events."""
    answers = [client.get(f"/v1/assets/{asset}"), client.get("/v1/assets")]
    answers.append(client.get(f"/v1/assets/{asset}/frames/neutral/tiles/1001/0/0/0"))
    for job in engine.jobs._known():
        answers.append(client.get(f"/v1/jobs/{job.info.id}"))
        answers.append(client.get(f"/v1/jobs/{job.info.id}/events"))
    return "\n".join(answer.text for answer in answers)


def test_a_build_that_the_store_fails_names_no_path(
    tmp_path: Path, disk: FullDisk, monkeypatch: pytest.MonkeyPatch, caplog: Any
) -> None:
    store = tmp_path / "a secret place"
    with running(store) as engine, serving(engine) as client:
        put = engine._store.put_asset

        def fails(*args: Any, **named: Any) -> None:
            disk.full = True  # the request was stored
            put(*args, **named)

        monkeypatch.setattr(engine._store, "put_asset", fails)
        info = engine.assets.create(new_asset())
        job = finish(engine, info.job)
        assert (job.state, job.detail) == ("failed", WORDS)
        assert engine.assets.info(info.id).reason == WORDS
        told = everything(client, engine, info.id)
    assert WORDS in told
    assert "secret" not in told
    (logged,) = [r for r in caplog.records if r.getMessage().startswith(f"job {job.id} failed: ")]
    assert logged.levelno == logging.ERROR
    assert "a secret place" in logged.getMessage()
    assert "No space left" in logged.getMessage()


def test_a_calibration_that_the_store_fails_names_no_path(tmp_path: Path, disk: FullDisk) -> None:
    store = tmp_path / "a secret place"
    with running(store) as engine, serving(engine) as client:
        asset = built(engine, new_asset())
        disk.full = True
        path = f"/v1/assets/{asset}"
        moved = npy(deform(engine.frames.positions(asset, "neutral"), 3, 0.05))
        job = client.put(f"{path}/calibration", content=moved, headers=NPY).json()
        ended = finish(engine, job["id"])
        assert (ended.state, ended.detail) == ("failed", WORDS)
        patched = client.patch(path, json={"depth": 0.5})
        assert patched.status_code == 507
        sent = patched.text + everything(client, engine, asset)
        disk.full = False
        rest(engine)
    assert "secret" not in sent


def test_a_kernel_that_does_not_build_shows_no_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*args: Any, **named: Any) -> None:
        raise KernelBuildError("/home/somebody/secret.cl:3: error")

    with running(tmp_path) as engine, serving(engine) as client:
        monkeypatch.setattr(engine._on_device, "place", fails)
        info = engine.assets.create(new_asset())
        assert finish(engine, info.job).state == "failed"
        told = everything(client, engine, info.id)
    assert "the device failed: the server's log has the reason" in told
    assert "secret" not in told


def test_a_command_tells_its_user_all_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`bake` has its engine in its own process: there is no log of a server to look into."""

    def fails(id: str) -> None:
        raise StorageError("some/place cannot be read: Input/output error")

    with running(tmp_path) as engine, RunWarnings("bake", False, []) as warned:
        monkeypatch.setattr(engine._store, "request", fails)
        with pytest.raises(ConflictError, match="could not be built: some/place cannot be read"):
            build(engine, new_asset(), warned)
