"""Which of several media types a client wants: the header `Accept` (RFC 9110, section 12.5.1)."""

from __future__ import annotations

import re
from dataclasses import dataclass

from fastapi import Request
from starlette.exceptions import HTTPException

_WEIGHT = re.compile(r"0(\.[0-9]{0,3})?|1(\.0{0,3})?", re.ASCII)


@dataclass(frozen=True)
class _Range:
    """One entry of the header: what it names, such as `text/*`, its weight and its place."""

    name: str
    weight: float
    place: int

    def fits(self, offer: str) -> bool:
        """Whether it means this type."""
        return self.name in (offer, "*/*", offer.partition("/")[0] + "/*")

    @property
    def precision(self) -> tuple[bool, bool]:
        """A name overrides `type/*`, and that overrides `*/*`."""
        return self.name != "*/*", not self.name.endswith("/*")


def preferred(request: Request, offers: tuple[str, ...]) -> str:
    """The offer of the highest weight; of equal ones what the client names first, then what is
    offered first. Raises a 406 where none has a weight above 0.

    An entry whose weight cannot be read counts as not sent; other parameters are not compared.
    """
    accept = ", ".join(request.headers.getlist("accept"))
    ranges = _ranges(accept or "*/*")
    rated = [(_rated(offer, ranges), offer) for offer in offers]
    (weight, _), best = max(rated, key=lambda pair: pair[0])
    if weight == 0.0:
        raise HTTPException(406, f"Accept is {accept!r}: one of {', '.join(offers)}")
    return best


def _ranges(accept: str) -> list[_Range]:
    found = []
    for place, entry in enumerate(accept.split(",")):
        name, *parameters = (piece.strip().lower() for piece in entry.split(";"))
        weights = [p[2:] for p in parameters if p.startswith("q=")] or ["1"]
        if _WEIGHT.fullmatch(weights[0]):
            found.append(_Range(name, float(weights[0]), place))
    return found


def _rated(offer: str, ranges: list[_Range]) -> tuple[float, int]:
    """Weight of an offer by the most precise entry that fits, and how early that stands."""
    fitting = [entry for entry in ranges if entry.fits(offer)]
    if not fitting:
        return 0.0, 0
    entry = max(fitting, key=lambda entry: entry.precision)
    return entry.weight, -entry.place
