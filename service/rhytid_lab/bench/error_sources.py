"""Where the error of `binned` comes from: each source measured alone, all others made small."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rhytid.domain.asset_settings import BinSettings
from rhytid_lab.bench.accuracy import choice, settings_of
from rhytid_lab.bench.skin import Map, Skin
from rhytid_lab.bench.subject import Subject
from rhytid_lab.sheets.contact import relative_rms

_FINEST: dict[str, Any] = {
    "count": 16, "samples": 7, "bits": 16, "merge": "mellow", "depth_factored": True,
}  # fmt: skip
CLAMP = "clamp: stretch kept within r_max"
REST = "rest: the finest bins against redraw within r_max"


@dataclass(frozen=True)
class Source:
    """One cause of error: what it is, and two choices of bins that differ in it alone."""

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
    """Rms that each source adds over the rms of `redraw`, mean over the frames of a subject."""
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
        """Blended from these bins."""
        if bins not in self._kept:
            self._skin.use(bins=settings_of(bins, self._subject))
            self._kept[bins] = self._maps("binned")
        return self._kept[bins]

    def clamped(self) -> list[Map]:
        """`redraw` of the stretch that the bins can show."""
        r_max = self._subject.r_max
        self._skin.use(response={"log_stretch_limit": r_max}, bins={"r_max": r_max})
        return self._maps("redraw")

    def apart(self, some: list[Map], others: list[Map]) -> float:
        """Rms of the difference over the rms of `redraw`, mean over the frames."""
        triples = zip(some, others, self.redrawn, strict=True)
        return statistics.fmean(relative_rms(a - b + c, c) for a, b, c in triples)

    def _maps(self, method: str) -> list[Map]:
        return [self._skin.map(frame, method) for frame in self._subject.frames.values()]
