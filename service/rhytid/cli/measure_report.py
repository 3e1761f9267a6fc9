"""What was measured of a patch, as a table and as JSON, and held against what is published."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from rhytid.cli.measure_patches import Place, Strain
from rhytid.meshes.relief import Figures, FloatArray
from rhytid.pictures.relief_plot import Shown, ShownPatch
from rhytid.support.console import table

# Strains that count as the one which was measured.
_QUARTER = (1.2, 1.3)
_MAITI = "Maiti et al. 2016, at a strain of 25 %"
_BIBB = "Bibb, Medical Modelling, 6.17.3: primary and secondary lines"
_KORN = "Korn, Surber, Imanidis 2016: roughest of forehead, cheek and nose over 40"
_OVER = 40.0


@dataclass(frozen=True)
class Held:
    """A figure beside what is published of it.  low, high: the published band."""

    patch: str
    what: str
    value: float
    low: float
    high: float
    unit: str
    source: str

    @property
    def inside(self) -> bool:
        """Whether the figure lies in the band."""
        return self.low <= self.value <= self.high

    def line(self) -> str:
        """The comparison in words."""
        how = "within" if self.inside else "OUTSIDE"
        band = f"{self.low:g} to {self.high:g}" if self.high < float("inf") else f"{self.low:.3g}"
        least = "" if self.high < float("inf") else "at least "
        return (
            f"{self.patch}: {self.what} {self.value:.3g} {self.unit}, {how} {least}{band} "
            f"({self.source})"
        )

    def as_json(self) -> dict[str, Any]:
        """The comparison; `high` is null where the band has no upper end."""
        high = None if self.high == float("inf") else self.high
        return {**asdict(self), "high": high, "inside": self.inside}


@dataclass(frozen=True, eq=False)
class Measured:
    """A patch.  rest, moved: its figures at rest, and strained or in a frame.  heights: (P, P)
    micrometres of both.  strain: what was asked for; None for a frame.  change: words for it.
    cutoff: mm above which waves were taken out, None for none.
    """

    place: Place
    rest: Figures
    heights: tuple[FloatArray, FloatArray | None]
    moved: Figures | None = None
    strain: Strain | None = None
    change: str = ""
    cutoff: float | None = None

    def rows(self) -> list[tuple[str, str, str, str]]:
        """Rows of a table: a figure, at rest, moved, and by how much it changed."""
        before, after = _listed(self.rest), None if self.moved is None else _listed(self.moved)
        found = []
        for number, (name, value) in enumerate(before):
            other = None if after is None else after[number][1]
            signed = name == "Ssk" or name.endswith("degrees along")
            change = (
                ""
                if other is None or signed or value == 0.0
                else f"{100 * (other / value - 1):+.0f} %"
            )
            found.append((name, f"{value:.4g}", "" if other is None else f"{other:.4g}", change))
        return found

    def table(self) -> str:
        """The patch as a table under its name."""
        header = (self.place.name, "at rest", self.change, "change")
        columns = 2 if self.moved is None else len(header)
        return table(header[:columns], [row[:columns] for row in self.rows()])

    def held(self) -> list[Held]:
        """What is published of such a patch."""
        name, deepest = self.place.name, max(self.rest.along.rz, self.rest.across.rz)
        found = []
        if self.cutoff is None:  # else lines are not as deep as they were
            held = Held(name, "depth of lines, Rz at rest", deepest, 20.0, 200.0, "µm", _BIBB)
            found.append(held)
        strain = self.strain
        if self.moved is None or strain is None or strain.across != 1.0:
            return found
        if _QUARTER[0] <= strain.along <= _QUARTER[1]:
            for one in ("ra", "rz"):
                before, after = (getattr(f.along, one) for f in (self.rest, self.moved))
                loss = 100.0 * (1.0 - after / max(before, 1e-9))
                what = f"loss of {one.capitalize()} along the strain"
                found.append(Held(name, what, loss, 40.0, 50.0, "%", _MAITI))
        return found

    def shown(self) -> ShownPatch:
        """The patch for the plot."""
        states = [("at rest", self.heights[0], self.rest)]
        if self.moved is not None and self.heights[1] is not None:
            states.append((self.change, self.heights[1], self.moved))
        return ShownPatch(
            self.place.name,
            self.rest.side,
            tuple(
                Shown(
                    label,
                    heights,
                    np.array(figures.slopes_along.histogram),
                    np.array(figures.slopes_across.histogram),
                    np.array(figures.directions.lengths),
                )
                for label, heights, figures in states
            ),
        )

    def as_json(self) -> dict[str, Any]:
        """All figures, and where the patch lies."""
        frame = self.place.frame
        return {
            "patch": self.place.name,
            "udim": self.place.udim,
            "triangle": self.place.triangle,
            "origin": frame.origin.tolist(),
            "along": frame.axes[0].tolist(),
            "change": self.change or None,
            "rest": self.rest.as_json(),
            "moved": None if self.moved is None else self.moved.as_json(),
        }


def _listed(figures: Figures) -> list[tuple[str, float]]:
    a, d = figures.areal, figures.directions
    return [
        ("Sa µm", a.sa),
        ("Sq µm", a.sq),
        ("Ssk", a.ssk),
        ("Sku", a.sku),
        ("Sz µm", a.sz),
        ("Sdq", a.sdq),
        ("Sdr, developed area %", a.sdr),
        ("Ra along µm", figures.along.ra),
        ("Ra across µm", figures.across.ra),
        ("Rz along µm", figures.along.rz),
        ("Rz across µm", figures.across.rz),
        ("slope variance along", figures.slopes_along.variance),
        ("slope variance across", figures.slopes_across.variance),
        ("slope rms along, degrees", figures.slopes_along.rms),
        ("slope rms across, degrees", figures.slopes_across.rms),
        ("shortest correlation mm", d.sal),
        ("longest correlation mm", d.longest),
        ("Str", d.str),
        ("lines run at, degrees along", d.angle),
    ]


def held_together(patches: Sequence[Measured], age: float) -> list[Held]:
    """What is published of several regions: after 40 the nose is the roughest of three."""
    by_name = {one.place.name: one.rest.areal.sa for one in patches}
    others = [by_name[name] for name in ("forehead", "cheek") if name in by_name]
    if "nose" not in by_name or not others or age <= _OVER:
        return []
    return [Held("nose", "Sa", by_name["nose"], max(others), float("inf"), "µm", _KORN)]
