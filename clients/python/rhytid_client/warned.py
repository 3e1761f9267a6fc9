"""Warnings of an answer, as warnings of Python."""

from __future__ import annotations

import warnings
from collections.abc import Iterable

from rhytid_client.errors import RhytidWarning
from rhytid_client.results import InputWarning

# From here up to who called the method of a client: a call, `patient`, `_run`, the method.
_CALLER = 6


def tell(found: Iterable[InputWarning]) -> None:
    """Warn of each, at the line that called the client; to be called by a call alone."""
    for warning in found:
        warnings.warn(str(warning), RhytidWarning, stacklevel=_CALLER)
