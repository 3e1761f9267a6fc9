"""Packages on disk beside those who remove them, and beside what is not theirs."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from rhytid.errors import LimitError, StorageError
from rhytid.storage.packages import CHECKED, PackageCache, read_archive, write_archive
from rhytid.support import atomic_files

ASSET = "0123456789abcdef"
KEY, OTHER, OLD = (digit * 32 for digit in "0ab")
FILES = {"manifest.json": b"{}", "textures/maps.1001.ktx2": bytes(300_000)}


@pytest.fixture
def packages(tmp_path: Path) -> PackageCache:
    return opened(tmp_path)


def opened(folder: Path, limit: int | None = 10_000_000) -> PackageCache:
    (folder / "partial").mkdir(exist_ok=True)
    return PackageCache(folder / "packages", folder / "partial", limit)


def keep(packages: PackageCache, asset: str = ASSET, name: str = KEY) -> None:
    with packages.making(asset) as made:
        for path, data in FILES.items():
            (made / path).parent.mkdir(parents=True, exist_ok=True)
            (made / path).write_bytes(data)
        packages.seal(made)
        packages.keep(asset, name, made)


def test_what_is_kept_is_found_and_read_once(
    packages: PackageCache, monkeypatch: pytest.MonkeyPatch
) -> None:
    keep(packages)
    found = packages.find(ASSET, KEY)
    assert found is not None
    data = found.file.read_bytes()
    assert {name: data[at.start : at.stop] for name, at in found.files.items()} == FILES
    assert found.nbytes == len(data)

    def never(*_: object) -> None:
        pytest.fail("it was opened again")

    monkeypatch.setattr("rhytid.storage.packages.read_archive", never)
    assert packages.find(ASSET, KEY) is found


def test_the_same_files_give_the_same_bytes(packages: PackageCache) -> None:
    keep(packages)
    keep(packages, name=OTHER)
    one, other = packages.find(ASSET, KEY), packages.find(ASSET, OTHER)
    assert one is not None
    assert other is not None
    assert one.file.read_bytes() == other.file.read_bytes()


def test_another_process_may_remove_and_replace_them(
    packages: PackageCache, tmp_path: Path
) -> None:
    keep(packages)
    assert packages.find(ASSET, KEY) is not None
    other = opened(tmp_path)
    other.forget(ASSET)
    assert packages.find(ASSET, KEY) is None
    keep(other)
    assert packages.find(ASSET, KEY) is not None


def test_reading_beside_removals_finds_all_or_nothing(
    packages: PackageCache, tmp_path: Path
) -> None:
    """As another process removes and makes them: this one raises nothing."""
    other, over = opened(tmp_path), threading.Event()

    def look() -> None:
        while not over.is_set():
            found = packages.find(ASSET, KEY)
            assert found is None or found.files.keys() == FILES.keys()
            packages.make_room(0)

    with ThreadPoolExecutor(1) as threads:
        looking = threads.submit(look)
        for _ in range(30):
            keep(other)
            other.forget(ASSET)
        over.set()
        looking.result()


def test_what_cannot_be_removed_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    packages = opened(tmp_path, limit=500_000)
    keep(packages, name=OLD)
    (tmp_path / "packages" / "stranger").mkdir()

    def resist(path: Path, partial: Path) -> None:
        raise PermissionError(13, "no", str(path))

    monkeypatch.setattr(atomic_files, "discard", resist)
    packages.sweep([])
    packages.forget(ASSET)
    packages.make_room(400_000)
    assert packages.find(ASSET, OLD) is not None
    assert "is left as it is" in caplog.text
    with pytest.raises(LimitError):
        packages.make_room(500_001)


def test_a_packages_folder_that_is_a_file_is_left(tmp_path: Path) -> None:
    (tmp_path / "packages").write_bytes(b"")
    packages = opened(tmp_path)
    packages.sweep([ASSET])
    packages.make_room(1)
    packages.forget(ASSET)
    assert packages.find(ASSET, KEY) is None
    with pytest.raises(StorageError):
        keep(packages)


def test_of_archives_only_those_of_known_assets_survive_a_sweep(
    packages: PackageCache, tmp_path: Path
) -> None:
    for asset in (ASSET, "f" * 16, "e" * 16):
        keep(packages, asset)
    top = tmp_path / "packages"
    for foreign in (f"{ASSET}/file", f"{'f' * 16}/file", "notes", "node_modules/left.zip"):
        (top / foreign).parent.mkdir(exist_ok=True)
        (top / foreign).write_text("mine")
    packages.sweep([ASSET])
    packages.make_room(9_999_999)
    left = sorted(str(file.relative_to(top)) for file in top.rglob("*") if file.is_file())
    assert left == [f"{ASSET}/file", f"{'f' * 16}/file", "node_modules/left.zip", "notes"]
    assert not (top / ("e" * 16)).exists()


def test_an_archive_that_is_not_ours_is_damaged(tmp_path: Path) -> None:
    (tmp_path / "files").mkdir()
    for name, data in {"a": b"12", "b": b"34", "large": bytes(CHECKED + 1)}.items():
        (tmp_path / "files" / name).write_bytes(data)
    file = tmp_path / "a.zip"
    write_archive(tmp_path / "files", file, lambda: None)
    whole = file.read_bytes()
    assert whole.count(b"large") == 2
    renamed = whole[:-100] + whole[-100:].replace(b"large", b"other")
    middle = len(whole) // 2
    shorter = whole[:middle] + whole[middle + 100 :]
    small = whole.replace(b"12", b"13")
    size, larger = ((CHECKED + more).to_bytes(4, "little") for more in (1, 2))
    resized = whole[:-100] + whole[-100:].replace(size, larger)
    for ruined in (whole[:-1], b"x" + whole, small, whole[:40], renamed, shorter, resized):
        file.write_bytes(ruined)
        with file.open("rb") as archive, pytest.raises(StorageError, match="is damaged"):
            read_archive(archive, file)
