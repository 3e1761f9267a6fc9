"""Phrases that messages share."""

from __future__ import annotations


def plural(count: int, one: str, several: str = "") -> str:
    """A count and its noun: `1 map`, `2 maps`.  several: where it is not `one` with an s."""
    return f"{count} {one if count == 1 else several or one + 's'}"


def rough_count(number: float) -> str:
    """A number to two digits: `510,000`, `1.2 million`."""
    if number < 1e6:
        return f"{float(f'{number:.2g}'):,.0f}"
    return f"{number / 1e6:.2g} million" if number < 1e8 else f"{number / 1e6:.0f} million"


def install_hint(extra: str) -> str:
    """How to install an extra: `in a clone of rhytid: pip install '.[x]'`, for no index has it."""
    return f"in a clone of rhytid: pip install '.[{extra}]'"


def waiting_requests(count: int) -> str:
    """How many requests wait for the device: `1 request waits for the device`."""
    return f"{plural(count, 'request waits', 'requests wait')} for the device"
