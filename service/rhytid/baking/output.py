"""The files of a bake: their names, their size, and a record of those that are done."""

from __future__ import annotations

import glob
import hashlib
import json
import re
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rhytid.baking.frame_names import FramePlace, FrameRange, frame_numbers
from rhytid.domain.mesh import Mesh
from rhytid.domain.wording import plural
from rhytid.errors import StorageError
from rhytid.exports.textures.frame_map import Facts, FrameMap
from rhytid.exports.textures.profiles import PROFILES, Profile
from rhytid.storage.manifest import StoredFile
from rhytid.support.atomic_files import atomic_write, write_file
from rhytid.support.build_identity import file_attributes

_UNITS = ("bytes", "kB", "MB", "GB", "TB")
FLOATS = (PROFILES["float"],)


class Origin(NamedTuple):
    """What drew a map.  drawn_by: names the device and the version of the drawing.  method: empty
    where the map shows no displacement, and in records of older releases; so may `drawn_by` be."""

    drawn_by: str
    method: str

    def has(self, other: Origin) -> bool:
        """Whether all that another one says is so of this one."""
        return all(theirs in ("", own) for own, theirs in zip(self, other, strict=True))


class Record(NamedTuple):
    """What a file of a record had at a time.  changed: when it was last written.  maps: its entries
    by the names of maps."""

    changed: int
    maps: dict[str, dict[str, str]]

    @classmethod
    def of(cls, file: Path) -> Record:
        """What it has now; raises StorageError where it is damaged."""
        return cls(_last_change(file), _load(file))


@dataclass(frozen=True)
class Output:
    """The files of a bake, in one folder.

    name: first part of their names.  profiles: kinds of maps.  part: the frames that are baked;
    None for all.
    """

    folder: Path
    name: str
    profiles: tuple[Profile, ...] = FLOATS
    part: FrameRange | None = None

    def file(self, profile: Profile, udim: int, frame: FramePlace) -> Path:
        """The file of one map."""
        return self.folder / profile.file_name(self.name, udim, frame.label)

    def geometry_file(self, frame: FramePlace, format: str) -> Path:
        """The file of one displaced surface."""
        return self.folder / f"{self.name}.{frame.label}.{format}"

    def names(
        self, frames: Iterable[FramePlace], udims: Sequence[int], geometry: str | None = None
    ) -> set[str]:
        """Names of all files of some frames.  geometry: format of surfaces; None where there are
        none."""
        found = set()
        for frame in frames:
            found |= {self.file(one, udim, frame).name for one in self.profiles for udim in udims}
            if geometry is not None:
                found.add(self.geometry_file(frame, geometry).name)
        return found

    def places(self, all: Sequence[FramePlace]) -> Sequence[FramePlace]:
        """The frames of this part.  all: those of the animation. Raises InputError naming numbers
        that no frame has."""
        return all if self.part is None else self.part.select(all)

    def record(self, drawn_by: str) -> BakeRecord:
        """The record of this part, which knows those of other parts, too.  drawn_by: names what
        draws now."""
        part = "" if self.part is None else f".{self.part.file_text()}"
        own = self.folder / f"{self.name}.bake{part}.json"
        others = [self.folder / f"{self.name}.bake.json"]
        others += filter(self._concerns, self.folder.glob(f"{glob.escape(self.name)}.bake.*.json"))
        return BakeRecord(own, others, drawn_by)

    def origins(self, now: Origin) -> set[Origin]:
        """What drew the maps of all parts, and how.  now: what has drawn this one.

        Each device leaves a small file for each method, so that a part need not read the records of
        all others. Where there are several such files the records decide, since maps may have been
        drawn anew.
        """
        name, mark = glob.escape(self.name), self.leave_mark(now)
        marks = {*self.folder.glob(f"{name}.device.*.json")} - {mark}
        if not marks:
            return {now}
        found = {now, *self.recorded()}
        if all(now.has(one) for one in found):
            for one in marks:
                one.unlink(missing_ok=True)
        return found

    def left_origins(self) -> set[Origin]:
        """As `origins`, where this part has drawn nothing."""
        marks = [*self.folder.glob(f"{glob.escape(self.name)}.device.*.json")]
        return self.recorded() if len(marks) > 1 else set()

    def records(self) -> dict[Path, Record]:
        """The records of all parts as they are now, by their files."""
        files = self.folder.glob(f"{glob.escape(self.name)}.bake*.json")
        return {file: Record.of(file) for file in files}

    def drop_replaced(self, before: Mapping[Path, Record], parts: Iterable[FrameRange]) -> None:
        """Remove the records of others all of whose maps these parts have written anew, but not
        one that its own bake has changed meanwhile.  before: `records` before the parts wrote."""
        own = {self.folder / f"{self.name}.bake.{part.file_text()}.json" for part in parts}
        was = {k: v for file in own & before.keys() for k, v in before[file].maps.items()}
        now = {k: v for file in own for k, v in _load(file).items()}
        anew = {name for name, entry in now.items() if entry != was.get(name)}
        _drop_replaced({file: before[file] for file in before.keys() - own}, anew)

    def recorded(self) -> set[Origin]:
        """What drew the maps of all parts, and how, by their records."""
        return {*self._origin_of_each().values()}

    def by_method(
        self, frames: Sequence[FramePlace], now: Mapping[str, Origin] | None = None
    ) -> dict[str, FrameRange | None]:
        """The numbers of the frames that have maps by each method, by all records; None where
        these are of another animation.  frames: of this one.  now: maps that will be there."""
        numbers = dict(zip((one.label for one in frames), frame_numbers(frames), strict=True))
        patterns = [profile.pattern(self.name) for profile in PROFILES.values()]
        named = re.compile("|".join(map(_names_like, [*patterns, f"{self.name}.<FRAME>.<ANY>"])))
        found: dict[str, set[int]] = {}
        for file, origin in {**self._origin_of_each(), **(now or {})}.items():
            match = named.fullmatch(file)
            label = next(filter(None, match.groups()), "") if match else ""
            if origin.method:
                known = {numbers[label]} if label in numbers else set()
                found.setdefault(origin.method, set()).update(known)
        return {k: FrameRange.of(them) if them else None for k, them in sorted(found.items())}

    def _origin_of_each(self) -> dict[str, Origin]:
        """What drew each map that is there, by its name. Where several records have a map, the
        latest counts."""
        there = {file.name for file in self.folder.iterdir()}
        records = self.folder.glob(f"{glob.escape(self.name)}.bake*.json")
        return {
            name: Origin(entry["drawn_by"], entry["method"])
            for record in sorted(records, key=_last_change)
            for name, entry in _load(record).items()
            if name in there
        }

    def leave_mark(self, now: Origin) -> Path:
        """The file that names the device and the method that draw now, written where it is not
        there."""
        digest = hashlib.sha256("\n".join(now).encode()).hexdigest()[:8]
        mark = self.folder / f"{self.name}.device.{digest}.json"
        _write_facts(mark, now._asdict())
        return mark

    def _concerns(self, record: Path) -> bool:
        """Whether the record of another part may hold frames of this one. A film may have thousands
        of parts, of which each task reads few records."""
        text = record.name.removeprefix(f"{self.name}.bake.").removesuffix(".json")
        other = FrameRange.of_file_text(text)
        if self.part is None or other is None:
            return True
        return not set(self.part.numbers).isdisjoint(other.numbers)

    def describe(self, drawn: FrameMap, mesh: Callable[[], Facts]) -> None:
        """Write NAME.<PROFILE>.json, which readers of PNG files need, for each such profile. A file
        that is up to date stays.  mesh: gives `mesh_facts`."""
        for profile in self.profiles:
            if profile.described:
                facts = {
                    **profile.all_facts(drawn),
                    "files": profile.pattern(self.name),
                    "unit": drawn.header.unit,
                    "asset": drawn.header.asset,
                    **mesh(),
                    "colour_space": "raw",
                    **file_attributes(),
                }
                _write_facts(self.folder / f"{self.name}.{profile.name}.json", facts)


def mesh_facts(mesh: Mesh) -> Facts:
    """What a mesh that maps are of is known by, in any frame and any order of its triangles."""
    first = np.argmin(mesh.faces, axis=1)[:, None]
    turned = np.take_along_axis(mesh.faces, (first + np.arange(3)) % 3, axis=1)
    ordered = turned[np.lexsort(turned.T[::-1])]
    digest = hashlib.sha256(np.ascontiguousarray(ordered, "<i4").tobytes()).hexdigest()
    counts = {"vertices": len(mesh.positions), "triangles": len(mesh.faces)}
    return {**counts, "faces_sha256": digest}


def _write_facts(file: Path, facts: Mapping[str, str | int | float]) -> None:
    data = f"{json.dumps(facts, indent=1)}\n".encode()
    if not (file.is_file() and file.read_bytes() == data):
        with atomic_write(file) as aside:
            write_file(aside, data)


@dataclass(frozen=True)
class BakeSize:
    """Bytes of maps before compression.

    frame: of one frame.  all: of all frames.  frames: how many there are.
    """

    frame: int
    all: int
    frames: int

    @classmethod
    def of(
        cls, profiles: tuple[Profile, ...], resolution: int, udims: int, frames: int
    ) -> BakeSize:
        """The size of maps with `resolution` texels per side."""
        texel = sum(profile.texel_bytes for profile in profiles)
        frame = round(texel * resolution**2) * udims
        return cls(frame, frame * frames, frames)

    def text(self) -> str:
        """The size as a line of text."""
        return (
            f"maps: up to {_bytes(self.frame)} per frame, {_bytes(self.all)} for "
            f"{plural(self.frames, 'frame')}, before compression"
        )


def _bytes(count: float) -> str:
    power = 0
    while count >= 1000 and power < len(_UNITS) - 1:
        count, power = count / 1000, power + 1
    return f"{count:.3g} {_UNITS[power]}"


class BakeRecord:
    """The maps that a bake has written: for each the key of its inputs, and a hash of its bytes.

    A map is done only while both hold. Other inputs, or a file that was damaged or removed, make it
    due again. Each part of an animation has a record of its own, so that several can be baked into
    one folder at once.

    path: file of this record.  others: files of the records of other parts, which are only read.
    drawn_by: names what draws now; two devices of other names draw other bits. A file is hashed
    once, and again after it was written. Safe from any thread. Raises StorageError where a record
    is damaged.
    """

    def __init__(self, path: Path, others: Iterable[Path] = (), drawn_by: str = "") -> None:
        self._path, self._drawn_by = path, drawn_by
        self._maps = _load(path)
        self._others = {other: Record.of(other) for other in others if other != path}
        self._found = [self._maps, *(other.maps for other in self._others.values())]
        # Of each entry: to make those of a film of many thousand maps anew for each takes long.
        self._texts = {name: _entry_text(name, entry) for name, entry in self._maps.items()}
        self._added: set[str] = set()
        self._names = {entry["key"]: name for maps in self._found for name, entry in maps.items()}
        self._lock = threading.Lock()
        # By name: what `_identity` said of a file when it was hashed, and its SHA-256.
        self._hashed: dict[str, tuple[Identity, str]] = {}

    def devices(self) -> set[str]:
        """What drew the maps that this record and the others know, as `drawn_by` names it."""
        return {entry["drawn_by"] for maps in self._found for entry in maps.values()}

    def knows(self, file: Path) -> bool:
        """Whether a bake has written a file of this name."""
        with self._lock:
            return any(file.name in maps for maps in self._found)

    def done(self, file: Path, key: str) -> bool:
        """Whether `file` is there as it was written for `key`."""
        digests = self._digests(file, key)
        return bool(digests) and file.is_file() and self._sha256(file) in digests

    def file_of(self, key: str) -> Path | None:
        """A file that was written for `key`, if there was one. It may be gone or damaged."""
        name = self._names.get(key)
        return None if name is None else self._path.parent / name

    def contents(self, file: Path, key: str) -> bytes | None:
        """The bytes of a file as it was written for `key`; None where it is not there so, or cannot
        be read."""
        with suppress(OSError):
            data = file.read_bytes()
            if hashlib.sha256(data).hexdigest() in self._digests(file, key):
                return data
        return None

    def add(self, file: Path, key: str, method: str, digest: str) -> None:
        """Record that `file` is written for `key`. The record is on the disk when this returns.

        Called before the file gets its name: a bake that is killed between the two leaves an entry
        of a file that is not there, and never a file that no record knows.  method: as in `Origin`.
        digest: SHA-256 of its bytes.
        """
        with self._lock:
            by = Origin(self._drawn_by, method)._asdict()
            entry = self._maps[file.name] = {"key": key, "sha256": digest, **by}
            self._texts[file.name] = _entry_text(file.name, entry)
            self._names[key] = file.name
            self._added.add(file.name)
            texts = ",\n".join(self._texts[name] for name in sorted(self._texts))
            with atomic_write(self._path) as aside:
                write_file(aside, f'{{\n "maps": {{\n{texts}\n }}\n}}\n'.encode())

    def drop_replaced(self) -> None:
        """Remove the records of other parts all of whose maps this bake has written anew, but not
        one that its own bake has changed meanwhile."""
        _drop_replaced(self._others, self._added)

    def _sha256(self, file: Path) -> str:
        now = _identity(file)
        before, digest = self._hashed.get(file.name, (None, ""))
        if before != now:
            digest = StoredFile.read(file).sha256
            self._hashed[file.name] = now, digest
        return digest

    def _digests(self, file: Path, key: str) -> set[str]:
        with self._lock:
            entries = [maps[file.name] for maps in self._found if file.name in maps]
        return {entry["sha256"] for entry in entries if entry["key"] == key}


# What changes with the bytes of a file.
Identity = tuple[int, int, int, int]


def _identity(file: Path) -> Identity:
    found = file.stat()
    return found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns


def _entry_text(name: str, entry: Mapping[str, str]) -> str:
    """An entry as it is in a record: JSON with an indent of 1, its keys in order."""
    lines = json.dumps({name: entry}, indent=1, sort_keys=True).split("\n")
    return "\n".join(f" {line}" for line in lines[1:-1])


def _drop_replaced(records: Mapping[Path, Record], anew: Set[str]) -> None:
    """Remove those of these records all of whose maps were written anew, but not one that its own
    bake has changed meanwhile."""
    for file, record in records.items():
        if record.maps and record.maps.keys() <= anew and _last_change(file) == record.changed:
            file.unlink(missing_ok=True)


def _last_change(record: Path) -> int:
    with suppress(FileNotFoundError):
        return record.stat().st_mtime_ns
    return 0


def _names_like(pattern: str) -> str:
    """A regular expression of the names of a pattern, with a group for the label of the frame."""
    parts = {"<UDIM>": "[0-9]{4}", "<FRAME>": "(.+)", "<ANY>": "[a-z]+"}
    return "".join(parts.get(part, re.escape(part)) for part in re.split("(<[A-Z]+>)", pattern))


def _load(path: Path) -> dict[str, dict[str, str]]:
    try:
        return _checked(json.loads(path.read_bytes()))
    except FileNotFoundError:  # another part may just have removed it
        return {}
    except (ValueError, KeyError, TypeError) as exc:
        raise StorageError(f"{path} is damaged: remove it to bake everything anew") from exc


def _checked(stored: Any) -> dict[str, dict[str, str]]:
    maps = stored["maps"].items() if isinstance(stored["maps"], dict) else None
    if maps is None:
        raise TypeError("maps is no object")
    return {
        str(name): {
            **{k: str(entry[k]) for k in ("key", "sha256")},
            **{k: str(entry.get(k, "")) for k in Origin._fields},
        }
        for name, entry in maps
    }
