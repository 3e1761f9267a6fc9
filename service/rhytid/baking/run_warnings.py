"""How a command warns: a line on stderr at once, and at the end one that says how many."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from dataclasses import asdict, replace

from tqdm import tqdm  # type: ignore[import-untyped]

from rhytid.baking.frames import FrameFiles
from rhytid.console import counted, note
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.frame_warnings import FrameCheck
from rhytid.domain.mesh import Mesh
from rhytid.domain.mesh_warnings import mesh_warnings
from rhytid.domain.notices import Notice, count_told
from rhytid.domain.warnings import (
    DEVICES_MIXED,
    SETTINGS_CHANGED,
    SETTINGS_UNUSED,
    InputWarning,
    not_allowed,
)
from rhytid.domain.wording import plural
from rhytid.errors import StrictError

# Lines printed per code: for a long shot in the wrong unit three frames are enough.
_LINES = 3


class RunWarnings:
    """The warnings of one run of a command; with `strict` they are an error, but for the codes in
    `allow`."""

    def __init__(self, command: str, strict: bool, allow: Collection[str] = ()) -> None:
        self._command, self._strict, self._allow = command, strict, allow
        self.warnings: list[InputWarning] = []
        self.notices: list[Notice] = []

    def __enter__(self) -> RunWarnings:
        return self

    def __exit__(self, kind: type[BaseException] | None, *rest: object) -> None:
        """At the end of a run, of one that failed, too: there the reason may be among them. By then
        tables and bars have been printed below the warnings."""
        if kind is not StrictError:
            self.count()

    def inputs(
        self, mesh: Mesh, name: str, unit: str, resolution: int, frames: FrameFiles | None = None
    ) -> None:
        """Warn of a mesh from the file `name`, before anything is made of it.

        Where warnings are errors, frames are checked too, which otherwise happens when they are
        used; then raises StrictError.
        """
        found = mesh_warnings(mesh, unit, resolution)
        self.tell(replace(warning, where=f"{name}, {warning.where}") for warning in found)
        if self._strict and frames is not None:
            check = FrameCheck(mesh, unit)
            for place in counted(frames.places, "checking", "frame"):
                self.tell(check.warnings(frames.read(place), f"frame {place.name}"))
        self.refuse()

    def settings(self, warnings: Iterable[InputWarning]) -> None:
        """Report the warnings of settings among those of an asset; raises StrictError where
        warnings are errors. `inputs` and `frame` report those of the mesh and the frames."""
        self.tell(w for w in warnings if w.code in (SETTINGS_CHANGED, SETTINGS_UNUSED))
        self.refuse()

    def frame(self, warnings: Iterable[InputWarning], name: str) -> None:
        """Warn of a frame that is used now; raises StrictError where warnings are errors."""
        self.tell(replace(warning, where=f"frame {name}") for warning in warnings)
        self.refuse()

    def drawn_by(self, names: Collection[str]) -> None:
        """Warn where the maps of one bake were drawn by several.  names: as `TileService.drawn_by`
        has them."""
        if len(names) > 1:
            listed = " and ".join(sorted(names))
            detail = f"maps were drawn by {listed}, whose last bits differ"
            self.tell([InputWarning(DEVICES_MIXED, detail, "the bake")])
            self.refuse()

    def tell(self, warnings: Iterable[InputWarning]) -> None:
        """Print what is new, the first few of each code."""
        for warning in warnings:
            if warning not in self.warnings:
                self.warnings.append(warning)
                if sum(w.code == warning.code for w in self.warnings) <= _LINES:
                    allowed = "allowed " if warning.code in self._allow else ""
                    self._print(f"{allowed}warning: {warning}")

    def notice(self, notices: Iterable[Notice]) -> None:
        """Print what is worth knowing and no mistake; `strict` does not refuse it."""
        for notice in notices:
            self.notices.append(notice)
            self.note(str(notice))

    def notes(self, lines: Iterable[str]) -> None:
        """Print what a file says that is worth knowing."""
        for line in lines:
            self.note(line)

    def lengths(self, settings: AssetSettings, distance: float) -> None:
        """Report the lengths that follow where skin was grown to a number of wrinkles.  settings:
        resolved.  distance: mean, from a pore to the nearest, mesh units."""
        if settings.graph.wrinkles is not None:
            self.note(count_told(settings, distance))

    def note(self, line: str) -> None:
        """Print one line of what the run chose; nothing where quiet."""
        note(f"rhytid {self._command}: notice: {line}")

    def count(self) -> None:
        """One line: how many there are, and of what more is not listed."""
        counts = Counter(warning.code for warning in self.warnings)
        many = [f"{_LINES} of {n} {code}" for code, n in counts.items() if n > _LINES]
        listed = f"listed above ({', '.join(many)})" if many else "listed above"
        if counts:
            let = sum(warning.code in self._allow for warning in self.warnings)
            allowed = f", {let} of them allowed" if let else ""
            message = f"{_count(self.warnings)}{allowed}, {listed}"
            self._print(f"{message}; `rhytid warnings CODE` says what to do")

    def figures(self) -> list[dict[str, str]]:
        """All of them, for JSON."""
        return [asdict(warning) for warning in self.warnings]

    def all_figures(self) -> dict[str, list[dict[str, str]]]:
        """Warnings and notices of an asset, for JSON."""
        return {"warnings": self.figures(), "notices": [asdict(n) for n in self.notices]}

    def refuse(self) -> None:
        """Raise StrictError where warnings are errors and one of them is not allowed."""
        wrong = not_allowed(self.warnings, self._allow) if self._strict else ()
        if wrong:
            codes = " ".join(f"--allow {code}" for code in dict.fromkeys(w.code for w in wrong))
            message = f"--strict: {_count(wrong)}, so nothing was done ({codes} would allow that)"
            raise StrictError(message, wrong)

    def _print(self, line: str) -> None:
        # Beside a bar that is being drawn, too.
        tqdm.write(f"rhytid {self._command}: {line}", file=sys.stderr)


def _count(warnings: Sequence[InputWarning]) -> str:
    return plural(len(warnings), "warning")
