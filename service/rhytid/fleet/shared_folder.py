"""The folder that all replicas share: what an asset is, whichever of them has it loaded.

::

    shared/
    ├── format.json           the marker: that this is of a fleet, and of which format
    ├── assets/<id>.tar       a built asset as a snapshot
    ├── assets/<id>.json      its present settings, once they were changed
    ├── assets/<id>.info      what callers see of it with both, so that lists load nothing
    ├── uploads/<id>          what a caller sent, until the asset is built
    ├── uploads/<id>.owner    the replica that builds it
    ├── packages/<id>-<key>.zip
    ├── given/                files on their way between an ingress and a replica
    └── jobs.key              of the seals of jobs' ids
"""

from __future__ import annotations

import json
import os
import re
import secrets
import shutil
import time
from collections.abc import Iterable, Mapping
from contextlib import AbstractContextManager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any
from uuid import uuid4

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.notices import Notice
from rhytid.domain.warnings import InputWarning
from rhytid.engine.messages import AssetInfo, Package
from rhytid.errors import SharedDamageError
from rhytid.storage.homes import ID, checked_id
from rhytid.storage.snapshots import Snapshot
from rhytid.support.atomic_files import (
    atomic_write,
    claim,
    storage_errors,
    sweep,
    sweep_partial,
    sync_file,
    write_file,
    write_pieces,
)
from rhytid.support.ownership import (
    UNIQUE,
    FolderKind,
    check_owned,
    has_group,
    is_real_folder,
    make_folder,
    restrict,
    restrict_folder,
)

# What each folder has, beside what is being written.
_WRITTEN = r"|\.unfinished-" + UNIQUE.pattern
_NAMES = {
    "assets": re.compile(rf"{ID.pattern}\.(tar|json|info){_WRITTEN}", re.ASCII),
    "uploads": re.compile(rf"{ID.pattern}(\.owner)?{_WRITTEN}", re.ASCII),
    "packages": re.compile(rf"{ID.pattern}-{UNIQUE.pattern}\.zip{_WRITTEN}", re.ASCII),
    "given": UNIQUE,
}
# Raise its format when an older release must not use a new one.
FLEET = FolderKind("rhytid fleet", format=1, folders=tuple(_NAMES))
# Skin packages of an asset that stay, by when they were placed.
_PACKAGES = 4
Revision = tuple[int, int] | None
# Of the snapshot and of the settings.
Revisions = tuple[Revision, Revision]
# Bytes of the key of seals, and seconds in which one that makes it has written them.
_KEY, _KEY_SECONDS = 32, 5.0


class SharedFolder:
    """Files that any replica may read and write; each appears whole, by one rename.

    They are for their owner alone; where the group of the folder, or of the one around it, may
    write, for that group. Raises StorageError where the folder cannot be read or written, or holds
    what is not ours; StoreFormatError where a newer release made it; SharedDamageError where a file
    is not what was placed there. Two that write the same asset write the same bytes, so that it
    does not matter which comes last.
    """

    def __init__(self, folder: Path) -> None:
        self._assets, self._uploads = folder / "assets", folder / "uploads"
        self._packages, self._given = folder / "packages", folder / "given"
        self._key = folder / "jobs.key"
        with storage_errors(f"{folder} cannot be used"):
            check_owned(folder, FLEET, _is_of_a_fleet)
            folder.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            self._group = has_group(folder if folder.exists() else folder.parent)
            make_folder(folder, group=self._group)
            claim(folder, FLEET, _is_of_a_fleet)
            for place in (self._assets, self._uploads, self._packages, self._given):
                make_folder(place, group=self._group)
                restrict_folder(place, group=self._group)  # earlier releases let everybody in

    def sweep(self) -> None:
        """Remove what was left by who ended while they wrote, a day ago or earlier."""
        for place in (self._assets, self._uploads, self._packages):
            with storage_errors(f"{place} cannot be read"):
                sweep(place)
        with storage_errors(f"{self._given} cannot be read"):
            sweep_partial(self._given, at_once=False)

    def ids(self) -> list[str]:
        """Ids of assets that are built or are to be, ascending."""
        with storage_errors(f"{self._assets} cannot be read"):
            built = {path.stem for path in self._assets.glob("*.tar")}
            sent = {path.name for path in self._uploads.iterdir()}
        return sorted(name for name in built | sent if ID.fullmatch(name))

    def revision(self, asset: str) -> Revision:
        """Another for another snapshot of the asset; None where there is none."""
        return _revision(self._snapshot(asset))

    def settings_revision(self, asset: str) -> Revision:
        """Another for other settings; None where they were never changed."""
        return _revision(self._settings(asset))

    def put_snapshot(self, asset: str, snapshot: Snapshot) -> Revision:
        """Place a built asset, with its present settings; its revision. Its upload is not needed
        any more."""
        with (
            storage_errors(f"asset {asset} cannot be shared"),
            self._whole(self._snapshot(asset)) as aside,
        ):
            write_pieces(aside, snapshot.pieces())
            placed = _revision(aside)  # another may be in its place at once
        self.remove_upload(asset)
        return placed

    def open_snapshot(self, asset: str) -> Any:
        """The snapshot of an asset, open; raises FileNotFoundError where it has gone."""
        return self._snapshot(asset).open("rb")

    def put_settings(self, asset: str, settings: Mapping[str, Any]) -> Revision:
        """Replace the present settings of an asset; their revision."""
        text = json.dumps(settings, sort_keys=True).encode()
        path = self._settings(asset)
        with storage_errors(f"settings of {asset} cannot be shared"), self._whole(path) as aside:
            write_file(aside, text)
            placed = _revision(aside)
        return placed

    def settings(self, asset: str) -> dict[str, Any]:
        """The present settings of an asset; empty where they were never changed."""
        with storage_errors(f"settings of {asset} cannot be read"), suppress(FileNotFoundError):
            text = self._settings(asset).read_bytes()
            try:
                found: dict[str, Any] = json.loads(text)
            except ValueError as error:
                raise SharedDamageError(f"settings of {asset} are damaged: {error}") from error
            return found
        return {}

    def remove_settings(self, asset: str) -> None:
        """Remove settings that are damaged."""
        with storage_errors(f"settings of {asset} cannot be removed"):
            self._settings(asset).unlink(missing_ok=True)

    def put_info(self, info: AssetInfo, of: Revisions) -> None:
        """Say what callers see of a ready asset.  of: the files that it is made of."""
        text = json.dumps({"of": of, "info": asdict(info)}).encode()
        path = self._info(info.id)
        with storage_errors(f"asset {info.id} cannot be described"), self._whole(path) as aside:
            write_file(aside, text)

    def info(self, asset: str, of: Revisions) -> AssetInfo | None:
        """What callers see of a ready asset; None where nobody has said it of these files, or
        another release did."""
        with storage_errors(f"asset {asset} cannot be read"), suppress(FileNotFoundError):
            try:
                found = json.loads(self._info(asset).read_bytes())
                if found["of"] == [None if one is None else list(one) for one in of]:
                    return _asset_info(found["info"])
            except (ValueError, KeyError, TypeError):
                return None
        return None

    def job_key(self) -> bytes:
        """The key of the seals of jobs' ids: made once, by whoever asks first."""
        with storage_errors(f"{self._key} cannot be used"):
            with suppress(FileExistsError):
                made = os.open(self._key, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600)
                try:
                    with open(made, "wb") as file:
                        file.write(secrets.token_bytes(_KEY))
                except BaseException:  # such as of a full disk: the next start makes it
                    self._key.unlink(missing_ok=True)
                    raise
                restrict(self._key, group=self._group)
            until = time.monotonic() + _KEY_SECONDS
            while len(key := self._key.read_bytes()) != _KEY:
                if time.monotonic() > until:
                    raise SharedDamageError(f"{self._key} is damaged: remove it")
                time.sleep(0.01)  # another is about to write it
            return key

    def put_upload(self, asset: str, owner: str, pieces: Iterable[bytes | memoryview]) -> None:
        """Keep what a caller sent, in place of what was kept; nothing where that fails."""
        self.own(asset, owner)
        try:
            with (
                storage_errors(f"upload {asset} cannot be kept"),
                self._whole(self._upload(asset)) as aside,
            ):
                write_pieces(aside, pieces)
        except BaseException:
            self.remove_upload(asset)
            raise

    def own(self, asset: str, owner: str) -> None:
        """Say which replica builds an asset."""
        with (
            storage_errors(f"upload {asset} cannot be kept"),
            self._whole(self._owner(asset)) as aside,
        ):
            write_file(aside, owner.encode())

    def owner(self, asset: str) -> str | None:
        """The replica that builds an asset; None where nothing of it was sent, or it is built."""
        with storage_errors(f"upload {asset} cannot be read"), suppress(FileNotFoundError):
            if self._upload(asset).stat():
                return self._owner(asset).read_text()
        return None

    def upload(self, asset: str) -> bytes:
        """What a caller sent; raises FileNotFoundError where it has gone."""
        return self._upload(asset).read_bytes()

    def remove_upload(self, asset: str) -> None:
        """What was sent is not needed any more."""
        with storage_errors(f"upload {asset} cannot be removed"):
            self._upload(asset).unlink(missing_ok=True)
            self._owner(asset).unlink(missing_ok=True)

    def remove(self, asset: str) -> None:
        """Remove all of an asset: its snapshot goes first, by which it is there."""
        with storage_errors(f"asset {asset} cannot be removed"):
            self._snapshot(asset).unlink(missing_ok=True)
            self._settings(asset).unlink(missing_ok=True)
            self._info(asset).unlink(missing_ok=True)
            for package in self._packages.glob(f"{asset}-*.zip"):
                package.unlink(missing_ok=True)
        self.remove_upload(asset)

    def give(self, pieces: Iterable[bytes]) -> Path:
        """A new file on its way; who takes it removes it."""
        path = self._given / uuid4().hex
        with storage_errors("a file cannot be passed on"):
            try:
                write_pieces(path, pieces)
                restrict(path, group=self._group)
            except BaseException:
                path.unlink(missing_ok=True)
                raise
        return path

    def share_package(self, asset: str, package: Package) -> Package:
        """A skin package where every ingress can read it; older ones of the asset go."""
        place = self._packages / f"{asset}-{package.key}.zip"
        with storage_errors(f"a package of {asset} cannot be shared"):
            if not place.exists():
                with self._whole(place) as aside:
                    shutil.copyfile(package.file, aside)
                    sync_file(aside)
                files = sorted(self._packages.glob(f"{asset}-*.zip"), key=_placed, reverse=True)
                for old in files[_PACKAGES:]:
                    old.unlink(missing_ok=True)
        return Package(package.key, place, package.nbytes, package.files)

    def _whole(self, file: Path) -> AbstractContextManager[Path]:
        return atomic_write(file, private=True, group=self._group)

    def _snapshot(self, asset: str) -> Path:
        return self._assets / f"{checked_id(asset)}.tar"

    def _settings(self, asset: str) -> Path:
        return self._assets / f"{checked_id(asset)}.json"

    def _info(self, asset: str) -> Path:
        return self._assets / f"{checked_id(asset)}.info"

    def _upload(self, asset: str) -> Path:
        return self._uploads / checked_id(asset)

    def _owner(self, asset: str) -> Path:
        return self._uploads / f"{checked_id(asset)}.owner"


def _is_of_a_fleet(folder: Path) -> bool:
    """Whether a folder without a marker is of a release that wrote none: that made all four folders
    at once, and files of a few kinds in them."""
    return all(
        is_real_folder(folder / place)
        and all(name.fullmatch(file.name) for file in (folder / place).iterdir())
        for place, name in _NAMES.items()
    )


def _revision(path: Path) -> Revision:
    with storage_errors(f"{path} cannot be read"), suppress(FileNotFoundError):
        found = path.stat()
        return found.st_mtime_ns, found.st_ino
    return None


def _asset_info(found: dict[str, Any]) -> AssetInfo | None:
    """What `put_info` has written of an asset; None where settings have other names now. Raises
    KeyError, TypeError and ValueError where another release wrote something else."""
    if not _same_names(found["settings"], AssetSettings().as_json()):
        return None
    return AssetInfo(
        **{
            **found,
            "udims": tuple(found["udims"]),
            "warnings": tuple(InputWarning(**one) for one in found["warnings"]),
            "notices": tuple(Notice(**one) for one in found["notices"]),
            "centre": tuple(found["centre"]),
        }
    )


def _same_names(one: Any, other: Any) -> bool:
    if not (isinstance(one, dict) and isinstance(other, dict)):
        return True
    return one.keys() == other.keys() and all(_same_names(one[k], other[k]) for k in one)


def _placed(path: Path) -> int:
    with suppress(FileNotFoundError):
        return path.stat().st_mtime_ns
    return 0
