"""Warnings of an answer, as warnings of Python."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar

from rhytid_client.errors import RhytidWarning
from rhytid_client.results import InputWarning

# From here up to who called the method of a client: a call, `patient`, `_run`, the method.
_CALLER = 6
# The same of what the answer itself says, which `patient` tells.
_ASKER = 5
NOTICE = "x-rhytid-notice"
# Of this thread or task: the filters of Python's warnings are those of the whole process.
_silent = ContextVar("silent", default=False)


@contextmanager
def silent() -> Iterator[None]:
    """Within the block calls of clients warn of nothing; their answers have the warnings."""
    token = _silent.set(True)
    try:
        yield
    finally:
        _silent.reset(token)


def tell(found: Iterable[InputWarning]) -> None:
    """Warn of each, at the line that called the client; to be called by a call alone."""
    if _silent.get():
        return
    for warning in found:
        warnings.warn(str(warning), RhytidWarning, stacklevel=_CALLER)


def tell_notice(headers: Mapping[str, str]) -> None:
    """Warn of the notice in the headers of an answer, if there is one; to be called by `patient`
    alone."""
    notice = headers.get(NOTICE)
    if notice is not None and not _silent.get():
        warnings.warn(notice, RhytidWarning, stacklevel=_ASKER)
