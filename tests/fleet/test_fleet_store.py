"""The place of a fleet: made, opened, and taken over from the last release."""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest

from engine.engines import built, maps, new_asset, rest, running, same
from rhytid.domain.settings_changes import CHANGEABLE
from rhytid.engine.engine import Engine
from rhytid.errors import InputError, StorageError
from rhytid.fleet.fleet_store import FleetStore
from rhytid.fleet.options import FleetOptions
from rhytid.fleet.shared_files import read_upload, written_upload
from rhytid.support.atomic_files import UNFINISHED
from rhytid.support.ownership import FolderKind, check_owned
from rhytid.support.settings import ServiceSettings

MARK = b'{"format": 1, "kind": "rhytid fleet"}'
LOOKS = {"depth": 0.25, "shape": {"taper": 0.2}}


def opened(folder: Path) -> FleetStore:
    return FleetStore.opened(ServiceSettings(), FleetOptions(store=folder))


@pytest.fixture
def engine(tmp_path: Path) -> Iterator[Engine]:
    with running(tmp_path / "server") as made:
        yield made


def as_before(folder: Path, engine: Engine, asset: str, changes: Any = None) -> None:
    """What the last release had of an asset: its snapshot, and changed settings."""
    for name in ("assets", "uploads", "packages", "given"):
        (folder / name).mkdir(mode=0o755, parents=True, exist_ok=True)
    (folder / "format.json").write_bytes(MARK)
    (folder / "jobs.key").write_bytes(b"k" * 32)
    with engine.snapshots.of(asset) as made:
        (folder / "assets" / f"{asset}.tar").write_bytes(b"".join(made.pieces()))
    if changes is not None:
        settings = engine.assets.change(asset, changes).settings
        rest(engine)
        now = {name: settings[name] for name in CHANGEABLE}
        (folder / "assets" / f"{asset}.json").write_text(json.dumps(now))
    files = [folder / "assets" / f"{asset}.{suffix}" for suffix in ("tar", "json")]
    stats = [path.stat() if path.exists() else None for path in files]
    of = [None if one is None else [one.st_mtime_ns, one.st_ino] for one in stats]
    said = {"of": of, "info": asdict(engine.assets.info(asset))}
    (folder / "assets" / f"{asset}.info").write_text(json.dumps(said))


@pytest.mark.parametrize("marked", [True, False])
def test_a_folder_of_the_last_release_is_taken_over(
    tmp_path: Path, engine: Engine, marked: bool
) -> None:
    folder = tmp_path / "store" / "shared"
    plain, changed = (built(engine, new_asset(seed=seed)) for seed in (1, 2))
    as_before(folder, engine, plain)
    as_before(folder, engine, changed, LOOKS)
    (folder / "uploads" / ("0" * 16)).write_bytes(b"".join(written_upload(new_asset(seed=3))))
    (folder / "uploads" / f"{'0' * 16}.owner").write_text("gone")
    (folder / "packages" / f"{plain}-{'a' * 32}.zip").write_bytes(b"zip")
    if not marked:
        (folder / "format.json").unlink()
        (folder / "jobs.key").unlink()

    half = folder / "uploads" / f".unfinished-{'b' * 32}"
    half.mkdir()
    (half / ".rhytid-unfinished").write_bytes(UNFINISHED.text())
    (half / "half").write_bytes(b"half")

    store = opened(tmp_path / "store")

    assert store.assets.ids() == sorted([plain, changed])
    assert not half.exists(), "its writer has ended with the old fleet"
    assert all(map(store.assets.holds, (plain, changed)))
    assert not (folder / "assets").exists()
    assert store.files.uploads() == ["0" * 16]
    assert read_upload(store.files.upload("0" * 16) or b"").settings == new_asset().settings
    assert (folder / "packages" / f"{plain}-{'a' * 32}.zip").read_bytes() == b"zip"
    assert not marked or store.files.job_key() == b"k" * 32
    assert json.loads((folder / "format.json").read_bytes())["kind"] == "rhytid shared store"
    assert (folder / "uploads").stat().st_mode & 0o777 == 0o700
    for asset in (plain, changed):  # lists load none
        said = store.files.info(asset, store.assets.digest(asset))
        assert said == engine.assets.info(asset)
    with running(tmp_path / "replica", shared_store=store.place, in_step=True) as replica:
        for asset in (plain, changed):
            now, before = replica.assets.info(asset), engine.assets.info(asset)
            assert now == replace(before, job=None)
            assert same(maps(replica, asset, "neutral"), maps(engine, asset, "neutral"))
    assert opened(tmp_path / "store").assets.ids() == sorted([plain, changed])


def test_what_is_damaged_is_left_and_named(
    tmp_path: Path, engine: Engine, caplog: pytest.LogCaptureFixture
) -> None:
    folder = tmp_path / "store" / "shared"
    cut, good = (built(engine, new_asset(seed=seed)) for seed in (1, 2))
    as_before(folder, engine, cut)
    as_before(folder, engine, good, LOOKS)
    os.truncate(folder / "assets" / f"{cut}.tar", 5000)
    settings = folder / "assets" / f"{good}.json"
    time = settings.stat().st_mtime_ns
    settings.write_text("{")
    os.utime(settings, ns=(time, time))
    other, far = folder / "assets" / f"{'1' * 16}.tar", tmp_path / "far"
    other.write_bytes((folder / "assets" / f"{good}.tar").read_bytes())
    other.with_name(f"{'2' * 16}.tar").symlink_to(far)
    store = opened(tmp_path / "store")
    assert store.assets.ids() == [good]
    assert store.files.info(good, store.assets.digest(good)) is None, "it was of other settings"
    assert f"{cut}.tar is left as it is: it is cut off" in caplog.text
    assert f"{good}.json is damaged, and left out" in caplog.text
    assert f"{other} is left as it is: it is of asset {good}" in caplog.text
    left = {path.stem for path in (folder / "assets").glob("*.tar")}
    assert left == {cut, "1" * 16, "2" * 16}


def test_a_takeover_that_was_cut_off_goes_on_and_newer_settings_stay(
    tmp_path: Path, engine: Engine, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "store" / "shared"
    first, second = sorted(built(engine, new_asset(seed=seed)) for seed in (1, 2))
    as_before(folder, engine, first)
    as_before(folder, engine, second)
    unlink = Path.unlink

    def end(path: Path, missing_ok: bool = False) -> None:
        if path.suffix == ".json" and path.parent.name == "assets":
            raise KeyboardInterrupt
        unlink(path, missing_ok)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "unlink", end)
        with pytest.raises(KeyboardInterrupt):
            opened(tmp_path / "store")
    assert (folder / "assets" / f"{first}.tar").exists()
    with running(tmp_path / "replica", shared_store=str(folder), in_step=True) as replica:
        replica.assets.change(first, {"depth": 0.75})
    store = opened(tmp_path / "store")
    assert store.assets.ids() == [first, second]
    with running(tmp_path / "other", shared_store=str(folder), in_step=True) as replica:
        assert replica.assets.info(first).settings["depth"] == 0.75


def test_all_who_start_at_once_wait_for_the_one_that_takes_over(
    tmp_path: Path, engine: Engine
) -> None:
    folder = tmp_path / "store" / "shared"
    asset = built(engine, new_asset())
    as_before(folder, engine, asset)
    begin = threading.Barrier(4)

    def start() -> list[str]:
        begin.wait(30)
        return opened(tmp_path / "store").assets.ids()

    with ThreadPoolExecutor(4) as pool:
        found = [one.result() for one in [pool.submit(start) for _ in range(4)]]
    assert found == [[asset]] * 4


def test_the_last_release_leaves_alone_what_was_taken_over(tmp_path: Path) -> None:
    """Its check of the marker: the same as of any folder of ours."""
    opened(tmp_path / "store")
    before = FolderKind("rhytid fleet", folders=("assets", "uploads", "packages", "given"))
    with pytest.raises(StorageError, match="is not ours"):
        check_owned(tmp_path / "store" / "shared", before)


def test_the_place_is_that_of_the_shared_store_where_one_is_named(
    tmp_path: Path, bucket: str
) -> None:
    options = FleetOptions(store=tmp_path / "store")
    store = FleetStore.opened(replace(ServiceSettings(), shared_store=bucket), options)
    assert (store.place, store.assets.ids()) == (bucket, [])
    assert not (tmp_path / "store").exists()
    missing = str(tmp_path / "missing")
    with pytest.raises(InputError, match="no such folder"):
        FleetStore.opened(replace(ServiceSettings(), shared_store=missing), options)
