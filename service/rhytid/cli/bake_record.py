"""What is baked already: files of content keys beside the maps."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from rhytid.errors import StorageError
from rhytid.storage.manifest import StoredFile
from rhytid.support.atomic_files import atomic_write, write_file


class BakeRecord:
    """The maps that a bake has written, each with the key of its inputs and a hash of its bytes.

    A map is done only while both still hold: other inputs, or a file that was damaged or removed,
    make it due again. Each part of an animation that is baked by itself has a record of its own,
    so that several can be baked into one folder at once. Raises StorageError where a record itself
    is damaged.

    path: of the record that is written.  others: those of other parts, which are read.  drawn_by:
    names what draws now; of two with other names the bits differ.
    """

    def __init__(self, path: Path, others: Iterable[Path] = (), drawn_by: str = "") -> None:
        self._path, self._drawn_by = path, drawn_by
        self._maps = _load(path)
        self._found = [self._maps, *(_load(other) for other in others if other != path)]

    def done(self, file: Path, key: str) -> bool:
        """Whether `file` is what was written for `key`."""
        entries = [entry for maps in self._found if (entry := maps.get(file.name)) is not None]
        digests = {entry["sha256"] for entry in entries if entry["key"] == key}
        return bool(digests) and file.is_file() and StoredFile.read(file).sha256 in digests

    def add(self, file: Path, key: str) -> None:
        """Note that `file` was written for `key`; on the disk when this returns."""
        digest = StoredFile.read(file).sha256
        self._maps[file.name] = {"key": key, "sha256": digest, "drawn_by": self._drawn_by}
        text = json.dumps({"maps": self._maps}, indent=1, sort_keys=True)
        with atomic_write(self._path) as aside:
            write_file(aside, f"{text}\n".encode())


def drawn_by(records: Iterable[Path]) -> set[str]:
    """What drew the maps that these records name. Maps of older records, which do not say, are left
    out. Where several have a map, the one that was written last counts."""
    found: dict[str, str] = {}
    for record in sorted(records, key=lambda path: path.stat().st_mtime_ns):
        found |= {name: entry["drawn_by"] for name, entry in _load(record).items()}
    return {name for name in found.values() if name}


def _load(path: Path) -> dict[str, dict[str, str]]:
    if not path.exists():
        return {}
    try:
        return _checked(json.loads(path.read_bytes()))
    except (ValueError, KeyError, TypeError) as exc:
        raise StorageError(f"{path} is damaged: remove it to bake everything anew") from exc


def _checked(stored: Any) -> dict[str, dict[str, str]]:
    maps = stored["maps"].items() if isinstance(stored["maps"], dict) else None
    if maps is None:
        raise TypeError("maps is no object")
    return {
        str(name): {
            **{k: str(entry[k]) for k in ("key", "sha256")},
            "drawn_by": str(entry.get("drawn_by", "")),
        }
        for name, entry in maps
    }
