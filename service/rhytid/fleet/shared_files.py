"""The files of a fleet in its shared store beside the assets, for all replicas and ingresses.

::

    PLACE/
    ├── manifests/, objects/, …     the assets, as of any shared store
    ├── uploads/<id>                what a caller sent, until the asset is built
    ├── uploads/<id>.owner          the replica that builds it
    ├── infos/<id>.json             what callers see of an asset, so that lists load nothing
    ├── packages/<id>-<key>.zip     skin packages, the last four of an asset
    ├── given/                      snapshots on their way between an ingress and a replica
    └── jobs.key                    of the seals of jobs' ids
"""

from __future__ import annotations

import json
import secrets
import struct
import threading
import time
from collections import OrderedDict
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, replace
from pathlib import Path
from tempfile import mkdtemp
from typing import Any, BinaryIO
from uuid import uuid4

import numpy as np

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.notices import Notice
from rhytid.domain.warnings import InputWarning
from rhytid.engine.messages import AssetInfo, NewAsset, Package
from rhytid.errors import SharedDamageError, SharedStoreError, StorageError
from rhytid.processes.decoding.words import read_word
from rhytid.processes.keyed_locks import KeyedLocks
from rhytid.processes.packing import pack, places_of
from rhytid.storage.homes import ID, checked_id
from rhytid.storage.shared.backend import Backend, damaged, reached
from rhytid.support.atomic_files import storage_errors, sweep_partial
from rhytid.support.ownership import UNIQUE, NotPlainError, open_plain
from rhytid.support.temporary_folders import removed_at_exit, temporary_folder

UPLOADS, INFOS, PACKAGES, GIVEN, KEY = "uploads", "infos", "packages", "given", "jobs.key"
# Skin packages of an asset that stay, by when they were placed; and copies of them on this machine.
_PACKAGES, _COPIES = 4, 8
# Bytes of the key of seals, and seconds in which a machine that makes it has written them.
_KEY_BYTES, _KEY_SECONDS = 32, 5.0
# Bytes of the name of a replica, and of what callers see of an asset, at most.
_LONGEST_OWNER, _LONGEST_INFO = 1 << 10, 1 << 20
# Seconds after which a file of `give` is removed that no process has taken.
_ABANDONED = 24 * 3600.0
# Of an upload: bytes of the pickle, and number of arrays; sizes of the arrays, the pickle and the
# arrays follow.
_HEAD = struct.Struct("<QQ")


class SharedFiles:
    """Objects of a backend, each there whole or not at all.

    Methods raise SharedStoreError where the backend cannot be used, SharedDamageError where an
    object is not what was written, NotFoundError for what is no id of an asset. Two machines that
    write the same object write the same bytes, so that it does not matter which comes last.
    """

    def __init__(self, backend: Backend) -> None:
        self._backend = backend
        self._copies: OrderedDict[str, Path] = OrderedDict()
        self._copied: Path | None = None
        # A package is copied by one thread at a time.
        self._copying, self._lock = KeyedLocks(), threading.Lock()

    def sweep(self) -> None:
        """Remove files of `give` that are a day old: the process that should remove them ended."""
        folder = self._backend.local(GIVEN)
        if folder is not None:
            with storage_errors(f"{folder} cannot be read"), suppress(FileNotFoundError):
                sweep_partial(folder, at_once=False)
            return
        before = time.time() - _ABANDONED
        for name, found in self._backend.found(GIVEN).items():
            if UNIQUE.fullmatch(name) and found.modified < before:
                self._backend.remove(f"{GIVEN}/{name}")

    def uploads(self) -> list[str]:
        """Ids of assets that are to be built, ascending."""
        return [name for name in self._backend.names(UPLOADS) if ID.fullmatch(name)]

    def put_upload(self, asset: str, owner: str, pieces: Iterable[bytes | memoryview]) -> None:
        """Keep the upload of an asset, in place of an earlier one; on failure none is kept.

        owner: the replica that builds the asset.
        """
        self.own(asset, owner)
        try:
            self._backend.put(_upload(asset), pieces)
        except BaseException:
            with suppress(StorageError):
                self.remove_upload(asset)
            raise

    def own(self, asset: str, owner: str) -> None:
        """Say which replica builds an asset."""
        self._backend.write(_owner(asset), owner.encode())

    def owner(self, asset: str) -> str | None:
        """The replica that builds an asset; None where there is no upload of it."""
        if self._backend.find(_upload(asset)) is None:
            return None
        data = self._backend.read(_owner(asset), _LONGEST_OWNER)
        return None if data is None else data.decode(errors="replace")

    def upload(self, asset: str) -> bytes | None:
        """The upload of an asset; None where it has gone."""
        with self._fetched(_upload(asset)) as file:
            return None if file is None else file.read()

    def remove_upload(self, asset: str) -> None:
        """Remove the upload of an asset, if there is one."""
        self._backend.remove(_upload(asset))
        self._backend.remove(_owner(asset))

    def put_info(self, info: AssetInfo, manifest: str) -> None:
        """Describe a ready asset, as callers see it.  manifest: SHA-256 of the manifest that it
        has."""
        text = json.dumps({"of": manifest, "info": asdict(info)}).encode()
        self._backend.write(_info(info.id), text)

    def info(self, asset: str, manifest: str) -> AssetInfo | None:
        """The description of a ready asset; None where there is none of this manifest that this
        release reads."""
        try:
            data = self._backend.read(_info(asset), _LONGEST_INFO)
            found = {} if data is None else json.loads(data)
            if manifest and found["of"] == manifest:
                return described_asset(found["info"])
        except (ValueError, KeyError, TypeError, SharedDamageError):
            return None
        return None

    def job_key(self) -> bytes:
        """The key of the seals of jobs' ids: made once, by the machine that asks first."""
        until = time.monotonic() + _KEY_SECONDS
        if self._backend.find(KEY) is None:
            self._backend.create(KEY, secrets.token_bytes(_KEY_BYTES))
        while len(key := self._backend.read(KEY, _KEY_BYTES) or b"") != _KEY_BYTES:
            if time.monotonic() > until:
                raise SharedDamageError(f"{self._backend}/{KEY} is damaged: remove it")
            time.sleep(0.01)  # another machine is about to write it
        return key

    def give(self, pieces: Iterable[bytes]) -> str:
        """Write a file for another process, which removes it; its name."""
        name = f"{GIVEN}/{uuid4().hex}"
        self._backend.put(name, pieces)
        return name

    @contextmanager
    def given(self, name: str) -> Iterator[BinaryIO]:
        """A file of `give`, open; raises SharedStoreError where it has gone."""
        with self._fetched(name) as file:
            if file is None:
                raise SharedStoreError(f"{self._backend}/{name} is gone")
            yield file

    def remove_given(self, name: str) -> None:
        """Remove a file that was taken."""
        self._backend.remove(name)

    def share_package(self, asset: str, package: Package) -> Package:
        """Put a skin package where every ingress can read it, and remove older ones of the asset;
        `package` finds its file."""
        name = f"{PACKAGES}/{checked_id(asset)}-{package.key}.zip"
        if self._backend.find(name) is None:
            self._backend.send(name, package.file)
            found = self._packages(asset)
            others = [one for one in found if f"{PACKAGES}/{one}" != name]  # in a bucket as old
            for old in sorted(others, key=found.__getitem__, reverse=True)[_PACKAGES - 1 :]:
                self._backend.remove(f"{PACKAGES}/{old}")
        return replace(package, file=Path(name))

    def package(self, shared: Package) -> Package:
        """A package of `share_package`, whose file is on this machine."""
        name = shared.file.as_posix()
        local = self._backend.local(name)
        return replace(shared, file=self._copy(name) if local is None else local)

    def remove(self, asset: str) -> None:
        """Remove all of an asset."""
        self._backend.remove(_info(asset))
        for package in self._packages(asset):
            self._backend.remove(f"{PACKAGES}/{package}")
        self.remove_upload(asset)

    def _packages(self, asset: str) -> dict[str, float]:
        """When the packages of an asset were placed, by their names."""
        found = self._backend.found(PACKAGES).items()
        return {name: one.modified for name, one in found if name.startswith(f"{asset}-")}

    def _copy(self, name: str) -> Path:
        """A package out of a bucket, whose file stays until eight others have come."""
        with self._copying.holding(name):  # a page asks for many files of a package at once
            if (known := self._copies.get(name)) is not None:
                return known
            path = self._folder_of_copies() / uuid4().hex
            if not self._backend.fetch(name, path):
                raise SharedStoreError(f"{self._backend}/{name} is gone")
            with self._lock:
                self._copies[name] = path
                while len(self._copies) > _COPIES:
                    self._copies.popitem(last=False)[1].unlink(missing_ok=True)
            return path

    def _folder_of_copies(self) -> Path:
        with self._lock:
            if self._copied is None:
                self._copied = removed_at_exit(Path(mkdtemp(prefix="rhytid-packages-")))
            return self._copied

    @contextmanager
    def _fetched(self, name: str) -> Iterator[BinaryIO | None]:
        """An object, open; None where there is none. One of a bucket is copied to this machine
        before."""
        with ExitStack() as held:
            path = self._backend.local(name)
            if path is None:
                path = held.enter_context(temporary_folder("rhytid-given-")) / "file"
                if not self._backend.fetch(name, path):
                    yield None
                    return
            yield self._opened(name, path, held)

    def _opened(self, name: str, path: Path, held: ExitStack) -> BinaryIO | None:
        with reached(f"{path} cannot be read"):
            try:
                return held.enter_context(open_plain(path))
            except FileNotFoundError:
                self._backend.find(name)  # raises where the whole store is gone
                return None
            except NotPlainError as error:
                raise damaged(self._backend, name, "it is no plain file") from error


def written_upload(new: NewAsset) -> Iterator[bytes | memoryview]:
    """An upload as the bytes of a file, which `read_upload` reads."""
    packed = pack(new)
    sizes = [size for _, size in packed.places]
    yield _HEAD.pack(len(packed.body), len(sizes))
    yield struct.pack(f"<{len(sizes)}Q", *sizes)
    yield packed.body
    memory = np.zeros(packed.nbytes, np.uint8)
    packed.write(memory)
    yield memory.data


def read_upload(data: bytes) -> NewAsset:
    """The upload of `written_upload`; nothing in the bytes is run. Raises SharedDamageError where
    they are damaged."""
    try:
        length, count = _HEAD.unpack_from(data)
        start = _HEAD.size + 8 * count
        sizes = struct.unpack_from(f"<{count}Q", data, _HEAD.size)
        memory = np.frombuffer(data, np.uint8)[start + length :].copy()
        found = read_word(data[start : start + length], places_of(sizes), memory)
    except Exception as error:
        raise SharedDamageError(f"an upload that was kept is damaged: {error}") from error
    if not isinstance(found, NewAsset):
        raise SharedDamageError("an upload that was kept is damaged: it is no asset")
    return found


def described_asset(found: dict[str, Any]) -> AssetInfo | None:
    """The description that `put_info` wrote; None where settings have other names now. Raises
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


def _upload(asset: str) -> str:
    return f"{UPLOADS}/{checked_id(asset)}"


def _owner(asset: str) -> str:
    return f"{_upload(asset)}.owner"


def _info(asset: str) -> str:
    return f"{INFOS}/{checked_id(asset)}.json"
