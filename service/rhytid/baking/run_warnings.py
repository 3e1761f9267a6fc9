"""Warnings of one run of a command: each is a line on stderr at once, and the last line counts
them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

from rhytid.baking.frames import FrameFiles
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.mesh import Mesh
from rhytid.domain.mesh_warnings import FrameCheck, mesh_warnings
from rhytid.domain.notices import Notice, spacing_of_count
from rhytid.domain.warnings import (
    DEVICES_MIXED,
    FILES_REPLACED,
    METHODS_MIXED,
    SCAN_FILL,
    SCAN_LINES,
    SETTINGS_CHANGED,
    SETTINGS_UNUSED,
    InputWarning,
    not_allowed,
)
from rhytid.domain.wording import plural
from rhytid.errors import StrictError
from rhytid.formats.meshes import MeshFile
from rhytid.support.console import counted, note, print_above

if TYPE_CHECKING:
    # A check needs none of what writes maps.
    from rhytid.baking.frame_names import FrameRange
    from rhytid.baking.output import Origin

# Characters of a range of frames that are told.
_LONGEST = 120
# Lines printed per code: for a long shot in the wrong unit three frames are enough.
_LINES = 3


class RunWarnings:
    """The warnings and notices of one run of a command, within `with`.

    strict: whether warnings are errors.  allow: codes that are no errors even so.  found, notices:
    what there was.
    """

    def __init__(self, command: str, strict: bool, allow: Collection[str] = ()) -> None:
        self._command, self._strict, self._allow = command, strict, allow
        self.found: list[InputWarning] = []
        self.notices: list[Notice] = []
        self._done = "so nothing was done"

    def __enter__(self) -> RunWarnings:
        return self

    def __exit__(self, kind: type[BaseException] | None, *rest: object) -> None:
        """Print the count, also where the run failed, since a warning may be the reason. The
        warnings themselves are far above by then."""
        if kind is not StrictError:
            self.summarize()

    def inputs(
        self, mesh: Mesh, name: str, unit: str, resolution: int, frames: FrameFiles | None = None
    ) -> None:
        """Warn of a mesh from the file `name`, before anything is made of it.

        Where warnings are errors, all frames are read and checked, too; else each is checked when
        it is used. Raises StrictError.
        """
        found = mesh_warnings(mesh, unit, resolution)
        self.add(replace(warning, where=f"{name}, {warning.where}") for warning in found)
        if self._strict and frames is not None:
            check = FrameCheck(mesh, unit)
            for place in counted(frames.places, "checking", "frame"):
                self.add(check.warnings(frames.read(place), f"frame {place.name}"))
        self.refuse()

    def settings(self, warnings: Iterable[InputWarning]) -> None:
        """Warn of settings, and of what was traced. Other warnings of an asset are left out:
        `inputs` and `frame` print those of meshes and frames. Raises StrictError."""
        told = SETTINGS_CHANGED, SETTINGS_UNUSED, SCAN_LINES, SCAN_FILL
        self.add(w for w in warnings if w.code in told)
        self.refuse()

    def frame(self, warnings: Iterable[InputWarning], name: str) -> None:
        """Warn of a frame that is used now. Raises StrictError."""
        self.add(replace(warning, where=f"frame {name}") for warning in warnings)
        self.refuse()

    def refuses(self, code: str) -> bool:
        """Whether a warning of this code is an error."""
        return self._strict and code not in self._allow

    def files_follow(self) -> None:
        """Files are written from now on: errors say so, and no more that nothing was done."""
        self._done = "after files were written"

    def replaces(self, file: Path, known: bool) -> None:
        """Warn of the first file of a bake that will be replaced. Raises StrictError.

        known: whether a record has it.
        """
        why = (
            "it was baked by another method, with other settings or frames, or changed since"
            if known
            else "no record of a bake, NAME.bake.json or NAME.bake.FRAMES.json, beside it has it"
        )
        detail = f"{file} is not what is asked for: {why}; a bake replaces it and others like it"
        self.add([InputWarning(FILES_REPLACED, detail, "the bake")])
        self.refuse()

    def origins(
        self, found: Collection[Origin], by_method: Callable[[], Mapping[str, FrameRange | None]]
    ) -> None:
        """Warn where several devices or methods drew the maps of one bake, as `Output.origins` has
        them.  by_method: gives the frames of each, as `Output.by_method`."""
        devices = {one.drawn_by for one in found} - {""}
        methods = {one.method for one in found} - {""}
        if len(devices) > 1:
            listed = " and ".join(sorted(devices))
            detail = f"maps were drawn by {listed}, whose last bits differ"
            self.add([InputWarning(DEVICES_MIXED, detail, "the bake")])
        if len(methods) > 1:
            self.methods(by_method())

    def methods(self, found: Mapping[str, FrameRange | None], are: str = "are") -> None:
        """Warn where there are several methods.  found: the frames of each.  are: whether they are
        there, or would be."""
        if len(found) > 1:
            each = [
                f"{method} ({f'frames {_short(frames.text())}' if frames else 'other frames'})"
                for method, frames in found.items()
            ]
            detail = (
                f"maps {are} by {' and '.join(each)}, as --frame-range takes them; the records "
                "*.bake*.json name the method of each"
            )
            self.add([InputWarning(METHODS_MIXED, detail, "the bake")])

    def add(self, warnings: Iterable[InputWarning]) -> None:
        """Add warnings, and print the first few new ones of each code."""
        for warning in warnings:
            if warning not in self.found:
                self.found.append(warning)
                if sum(w.code == warning.code for w in self.found) <= _LINES:
                    allowed = "allowed " if warning.code in self._allow else ""
                    self._print(f"{allowed}warning: {warning}")

    def add_notices(self, notices: Iterable[Notice]) -> None:
        """Add and print notices, which `strict` does not refuse."""
        for notice in notices:
            self.notices.append(notice)
            self.note(str(notice))

    def file(self, read: MeshFile) -> None:
        """Print notes of a mesh file, and warn of what in it is not read."""
        for line in read.notes:
            self.note(line)
        self.add_notices(read.notices)
        self.add(read.unused)

    def lengths(self, settings: AssetSettings, spacing: float, grown: int) -> None:
        """Print the lengths that follow from a number of wrinkles, if the settings give one, and
        how many have grown where these are more or fewer.

        settings: resolved.  spacing: of pores, where their density is 1, mesh units.  grown:
        wrinkles, without copies.
        """
        if settings.graph.wrinkles is not None:
            self.note(spacing_of_count(settings, spacing, grown))

    def note(self, line: str) -> None:
        """Print one line as a notice. Prints nothing where quiet."""
        note(f"rhytid {self._command}: notice: {line}")

    def summarize(self) -> None:
        """Print how many warnings there were, and of which codes some were not printed."""
        counts = Counter(warning.code for warning in self.found)
        many = [f"{_LINES} of {n} {code}" for code, n in counts.items() if n > _LINES]
        listed = f"listed above ({', '.join(many)})" if many else "listed above"
        if counts:
            let = sum(warning.code in self._allow for warning in self.found)
            allowed = f", {let} of them allowed" if let else ""
            message = f"{_count(self.found)}{allowed}, {listed}"
            self._print(f"{message}; `rhytid warnings CODE` says what to do")

    def figures(self) -> list[dict[str, str]]:
        """The warnings, for JSON."""
        return [asdict(warning) for warning in self.found]

    def all_figures(self) -> dict[str, list[dict[str, str]]]:
        """The warnings and notices, for JSON."""
        return {"warnings": self.figures(), "notices": [asdict(n) for n in self.notices]}

    def refuse(self) -> None:
        """Raise StrictError where warnings are errors and one is not allowed."""
        wrong = not_allowed(self.found, self._allow) if self._strict else ()
        if wrong:
            codes = " ".join(f"--allow {code}" for code in dict.fromkeys(w.code for w in wrong))
            message = f"--strict: {_count(wrong)}, {self._done} ({codes} would allow that)"
            raise StrictError(message, wrong)

    def _print(self, line: str) -> None:
        print_above(f"rhytid {self._command}: {line}")


def _count(warnings: Sequence[InputWarning]) -> str:
    return plural(len(warnings), "warning")


def _short(text: str) -> str:
    """The beginning of a long list."""
    if len(text) <= _LONGEST:
        return text
    return f"{text[:_LONGEST].rpartition(',')[0]},…"
