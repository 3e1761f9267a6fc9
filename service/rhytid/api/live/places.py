"""How many live connections there may be at once, in all and of one caller."""

from __future__ import annotations

from rhytid.api.caller_places import CallerPlaces

MOST, MOST_EACH = 64, 16


class LivePlaces(CallerPlaces):
    """Counts connections."""

    def __init__(self, most: int = MOST, most_each: int = MOST_EACH) -> None:
        super().__init__(
            most,
            most_each,
            "{count} live connections are open already",
            "{caller} has {count} live connections open already",
        )
