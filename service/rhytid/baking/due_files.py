"""The files of a frame that are due: their names, the keys of their contents, and what each may be
copied from."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from rhytid.baking.file_writers import FileWriters
from rhytid.baking.frame_names import FramePlace
from rhytid.baking.map_sources import FrameSurface, Geometry
from rhytid.baking.output import BakeRecord, Output
from rhytid.exports.textures.profiles import Profile

# A file with the same contents, and its writing where that may not have ended.
Source = tuple[Path, Future[int] | None]


@dataclass(frozen=True)
class DueMap:
    """A file of a map that is to be written.

    key: of its contents.  source: a file that is copied in place of drawing, unless it is lost
    before that.
    """

    file: Path
    key: str
    profile: Profile
    source: Source | None


@dataclass(frozen=True)
class FrameInWork:
    """A frame whose files are written."""

    place: FramePlace
    surface: FrameSurface
    record: BakeRecord
    writers: FileWriters

    def source(self, profile: Profile, due: Path, key: str) -> Source | None:
        """What the file `due` may be copied from: a file that is being written, or that is there as
        it was written."""
        if profile.renamed is None:
            return None
        if (under_way := self.writers.under_way.get(key)) is not None:
            return under_way
        file = self.record.file_of(key)
        if file is None or file == due:
            return None
        with suppress(OSError):
            if self.record.done(file, key):
                return file, None
        return None


@dataclass(frozen=True)
class FileKeys:
    """The files of frames, and the keys of their contents.

    geometry: of displaced surfaces; None where they are not asked for.
    """

    output: Output
    geometry: Geometry | None

    def of_map(
        self, frame: FrameInWork, udim: int, key: str
    ) -> Iterator[tuple[Path, str, Profile]]:
        """The files of one map, and the keys of their contents.  key: of the map."""
        for profile in self.output.profiles:
            file = self.output.file(profile, udim, frame.place)
            # A map of the neutral is the same in all frames, what is made of positions is not.
            digest = frame.surface.digest() if profile.posed else ""
            digest += frame.surface.history() if profile.lagging else ""
            yield file, f"{key}-{profile.key}{digest}", profile

    def of_surface(self, frame: FrameInWork, keys: Mapping[int, str]) -> tuple[Path, str] | None:
        """The file of the surface that the maps of a frame displace, and the key of its contents;
        None where surfaces are not asked for.  keys: of the maps, by UDIM."""
        if self.geometry is None:
            return None
        file = self.output.geometry_file(frame.place, self.geometry.format)
        words = [frame.surface.digest(), *keys.values(), self.geometry.words]
        key = hashlib.sha256("\n".join(words).encode()).hexdigest()
        return file, key

    def of_frame(self, frame: FrameInWork, keys: Mapping[int, str]) -> dict[Path, set[str]]:
        """The files of a frame, and the key of each.  keys: of its maps, by UDIM."""
        maps = [(f, key) for one in keys.items() for f, key, _ in self.of_map(frame, *one)]
        surface = self.of_surface(frame, keys)
        return {file: {key} for file, key in [*maps, *([surface] if surface else [])]}
