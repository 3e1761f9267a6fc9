"""How close `binned` is to `redraw`, at what time and memory, over the settings of the bins; and
where its error comes from: each source measured alone, all others made small."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from rhytid.domain.asset_settings import BinSettings
from rhytid.pipeline.bins import map_count
from rhytid.pipeline.vectors import BYTES_A_TEXEL
from rhytid_lab.bench.blend_clock import BlendClock
from rhytid_lab.bench.skin import Map, Skin
from rhytid_lab.bench.subject import Subject
from rhytid_lab.contact_sheets import relative_rms
from rhytid_lab.plots import Point, scatter

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# The worst texels of a map, as a share of all.
WORST = 0.001
PAPER = BinSettings()
_FINEST: dict[str, Any] = {
    "count": 16, "samples": 7, "bits": 16, "merge": "mellow", "depth_factored": True,
}  # fmt: skip
CLAMP = "clamp: stretch kept within r_max"
REST = "rest: the finest bins against redraw within r_max"


def choice(**changes: Any) -> BinSettings:
    """Return the paper's bins with some settings changed."""
    return BinSettings(**{**asdict(PAPER), **changes})


_FINE = {"merge": "mellow", "depth_factored": True}
_TILTED = {"depth_factored": True, "tilt": True}
# The paper's choice, its neighbours in every setting, and combinations that are worth their cost.
CHOICES: tuple[BinSettings, ...] = (
    PAPER,
    *(choice(count=n) for n in (1, 2, 8, 16)),
    *(choice(samples=m) for m in (5, 7)),
    choice(bits=16),
    *(choice(merge=merge) for merge in ("soft", "signed", "mellow")),
    choice(reach=1.5),
    choice(depth_factored=True),
    *(choice(depth_factored=True, samples=m) for m in (5, 7)),
    *(choice(depth_factored=True, count=8, samples=m) for m in (3, 5, 7)),
    *(
        choice(depth_factored=True, merge=merge, count=n, samples=m)
        for merge in ("soft", "signed")
        for n in (4, 8)
        for m in (3, 5, 7)
    ),
    *(choice(**_TILTED, merge=merge, samples=7) for merge in ("min", "signed", "mellow")),
    *(choice(**_TILTED, merge="soft", count=n, samples=7) for n in (2, 8)),
    *(choice(**_TILTED, merge="soft", samples=m) for m in (3, 5)),
    choice(**_TILTED, merge="soft", samples=5, reach=1.75),
    *(choice(**_TILTED, merge="soft", pore_samples=m) for m in (5, 7)),
    choice(**_TILTED, merge="soft", pore_samples=5, reach=1.25),
    *(choice(**_TILTED, merge="soft", pore_samples=7, reach=reach) for reach in (1.25, 1.5, 2.0)),
    *(choice(**_TILTED, merge="soft", samples=7, reach=reach) for reach in (1.5, 2.0)),
    choice(**_TILTED, merge="soft", samples=7, reach=1.5, bits=16),
    choice(**_TILTED, merge="signed", pore_samples=7),
    choice(**_TILTED, merge="signed", samples=7, reach=1.5),
    choice(**_TILTED, merge="signed", count=8, samples=7, reach=1.5),
    *(choice(**_FINE, count=n) for n in (1, 2, 4, 8, 16)),
    *(choice(**_FINE, count=n, samples=5) for n in (2, 4, 8)),
    choice(**_FINE, bits=16),
    choice(**_FINE, count=8, samples=5, bits=16),
    choice(**_FINE, count=16, samples=7, bits=16),
)


@dataclass(frozen=True)
class Accuracy:
    """Error, time and memory of one choice of bins.

    errors: relative rms by subject, mean over its frames.  worst: mean |difference| of the worst
    0.1 % of texels by subject, in units of the depth.  seconds, map_copies: time of blending a map
    of the timed size.  memory: bytes per texel.
    """

    bins: BinSettings
    errors: dict[str, float]
    worst: dict[str, float]
    seconds: float
    map_copies: float
    memory: float

    @property
    def error(self) -> float:
        """The mean over subjects."""
        return statistics.fmean(self.errors.values())


class Study:
    """Measures choices of bins against the `redraw` maps of some subjects.

    subjects: each with its skin at the size at which errors are measured.  clock: at the size at
    which blending is timed.
    """

    def __init__(self, subjects: Sequence[tuple[Subject, Skin]], clock: BlendClock) -> None:
        self._subjects, self._clock = subjects, clock
        self._redrawn = {
            subject.title: [skin.map(frame, "redraw") for frame in subject.frames.values()]
            for subject, skin in subjects
        }

    def measure(self, bins: BinSettings) -> Accuracy:
        """Return errors, time and memory of one choice."""
        errors, worst = {}, {}
        for subject, skin in self._subjects:
            skin.use(bins=settings_of(bins, subject))
            found = [skin.map(frame, "binned") for frame in subject.frames.values()]
            pairs = list(zip(found, self._redrawn[subject.title], strict=True))
            errors[subject.title] = statistics.fmean(relative_rms(a, b) for a, b in pairs)
            depth = skin.settings.depth or 1.0
            worst[subject.title] = statistics.fmean(worst_mean(a, b) for a, b in pairs) / depth
        seconds = self._clock.seconds(bins)
        copies = seconds / self._clock.copy_seconds
        return Accuracy(bins, errors, worst, seconds, copies, memory(bins))


def settings_of(bins: BinSettings, subject: Subject) -> dict[str, Any]:
    """Return the bins as JSON settings, calibrated for a subject."""
    return {**asdict(bins), "r_max": subject.r_max}


def worst_mean(values: Map, reference: Map) -> float:
    """Mean |difference| of the worst 0.1 % of texels, mesh units."""
    size = np.abs(values - reference).ravel()
    count = max(round(WORST * size.size), 1)
    return float(np.partition(size, -count)[-count:].mean())


def memory(bins: BinSettings) -> float:
    """Bytes per texel of the precomputed maps and of the triangle index beside them."""
    return map_count(bins) * bins.bits / 8 + BYTES_A_TEXEL


def front(found: Iterable[Accuracy]) -> list[Accuracy]:
    """Return the choices that no other beats in both error and time, the fastest first."""
    kept: list[Accuracy] = []
    for one in sorted(found, key=lambda a: (a.map_copies, a.error)):
        if not kept or one.error < kept[-1].error:
            kept.append(one)
    return kept


def best(found: Sequence[Accuracy], most: float = 2.0) -> Accuracy:
    """Return the choice closest to `redraw` at no more than `most` times the time of the paper's
    choice."""
    paper = next(a for a in found if a.bins == PAPER)
    affordable = [a for a in found if a.map_copies <= most * paper.map_copies]
    return min(affordable, key=lambda a: a.error)


@dataclass(frozen=True)
class Source:
    """A cause of error: its name, and two choices of bins that differ in it alone."""

    name: str
    fine: BinSettings
    coarse: BinSettings


SOURCES = (
    Source("angle bins: N = 4 for 16", choice(**_FINEST), choice(**{**_FINEST, "count": 4})),
    Source(
        "angle bins: N = 4 with tilts for 16",
        choice(**_FINEST),
        choice(**{**_FINEST, "count": 4, "tilt": True}),
    ),
    Source(
        "interpolation: M = 3 for 7, depth drawn",
        choice(**{**_FINEST, "depth_factored": False}),
        choice(**{**_FINEST, "depth_factored": False, "samples": 3}),
    ),
    Source(
        "interpolation: M = 3 for 7, depth factored",
        choice(**_FINEST),
        choice(**{**_FINEST, "samples": 3}),
    ),
    Source("quantisation: 8 bits for 16", choice(**_FINEST), choice(**{**_FINEST, "bits": 8})),
    Source(
        "merge: min for mellow, N = 4",
        choice(**{**_FINEST, "count": 4}),
        choice(**{**_FINEST, "count": 4, "merge": "min"}),
    ),
    Source(
        "merge: soft for mellow, N = 4",
        choice(**{**_FINEST, "count": 4}),
        choice(**{**_FINEST, "count": 4, "merge": "soft"}),
    ),
    Source(
        "merge: signed for mellow, N = 4",
        choice(**{**_FINEST, "count": 4}),
        choice(**{**_FINEST, "count": 4, "merge": "signed"}),
    ),
)


def error_sources(
    subject: Subject, skin: Skin, sources: Sequence[Source] = SOURCES
) -> dict[str, float]:
    """Return the rms that each source adds, over the rms of `redraw`, mean over the frames of a
    subject."""
    drawn = _Drawn(subject, skin)
    found = {s.name: drawn.apart(drawn.binned(s.fine), drawn.binned(s.coarse)) for s in sources}
    clamped = drawn.clamped()
    found[CLAMP] = drawn.apart(drawn.redrawn, clamped)
    found[REST] = drawn.apart(clamped, drawn.binned(choice(**{**_FINEST, "depth_factored": False})))
    return found


class _Drawn:
    """The maps of a subject's frames by each choice of bins, each drawn once."""

    def __init__(self, subject: Subject, skin: Skin) -> None:
        self._subject, self._skin = subject, skin
        self._kept: dict[BinSettings, list[Map]] = {}
        skin.use()
        self.redrawn = self._maps("redraw")

    def binned(self, bins: BinSettings) -> list[Map]:
        """Maps that are blended from these bins."""
        if bins not in self._kept:
            self._skin.use(bins=settings_of(bins, self._subject))
            self._kept[bins] = self._maps("binned")
        return self._kept[bins]

    def clamped(self) -> list[Map]:
        """Maps by `redraw`, with stretch clamped to the range that the bins can show."""
        r_max = self._subject.r_max
        self._skin.use(response={"log_stretch_limit": r_max}, bins={"r_max": r_max})
        return self._maps("redraw")

    def apart(self, some: list[Map], others: list[Map]) -> float:
        """Rms of the difference of two series of maps over the rms of `redraw`, mean over the
        frames."""
        triples = zip(some, others, self.redrawn, strict=True)
        return statistics.fmean(relative_rms(a - b + c, c) for a, b, c in triples)

    def _maps(self, method: str) -> list[Map]:
        return [self._skin.map(frame, method) for frame in self._subject.frames.values()]


def pareto(found: Sequence[Accuracy]) -> Figure:
    """Plot the mean relative rms over blending time; colours stand for merges."""
    best = front(found)
    points = [
        Point(
            one.map_copies, 100 * one.error, f"merge {one.bins.merge}", short(one.bins), one in best
        )
        for one in found
    ]
    return scatter(
        points, "blending time, map copies", "rms of binned - redraw over rms of redraw, %"
    )


def short(bins: BinSettings) -> str:
    """Return a choice of bins in a few letters; the colour shows its merge."""
    depth = ", factored" if bins.depth_factored else ""
    tilt = ", tilt" if bins.tilt else ""
    reach = f", reach {bins.reach:g}" if bins.reach > 1.0 else ""
    pores = f" pores {bins.pore_samples}" if bins.pore_samples else ""
    return f"N {bins.count}, M {bins.samples}{pores}, {bins.bits} bit{depth}{tilt}{reach}"
