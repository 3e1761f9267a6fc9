"""The manifests of a shared store: of each asset the index of its snapshot."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from rhytid.errors import SnapshotError, StorageError
from rhytid.storage.canonical import check_format, parse_hashed
from rhytid.storage.homes import ID, checked_id
from rhytid.storage.shared.place import MANIFESTS, Place, damaged
from rhytid.storage.snapshots import FORMAT, LONGEST_INDEX, SnapshotIndex

_SUFFIX = ".json"


class SharedManifests:
    """Reads and writes them; a manifest is replaced as a whole."""

    def __init__(self, place: Place) -> None:
        self._place = place

    def ids(self) -> list[str]:
        """Ids of the assets that have one, ascending."""
        found = self._place.names(MANIFESTS)
        ids = (name.removesuffix(_SUFFIX) for name in found if name.endswith(_SUFFIX))
        return [id for id in ids if ID.fullmatch(id)]

    def read(self, id: str) -> bytes | None:
        """Its bytes, of which nothing is checked but their number; None where there is none."""
        return self._place.read(manifest_name(id), LONGEST_INDEX)

    def decode(self, id: str, data: bytes) -> SnapshotIndex:
        """What the bytes say; raises SharedDamageError, and StoreFormatError where a newer version
        of rhytid wrote them."""
        self.check_version(id, data)
        try:
            index = SnapshotIndex.decode(data)
        except SnapshotError as exc:
            raise damaged(self._place, manifest_name(id), str(exc)) from exc
        if index.asset != id:
            raise damaged(self._place, manifest_name(id), f"it is of asset {index.asset}")
        return index

    def check_version(self, id: str, data: bytes) -> None:
        """Raise StoreFormatError where a newer version of rhytid wrote these bytes."""
        path = Path(f"{self._place}/{manifest_name(id)}")
        value = None
        with suppress(StorageError):  # a damaged one is of no version
            value = parse_hashed(data, path)
        check_format(value, FORMAT, path)

    def write(self, index: SnapshotIndex) -> None:
        """Write that of an asset, in place of the one that is there."""
        self._place.write(manifest_name(index.asset), index.encode())

    def remove(self, id: str) -> bool:
        """Remove that of an asset; whether there was one."""
        return self._place.remove(manifest_name(id))


def manifest_name(id: str) -> str:
    """The name of the manifest of an asset."""
    return f"{MANIFESTS}/{checked_id(id)}{_SUFFIX}"
