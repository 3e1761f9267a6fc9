"""Where a bake writes, in which profiles, how much that is, and which of it is done already."""

from __future__ import annotations

import glob
import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rhytid.baking.frame_names import FramePlace, FrameRange
from rhytid.build_identity import file_attributes
from rhytid.domain.wording import plural
from rhytid.durable import whole, write_file
from rhytid.errors import StorageError
from rhytid.storage.manifest import StoredFile
from rhytid.textures.frame_map import FrameMap
from rhytid.textures.profiles import PROFILES, Profile

_UNITS = ("bytes", "kB", "MB", "GB", "TB")
FLOATS = (PROFILES["float"],)


@dataclass(frozen=True)
class Output:
    """Files in `folder` whose names begin with NAME, by the profiles.

    part: the frames that are baked, where these are not all.
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
        """The names of all files of these frames.  geometry: the format of their surfaces, if they
        have any."""
        found = set()
        for frame in frames:
            found |= {self.file(one, udim, frame).name for one in self.profiles for udim in udims}
            if geometry is not None:
                found.add(self.geometry_file(frame, geometry).name)
        return found

    def places(self, all: Sequence[FramePlace]) -> Sequence[FramePlace]:
        """The frames that are baked, of all; raises InputError for one that there is not."""
        return all if self.part is None else self.part.select(all)

    def record(self, drawn_by: str) -> BakeRecord:
        """What is done already, by this part and by others.  drawn_by: what draws now."""
        part = "" if self.part is None else f".{self.part.file_text()}"
        own = self.folder / f"{self.name}.bake{part}.json"
        others = [self.folder / f"{self.name}.bake.json"]
        others += filter(self._concerns, self.folder.glob(f"{glob.escape(self.name)}.bake.*.json"))
        return BakeRecord(own, others, drawn_by)

    def drawn_by(self, now: str) -> set[str]:
        """What drew the maps of all parts.  now: what has drawn this one.

        A small file for each says so, and a part need not read the records of all others. These are
        read where there are several: maps may have been drawn anew since.
        """
        name = glob.escape(self.name)
        mark = (
            self.folder / f"{self.name}.device.{hashlib.sha256(now.encode()).hexdigest()[:8]}.json"
        )
        _write_facts(mark, {"drawn_by": now})
        marks = {*self.folder.glob(f"{name}.device.*.json")} - {mark}
        if not marks:
            return {now}
        found = {now, *drawn_by(self.folder.glob(f"{name}.bake*.json"))}
        if found == {now}:
            for one in marks:
                one.unlink(missing_ok=True)
        return found

    def _concerns(self, record: Path) -> bool:
        """Whether the record of another part may hold frames of this one: of a film in thousands of
        parts each task reads few of their records."""
        text = record.name.removeprefix(f"{self.name}.bake.").removesuffix(".json")
        other = FrameRange.of_file_text(text)
        if self.part is None or other is None:
            return True
        return not set(self.part.numbers).isdisjoint(other.numbers)

    def describe(self, drawn: FrameMap) -> None:
        """Write what a reader must know of PNG files: NAME.<PROFILE>.json, if it is not there."""
        for profile in self.profiles:
            if profile.described:
                facts = {
                    **profile.all_facts(drawn),
                    "files": profile.pattern(self.name),
                    "unit": drawn.header.unit,
                    "asset": drawn.header.asset,
                    "colour_space": "raw",
                    **file_attributes(),
                }
                _write_facts(self.folder / f"{self.name}.{profile.name}.json", facts)


def _write_facts(file: Path, facts: Mapping[str, str | int | float]) -> None:
    data = f"{json.dumps(facts, indent=1)}\n".encode()
    if not (file.is_file() and file.read_bytes() == data):
        with whole(file) as aside:
            write_file(aside, data)


@dataclass(frozen=True)
class BakeSize:
    """Bytes of the maps of a frame and of all frames, before compression."""

    frame: int
    all: int
    frames: int

    @classmethod
    def of(
        cls, profiles: tuple[Profile, ...], resolution: int, udims: int, frames: int
    ) -> BakeSize:
        """The size of maps of `resolution` texels per side."""
        texel = sum(profile.texel_bytes for profile in profiles)
        frame = round(texel * resolution**2) * udims
        return cls(frame, frame * frames, frames)

    def text(self) -> str:
        """A line about it."""
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
        with whole(self._path) as aside:
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
