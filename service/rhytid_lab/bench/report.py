"""The report of `rhytid reproduce`: the paper's figures, its times and its claims, from our maps.

Sizes follow from the resolution R of the figures: times are taken at R with the paper's density of
wrinkles, errors at R/4 with the usual density, the sphere is drawn at R/4 with larger wrinkles.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from PIL import Image

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import BinSettings
from rhytid.synthesis.progress import Progress, part
from rhytid_lab.bench.accuracy import (
    CHOICES,
    PAPER,
    SOURCES,
    Accuracy,
    Source,
    Study,
    best,
    error_sources,
    front,
    pareto,
)
from rhytid_lab.bench.blend_clock import BlendClock
from rhytid_lab.bench.face_figures import figure_1, figure_3, figure_4, maps_of, scene
from rhytid_lab.bench.frame import REPORTED, Cost, FrameBench
from rhytid_lab.bench.skin import Skin
from rhytid_lab.bench.sphere_figure import PORES, figure_5
from rhytid_lab.bench.subject import (
    USUAL_SIZE,
    USUAL_WRINKLES,
    Grown,
    Subject,
    built_in_sphere,
    describe,
    grow,
)

_SMALLEST = 256
_SPHERE_WRINKLES = 4500
# Seconds on an NVIDIA GeForce RTX 3090 at 16384² texels and about 20 million wrinkles (section 3).
PAPER_SIZE, PAPER_WRINKLES = 16384, 20_000_000
PAPER_SECONDS = {
    "stretch": 1.5,
    "convolved": 2.0,
    "redraw": 2.4,
    "binned": 0.05,
    "precompute": 60.0,
}


@dataclass
class Report:
    """Makes the report: pictures in a folder, and figures as plain values.

    choices: bins that the study measures.  sources: causes of error that it takes apart.
    """

    device: Device
    face: Subject
    out: Path
    resolution: int
    unit_mm: float
    choices: tuple[BinSettings, ...] = CHOICES
    sources: tuple[Source, ...] = SOURCES
    figures: dict[str, Any] = field(default_factory=dict)

    def run(self, progress: Progress) -> None:
        """Make everything; progress(share, stage) is called often and may raise CancelledError."""
        self.figures["resolution"] = self.resolution
        self.figures["device"] = self.device.info.name
        self.figures["subject"] = self.face.title
        self.face_figures(part(progress, 0.0, 0.2))
        sphere = built_in_sphere(self.device)
        self.sphere_figure(sphere, part(progress, 0.2, 0.3))
        self.times(part(progress, 0.3, 0.5))
        self.accuracy(sphere, part(progress, 0.5, 1.0))

    @property
    def study_resolution(self) -> int:
        """Texels per side at which errors are measured."""
        return max(self.resolution // 4, _SMALLEST)

    def face_figures(self, progress: Progress) -> None:
        """Figures 1, 3 and 4."""
        grown = self._grown(self.face, self.resolution, part(progress, 0.0, 0.4))
        skin = self.face.skin(self.device, grown, self.resolution)
        self.figures["frames"] = describe(self.face, skin)
        self.figures["r_max"] = self.face.r_max
        shown = scene(self.face, skin, grown.spacing, self.unit_mm)
        progress(0.5, "figure 3")
        self._save(figure_3(shown.performance), "figure_3")
        progress(0.6, "figure 4")
        self._save(figure_4(shown), "figure_4")
        progress(0.7, "figure 1")
        picture, errors = figure_1(shown, maps_of(self.face, skin, shown.frame))
        self._save(picture, "figure_1")
        self.figures["figure_1"] = {"frame": shown.frame, "relative_rms": errors}
        skin.release()

    def sphere_figure(self, sphere: Subject, progress: Progress) -> None:
        """Figure 5."""
        progress(0.0, "figure 5")
        size = self.study_resolution
        grown = grow(self.device, sphere.mesh, min(_SPHERE_WRINKLES, _default_wrinkles(size)))
        skin = sphere.skin(self.device, grown, size, response=PORES)
        picture, errors = figure_5(sphere, skin, part(progress, 0.1, 1.0))
        self._save(picture, "figure_5")
        self.figures["figure_5"] = {"relative_rms": errors}
        skin.release()

    def times(self, progress: Progress) -> None:
        """The table of times."""
        count = wrinkles_at(self.resolution)
        grown = grow(self.device, self.face.mesh, count, part(progress, 0.0, 0.7))
        settings = self.face.settings(grown, self.resolution)
        deformed = self.face.frames[self.face.strongest].positions
        assert deformed is not None
        bench = FrameBench(self.device, self.face.mesh, grown.graph, deformed, settings)
        costs = []
        for index, case in enumerate(REPORTED):
            progress(0.7 + 0.3 * index / len(REPORTED), f"time of {case}")
            costs.append(bench.cost(case, 3))
        rows = time_rows(costs, self.resolution)
        self.figures["times"] = {"wrinkles": count, "rows": [asdict(row) for row in rows]}
        bench.release()

    def accuracy(self, sphere: Subject, progress: Progress) -> None:
        """The study of `binned` against `redraw`."""
        size = self.study_resolution
        subjects: list[tuple[Subject, Skin]] = []
        grown: list[Grown] = []
        for subject in (self.face, sphere):
            grown.append(self._grown(subject, size, part(progress, 0.0, 0.02)))
            subjects.append((subject, subject.skin(self.device, grown[-1], size)))
        clock = BlendClock(self.device, self.face, grown[0], self.resolution)
        study = Study(subjects, clock)
        found = []
        for index, bins in enumerate(self.choices):
            progress(0.05 + 0.75 * index / len(self.choices), f"accuracy {index + 1}")
            found.append(study.measure(bins))
        clock.release()
        pareto(found).savefig(self.out / "pareto.png")
        self.figures["accuracy"] = _accuracy(found, size)
        for index, (subject, skin) in enumerate(subjects):
            progress(0.8 + 0.1 * index, "sources of error")
            self.figures["accuracy"]["sources"][subject.title] = error_sources(
                subject, skin, self.sources
            )
            skin.release()

    def _grown(self, subject: Subject, resolution: int, progress: Progress) -> Grown:
        return grow(self.device, subject.mesh, _default_wrinkles(resolution), progress)

    def _save(self, picture: Image.Image, name: str) -> None:
        picture.save(self.out / f"{name}.png", optimize=True)


def _default_wrinkles(resolution: int) -> int:
    """The number of wrinkles of the usual density per texel."""
    return max(round(USUAL_WRINKLES * (resolution / USUAL_SIZE) ** 2), 100)


def _accuracy(found: list[Accuracy], resolution: int) -> dict[str, Any]:
    on_front = front(found)
    paper = next(one for one in found if one.bins == PAPER)
    rows = [
        {
            **asdict(one),
            "error": one.error,
            "relative_time": one.map_copies / paper.map_copies,
            "on_front": one in on_front,
        }
        for one in found
    ]
    return {
        "resolution": resolution,
        "rows": rows,
        "best": asdict(best(found).bins),
        "sources": {},
    }


@dataclass(frozen=True)
class TimeRow:
    """A case with its seconds and map copies, its seconds scaled to the paper's size, and those of
    the paper."""

    case: str
    seconds: float
    map_copies: float
    scaled: float
    paper: float | None


def wrinkles_at(resolution: int) -> int:
    """Return the number of wrinkles of the paper's density per texel."""
    return max(round(PAPER_WRINKLES * resolution**2 / PAPER_SIZE**2), 100)


def time_rows(costs: list[Cost], resolution: int) -> list[TimeRow]:
    """Return costs at `resolution` with `wrinkles_at(resolution)` wrinkles, and the paper's beside
    them.

    Texels and wrinkles grow by the same factor, so times of maps are scaled by it. Stretch is per
    triangle here and is not scaled; the paper's is per texel.
    """
    factor = (PAPER_SIZE / resolution) ** 2
    return [
        TimeRow(
            cost.case,
            cost.seconds,
            cost.map_copies,
            cost.seconds * (1.0 if cost.case == "stretch" else factor),
            PAPER_SECONDS.get(cost.case),
        )
        for cost in costs
    ]
