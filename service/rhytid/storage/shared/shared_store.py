"""Assets that several machines share.

::

    PLACE/
    ├── format.json                the marker: that this is a shared store, and of which format
    ├── manifests/<id>.json        what an asset is made of: the index of its snapshot, written last
    ├── objects/<id>/<sha256>      its files, never changed, by the SHA-256 of their bytes
    ├── drawing                    `drawing_version` of the server that started last
    └── partial/                   of a folder: files that are being written

Nothing is locked. A manifest is replaced as a whole, and objects are there before a manifest names
them, so that a reader finds an asset as one writer left it, or not at all. A machine that removes
an asset looks for its manifest again afterwards, and one that pushes it looks for its objects: the
last of them finds what the other has left, so that no manifest stays without its objects.
"""

from __future__ import annotations

import hashlib
import logging
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from rhytid.errors import (
    NotFoundError,
    SharedDamageError,
    SharedStoreError,
    SnapshotError,
    StorageError,
)
from rhytid.storage.canonical import check_format, parse_hashed
from rhytid.storage.homes import ID, checked_id
from rhytid.storage.manifest import StoredFile
from rhytid.storage.shared import backend_of
from rhytid.storage.shared.backend import MANIFESTS, OBJECT, OBJECTS, Backend, damaged
from rhytid.storage.snapshots import FORMAT, LONGEST_INDEX, Snapshot, SnapshotIndex, sealed
from rhytid.support.atomic_files import remove_tree
from rhytid.support.build_identity import drawing_version

# Called with the share of the work that is done and the file that comes next; may raise to end it.
Report = Callable[[float, str], None]
# How often an asset is fetched again that is replaced meanwhile, and how often one is pushed or
# removed while others do the opposite.
_TRIES, _ROUNDS = 3, 10
# The object that names how servers draw, and its bytes at most.
_DRAWING, _LONGEST_DRAWING = "drawing", 200
_SUFFIX = ".json"
# Seconds between two looks at it.
_LOOK = 60.0
_log = logging.getLogger(__name__)


class _Missing(Exception):
    """An object that a manifest names is not there."""


class SharedStore:
    """Assets at a place that several machines reach; safe from any thread.

    Methods raise SharedStoreError where the place cannot be used.
    """

    def __init__(self, backend: Backend) -> None:
        self._backend, self._manifests = backend, _Manifests(backend)
        self._claimed = False
        self._seen, self._look_at = drawing_version(), 0.0

    @classmethod
    def at(cls, text: str) -> SharedStore:
        """At the place that an option names; raises what `backend_of` does."""
        return cls(backend_of(text))

    def __str__(self) -> str:
        return str(self._backend)

    @property
    def fresh(self) -> float:
        """As `Backend.fresh`, of revisions."""
        return self._backend.fresh

    def check(self) -> None:
        """Raise SharedStoreError where nothing can be read there, StoreFormatError where a newer
        release made it. Says in the log where the server that started last draws otherwise, and
        notes how this one does."""
        self._claim()
        self._backend.check()
        self._compare_drawing()
        if self._seen != drawing_version():
            with suppress(StorageError, OSError):  # it may be read-only, or full
                self._backend.write(_DRAWING, drawing_version().encode())

    def ids(self) -> list[str]:
        """Ids of the assets, ascending; none of them is read."""
        return list(self.revisions())

    def revisions(self) -> dict[str, str]:
        """Revisions of the manifests of all assets, by id, ascending."""
        self._claim()
        return self._manifests.revisions()

    def revision(self, id: str) -> str | None:
        """Another once an asset was changed; None where it is not there. Nothing is read."""
        self._claim()
        found = self._backend.find(_manifest_name(id))
        return None if found is None else found.revision

    def index(self, id: str) -> SnapshotIndex:
        """The files of an asset: its manifest.

        Raises NotFoundError where it is not there, SharedDamageError naming its manifest, and
        StoreFormatError where a newer version of rhytid wrote that.
        """
        self._claim()
        if time.monotonic() >= self._look_at:  # of a bucket it takes as long as the manifest
            self._compare_drawing()
        data = self._manifests.read(id)
        if data is None:
            raise NotFoundError(f"no asset {id} in the shared store")
        return self._manifests.decode(id, data)

    def push(self, made: Snapshot, report: Report, *, anew: bool = False) -> bool:
        """Write a snapshot, its manifest last; False where all of it was there already.

        Objects of the right size are left as they are, unless `anew`; files that are sent are
        checked before. Objects that others remove meanwhile are written again.  Raises
        StoreFormatError, and changes nothing, where a newer version of rhytid wrote the asset;
        StorageError where a file is damaged here, and NotFoundError where the asset was removed
        here meanwhile.
        """
        self._claim()
        index = made.index
        before = self._before(index.asset)
        written = [self._put(made, name, report, anew) for name in index.files]
        if before == index.encode() and not any(written):
            return False
        for _ in range(_ROUNDS):
            report(1.0, "manifest")
            self._manifests.write(index)
            if not self._completed(made):
                return True
        raise SharedStoreError(f"asset {index.asset} is being removed from {self}")

    def fetch(self, id: str, into: Path, report: Report) -> SnapshotIndex:
        """Write the files of an asset into the empty folder `into`, as `unpack` does, each compared
        with its SHA-256; what is written on failure is left there.

        Raises what `index` does, and SharedDamageError naming the first object that is not what was
        written.
        """
        for _ in range(_TRIES):
            index = self.index(id)
            try:
                with sealed(index, into):
                    self._fetch_all(index, into, report)
            except _Missing as missing:
                if self._manifests.read(id) == index.encode():
                    raise SharedDamageError(str(missing)) from None
                for left in into.iterdir():
                    remove_tree(left)
            else:
                return index
        raise SharedDamageError(f"asset {id} in {self} was replaced {_TRIES} times meanwhile")

    def digest(self, id: str) -> str:
        """SHA-256 of the manifest of an asset; empty where it is not there."""
        self._claim()
        data = self._manifests.read(id)
        return "" if data is None else manifest_digest(data)

    def read(self, index: SnapshotIndex, name: str) -> bytes:
        """A small file of an asset, compared with its SHA-256; raises SharedDamageError where it is
        not what was written."""
        file = index.files[name]
        data = self._backend.read(_object(index.asset, file), file.nbytes)
        if data is None or StoredFile.of(data) != file:
            why = "it is missing" if data is None else "it does not have the SHA-256 that names it"
            raise damaged(self, _object(index.asset, file), why)
        return data

    def holds(self, id: str) -> bool:
        """Whether an asset is there, its files by their sizes; raises what `index` does, but where
        it is not there."""
        try:
            index = self.index(id)
        except NotFoundError:
            return False
        return all(self._size(_object(id, file)) == file.nbytes for file in index.files.values())

    def remove(self, id: str) -> None:
        """Remove an asset, its manifest first; raises NotFoundError where it is not there."""
        self._claim()
        known = False
        for _ in range(_ROUNDS):
            known = self._remove(id) or known
            # One that was written meanwhile names objects that were removed after it.
            if self._backend.find(_manifest_name(id)) is None:
                break
        else:
            raise SharedStoreError(f"asset {id} is being pushed to {self}")
        if not known:
            raise NotFoundError(f"no asset {id} in the shared store")

    def _size(self, name: str) -> int | None:
        found = self._backend.find(name)
        return None if found is None else found.nbytes

    def _claim(self) -> None:
        """Raise StoreFormatError where a newer release made the shared store; looked at once."""
        if not self._claimed:
            self._backend.claim()
            self._claimed = True

    def _compare_drawing(self) -> None:
        """Warn, once for each, of a `drawing_version` that is not the one of this rhytid: the same
        asset has other maps there."""
        self._look_at = time.monotonic() + _LOOK
        text = ""
        with suppress(SharedDamageError):
            data = self._backend.read(_DRAWING, _LONGEST_DRAWING)
            text = (data or b"").decode(errors="replace")
        if text not in ("", drawing_version(), self._seen):
            _log.warning(
                "%s is used by a rhytid that draws as %s, this one draws as %s: maps may differ; "
                "install the same rhytid on all machines",
                self,
                text,
                drawing_version(),
            )
        self._seen = text

    def _remove(self, id: str) -> bool:
        """Remove the manifest of an asset, then its objects; whether there was a manifest."""
        known = self._manifests.remove(id)
        folder = _object_folder(id)
        for name in filter(OBJECT.fullmatch, self._backend.names(folder)):
            self._backend.remove(f"{folder}/{name}")
        return known

    def _completed(self, made: Snapshot) -> bool:
        """Whether objects had to be written again that were removed before the manifest was there.
        The manifest goes where they cannot be."""
        index = made.index
        there = set(self._backend.names(_object_folder(index.asset)))
        gone = [name for name, file in index.files.items() if file.sha256 not in there]
        try:
            for name in gone:
                self._put(made, name, _untold, anew=True)
        except BaseException:
            with suppress(StorageError):
                self._manifests.remove(index.asset)
            raise
        return bool(gone)

    def _before(self, id: str) -> bytes | None:
        """The manifest that is there; None where it is to be written anew."""
        try:
            before = self._manifests.read(id)
        except SharedDamageError:
            return None
        if before is not None:
            self._manifests.check_version(id, before)
        return before

    def _put(self, made: Snapshot, name: str, report: Report, anew: bool) -> bool:
        """Whether a file had to be written."""
        index, paths, overlay = made.parts
        file, files = index.files[name], list(index.files)
        report(files.index(name) / len(files), name)
        target = _object(index.asset, file)
        if not anew and self._size(target) == file.nbytes:
            return False
        if name in paths:
            made.check_file(name)
            self._send(index.asset, target, paths[name])
        else:
            self._backend.write(target, overlay)
        return True

    def _send(self, id: str, target: str, source: Path) -> None:
        try:
            self._backend.send(target, source)
        except SharedStoreError:
            if not source.exists():  # then it was not the place that failed
                raise NotFoundError(f"asset {id} was removed while it was pushed") from None
            raise

    def _fetch_all(self, index: SnapshotIndex, into: Path, report: Report) -> None:
        done, whole = 0, sum(file.nbytes for file in index.files.values())
        for name, file in index.files.items():
            report(done / max(whole, 1), name)
            self._fetch(_object(index.asset, file), file, into / name)
            done += file.nbytes

    def _fetch(self, name: str, wanted: StoredFile, to: Path) -> None:
        size = self._size(name)  # what is too large is not fetched
        if size is None or (size == wanted.nbytes and not self._backend.fetch(name, to)):
            raise _Missing(f"{self}/{name} is missing, and the manifest of the asset names it")
        if size != wanted.nbytes:
            why = f"it has {size} bytes, the manifest says {wanted.nbytes}"
            raise damaged(self, name, why)
        if StoredFile.read(to) != wanted:
            raise damaged(self, name, "it does not have the SHA-256 that names it")


class _Manifests:
    """The manifests: of each asset the index of its snapshot. One is replaced as a whole."""

    def __init__(self, backend: Backend) -> None:
        self._backend = backend

    def revisions(self) -> dict[str, str]:
        """The revision of each, by the id of its asset, ascending."""
        found = self._backend.found(MANIFESTS)
        named = {name.removesuffix(_SUFFIX): name for name in found if name.endswith(_SUFFIX)}
        return {id: found[name].revision for id, name in named.items() if ID.fullmatch(id)}

    def read(self, id: str) -> bytes | None:
        """Its bytes, of which nothing is checked but their number; None where there is none."""
        return self._backend.read(_manifest_name(id), LONGEST_INDEX)

    def decode(self, id: str, data: bytes) -> SnapshotIndex:
        """The index in these bytes; raises SharedDamageError, and StoreFormatError where a newer
        version of rhytid wrote them."""
        self.check_version(id, data)
        try:
            index = SnapshotIndex.decode(data)
        except SnapshotError as exc:
            raise damaged(self._backend, _manifest_name(id), str(exc)) from exc
        if index.asset != id:
            raise damaged(self._backend, _manifest_name(id), f"it is of asset {index.asset}")
        return index

    def check_version(self, id: str, data: bytes) -> None:
        """Raise StoreFormatError where a newer version of rhytid wrote these bytes."""
        path = Path(f"{self._backend}/{_manifest_name(id)}")
        value = None
        with suppress(StorageError):  # a damaged one is of no version
            value = parse_hashed(data, path)
        check_format(value, FORMAT, path)

    def write(self, index: SnapshotIndex) -> None:
        """Write that of an asset, in place of the one that is there."""
        self._backend.write(_manifest_name(index.asset), index.encode())

    def remove(self, id: str) -> bool:
        """Remove that of an asset; whether there was one."""
        return self._backend.remove(_manifest_name(id))


def _untold(share: float, file: str) -> None:
    """A report that is not passed on, and does not end the work."""


def _object_folder(id: str) -> str:
    return f"{OBJECTS}/{checked_id(id)}"


def _object(id: str, file: StoredFile) -> str:
    return f"{_object_folder(id)}/{file.sha256}"


def _manifest_name(id: str) -> str:
    """The name of the manifest of an asset."""
    return f"{MANIFESTS}/{checked_id(id)}{_SUFFIX}"


def manifest_digest(data: bytes) -> str:
    """SHA-256 of a manifest, by which a note or a description names the state that it is of."""
    return hashlib.sha256(data).hexdigest()
