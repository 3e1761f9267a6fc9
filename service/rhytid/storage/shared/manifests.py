"""The manifests of a shared store: of each asset the index of its snapshot."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from rhytid.errors import SharedDamageError, SnapshotError, StorageError
from rhytid.storage.canonical import check_format, parse_hashed
from rhytid.storage.homes import ID, checked_id
from rhytid.storage.shared.place import Place
from rhytid.storage.snapshot_index import FORMAT, LONGEST_INDEX, SnapshotIndex

_FOLDER, _SUFFIX = "manifests", ".json"


class SharedManifests:
    """Reads and writes them; a manifest is replaced as a whole."""

    def __init__(self, place: Place) -> None:
        self._place = place

    def ids(self) -> list[str]:
        """Ids of the assets that have one, ascending."""
        found = self._place.names(_FOLDER)
        ids = (name.removesuffix(_SUFFIX) for name in found if name.endswith(_SUFFIX))
        return [id for id in ids if ID.fullmatch(id)]

    def read(self, id: str) -> bytes | None:
        """Its bytes, of which nothing is checked but their number; None where there is none."""
        name = _name(id)
        size = self._place.size(name)
        if size is not None and size > LONGEST_INDEX:
            raise self.damaged(name, f"it has {size} bytes: at most {LONGEST_INDEX}")
        return None if size is None else self._place.read(name)

    def decode(self, id: str, data: bytes) -> SnapshotIndex:
        """What the bytes say; raises SharedDamageError, and StoreFormatError where a newer version
        of rhytid wrote them."""
        self.check_version(id, data)
        try:
            index = SnapshotIndex.decode(data)
        except SnapshotError as exc:
            raise self.damaged(_name(id), str(exc)) from exc
        if index.asset != id:
            raise self.damaged(_name(id), f"it is of asset {index.asset}")
        return index

    def check_version(self, id: str, data: bytes) -> None:
        """Raise StoreFormatError where a newer version of rhytid wrote these bytes."""
        path = Path(f"{self._place}/{_name(id)}")
        value = None
        with suppress(StorageError):  # a damaged one is of no version
            value = parse_hashed(data, path)
        check_format(value, FORMAT, path)

    def write(self, index: SnapshotIndex) -> None:
        """Write that of an asset, in place of the one that is there."""
        self._place.write(_name(index.asset), index.encode())

    def remove(self, id: str) -> bool:
        """Remove that of an asset; whether there was one."""
        known = self._place.size(_name(id)) is not None
        self._place.remove(_name(id))
        return known

    def damaged(self, name: str, why: str) -> SharedDamageError:
        """The error for an object that is not what was written."""
        return SharedDamageError(f"{self._place}/{name} is damaged: {why}")


def _name(id: str) -> str:
    return f"{_FOLDER}/{checked_id(id)}{_SUFFIX}"
