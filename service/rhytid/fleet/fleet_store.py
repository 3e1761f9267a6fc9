"""The shared store of a fleet, and a folder of the last release that becomes one.

Before, each asset was a snapshot with files of its settings beside it, under a marker of its own.
The machine that starts first takes such a folder over; the others wait for it.
"""

from __future__ import annotations

import fcntl
import json
import logging
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from uuid import uuid4

from rhytid.engine.messages import AssetInfo
from rhytid.errors import SettingsError, SnapshotError, StorageError, StoreFormatError
from rhytid.fleet.options import FleetOptions
from rhytid.fleet.shared_files import (
    GIVEN,
    INFOS,
    PACKAGES,
    UPLOADS,
    SharedFiles,
    described_asset,
)
from rhytid.storage.homes import ASSET, ID, OVERLAY
from rhytid.storage.manifest import StoredFile
from rhytid.storage.records import read_overlay, write_overlay
from rhytid.storage.shared import backend_of
from rhytid.storage.shared.backend import PARTIAL, SHARED_STORE
from rhytid.storage.shared.folder_backend import holds_assets
from rhytid.storage.shared.shared_store import SharedStore, manifest_digest
from rhytid.storage.snapshots import Snapshot, SnapshotIndex, unpack
from rhytid.support.atomic_files import install, storage_errors, sweep, working_folder, write_file
from rhytid.support.ownership import (
    MARKER,
    UNIQUE,
    FolderKind,
    check_owned,
    has_group,
    is_marked,
    is_plain,
    is_real_folder,
    make_folder,
    read_plain,
    restrict,
    restrict_folder,
)
from rhytid.support.settings import ServiceSettings

# What a fleet removes files from, beside the folders of every shared store.
_FOLDERS = (*SHARED_STORE.folders, UPLOADS, GIVEN, PACKAGES, INFOS)
_OURS = FolderKind(SHARED_STORE.name, SHARED_STORE.format, _FOLDERS)
# The folder of the last release: its marker, and what it had in it, beside what was being written.
_BEFORE = FolderKind("rhytid fleet")
_ASSETS = "assets"
_WRITTEN = r"|\.unfinished-" + UNIQUE.pattern
_NAMES = {
    _ASSETS: re.compile(rf"{ID.pattern}\.(tar|json|info){_WRITTEN}", re.ASCII),
    UPLOADS: re.compile(rf"{ID.pattern}(\.owner)?{_WRITTEN}", re.ASCII),
    PACKAGES: re.compile(rf"{ID.pattern}-{UNIQUE.pattern}\.zip{_WRITTEN}", re.ASCII),
    GIVEN: UNIQUE,
}
_LOCK = "takeover.lock"
# Bytes of a marker, at most.
_LONGEST = 1 << 16
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class FleetStore:
    """The shared store of a fleet: its assets, and what else all of its machines need.

    place: as an option names it.
    """

    place: str
    assets: SharedStore
    files: SharedFiles

    @classmethod
    def opened(cls, settings: ServiceSettings, options: FleetOptions) -> FleetStore:
        """That of `settings.shared_store`, else the folder `shared` of the fleet's store, which is
        made where it is not there.

        Raises what opening a shared store does: InputError where something in a folder is not
        ours, StoreFormatError where a newer release made it.
        """
        place = settings.shared_store or str(options.store / "shared")
        if settings.shared_store is None:
            _make(Path(place))
        if "://" not in place:
            _take_over(Path(place))
        return cls.at(place)

    @classmethod
    def at(cls, place: str) -> FleetStore:
        """That of a place in which nothing is to be taken over."""
        backend = backend_of(place)
        backend.claim()
        return cls(place, SharedStore(backend), SharedFiles(backend))


def _make(folder: Path) -> None:
    with storage_errors(f"{folder} cannot be used"):
        folder.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        make_folder(folder, group=has_group(folder if folder.exists() else folder.parent))


def _take_over(folder: Path) -> None:
    """Have the assets of a folder of the last release as those of a shared store. Raises what
    opening one does, and changes nothing, where something in it is not ours."""
    with storage_errors(f"{folder} cannot be used"):
        before = _is_before(folder)
        if not before:
            check_owned(folder, _OURS, holds_assets)
        interrupted = is_real_folder(folder / _ASSETS) and is_marked(folder, SHARED_STORE)
        if before or interrupted:
            with _held(folder / _LOCK):
                if _is_before(folder):
                    _mark(folder)
                _convert_all(folder)


def _is_before(folder: Path) -> bool:
    """Whether it is a folder of the last release, or of one that wrote no marker: that made all
    four folders at once, and files of a few kinds in them."""
    try:
        data = read_plain(folder / MARKER, _LONGEST)
    except (FileNotFoundError, NotADirectoryError):
        return all(
            is_real_folder(folder / place)
            and all(name.fullmatch(file.name) for file in (folder / place).iterdir())
            for place, name in _NAMES.items()
        )
    try:
        _BEFORE.reads(data, folder)
    except StoreFormatError:
        raise
    except StorageError:
        return False
    return True


@contextmanager
def _held(lock: Path) -> Iterator[None]:
    """Held by one machine at a time; it goes with the process."""
    descriptor = os.open(lock, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def _mark(folder: Path) -> None:
    """Write the marker of a shared store in place of the one of the last release: that leaves the
    folder alone from now on."""
    group = has_group(folder)
    for name in _FOLDERS:
        if is_real_folder(folder / name):
            restrict_folder(folder / name, group=group)  # earlier releases let everybody in
    aside = folder / f".{MARKER}-{uuid4().hex}"
    try:
        write_file(aside, SHARED_STORE.text())
        restrict(aside, group=group)
        install(aside, folder / MARKER)
    finally:
        aside.unlink(missing_ok=True)


def _convert_all(folder: Path) -> None:
    store, assets = FleetStore.at(str(folder)), folder / _ASSETS
    found = sorted(assets.glob("*.tar")) if is_real_folder(assets) else []
    if found:
        _log.info("assets of an earlier release are taken over in %s: %d", folder, len(found))
    for name in (_ASSETS, UPLOADS, PACKAGES):
        if is_real_folder(folder / name):  # the old fleet has ended, and its writers with it
            sweep(folder / name, lambda file: True)
    for snapshot in found:
        if ID.fullmatch(snapshot.stem) and is_plain(snapshot):
            try:
                _convert(store, folder, snapshot)
            except SnapshotError as error:  # it can be sent again
                _log.error("%s is left as it is: %s", snapshot, error)
    with suppress(OSError):  # something is left in it
        assets.rmdir()


def _convert(store: FleetStore, folder: Path, snapshot: Path) -> None:
    """Push one asset, unless it is there, and remove what it was."""
    if store.assets.revision(snapshot.stem) is None:
        group = has_group(folder)
        make_folder(folder / PARTIAL, group=group)
        with working_folder(folder / PARTIAL, group=group) as place, snapshot.open("rb") as file:
            index = unpack(file, snapshot.stat().st_size, place)
            if index.asset != snapshot.stem:
                raise SnapshotError(f"it is of asset {index.asset}")
            overlay, whole = _present_settings(index, place, snapshot.with_suffix(".json"))
            files = {**index.files, OVERLAY: StoredFile.of(overlay)}
            paths = {name: place / name for name in files if name != OVERLAY}
            index = SnapshotIndex.of(index.asset, files)
            with Snapshot(index, paths, overlay) as made:
                store.assets.push(made, lambda share, file: None)
            if whole and (info := _description(snapshot)) is not None:
                store.files.put_info(info, manifest_digest(index.encode()))
    # The snapshot goes last: as long as it is there, this is done again.
    for suffix in (".json", ".info", ".tar"):
        snapshot.with_suffix(suffix).unlink(missing_ok=True)


def _description(snapshot: Path) -> AssetInfo | None:
    """What lists said of an asset; None where that is of other files, or cannot be read."""
    of = [_revision(snapshot), _revision(snapshot.with_suffix(".json"))]
    try:
        found = json.loads(snapshot.with_suffix(".info").read_bytes())
        return described_asset(found["info"]) if found["of"] == of else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _revision(path: Path) -> list[int] | None:
    with suppress(FileNotFoundError):
        found = path.stat()
        return [found.st_mtime_ns, found.st_ino]
    return None


def _present_settings(index: SnapshotIndex, place: Path, changed: Path) -> tuple[bytes, bool]:
    """The settings of a snapshot with those that were changed since, as the bytes of their file;
    without them, and False, where they are damaged."""
    data, label = (place / OVERLAY).read_bytes(), f"{ASSET} {index.asset}"
    with suppress(FileNotFoundError):
        try:
            changes = json.loads(changed.read_bytes())
            if not isinstance(changes, dict):
                raise ValueError("no settings")
            now = read_overlay(label, data, changed).changed(changes)
            return write_overlay(label, now), True
        except (ValueError, SettingsError) as error:
            _log.error("%s is damaged, and left out: %s", changed, error)
            return data, False
    return data, True
