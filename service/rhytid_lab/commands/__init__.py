"""Commands of `rhytid` that show and measure, found through the entry points `rhytid.commands`."""

from __future__ import annotations

from importlib.util import find_spec

from rhytid.domain.wording import install_hint
from rhytid.errors import RhytidError


def check_client() -> None:
    """Raise RhytidError saying how to get it where the SDK is not installed."""
    if find_spec("rhytid_client") is None:
        hint = f"{install_hint('lab')} ./clients/python"
        raise RhytidError(f"this command goes through the SDK, rhytid-client; {hint}")
