"""The context of a call, from HTTP to the thread that draws: who makes it, whether it is for a live
connection, and whether anybody still waits for its answer."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from rhytid.errors import CancelledError
from rhytid.support import cancellation

# The key, or the address, that this thread or task works for; empty where it works for none. By it
# jobs of several callers take turns.
caller: ContextVar[str] = ContextVar("caller", default="")
_live: ContextVar[bool] = ContextVar("live", default=False)
_gone: ContextVar[Callable[[], bool] | None] = ContextVar("gone", default=None)

# Seconds between two looks at whether work that is waited for is abandoned.
LOOK = 0.25


@contextmanager
def drawn_live(live: bool = True) -> Iterator[None]:
    """Calls of the device by this thread in the block are for a live connection."""
    token = _live.set(live)
    try:
        yield
    finally:
        _live.reset(token)


def is_live() -> bool:
    """Whether calls of the device by this thread are for a live connection."""
    return _live.get()


@contextmanager
def abandoned_when(gone: Callable[[], bool]) -> Iterator[None]:
    """The work of this thread in the block is abandoned once `gone` is true: drawing then stops
    between two pieces."""
    token = _gone.set(gone)
    try:
        yield
    finally:
        _gone.reset(token)


@contextmanager
def never_abandoned() -> Iterator[None]:
    """The work of this thread in the block is done to its end, even if its caller is gone."""
    with abandoned_when(lambda: False):
        yield


@contextmanager
def also_awaited(waits: Callable[[], bool]) -> Iterator[None]:
    """The work of this thread in the block goes on while others wait for it, even if its caller is
    gone."""
    own = _gone.get()
    with abandoned_when(lambda: own is not None and not waits() and own()):
        yield


def is_abandoned() -> bool:
    """Whether nobody waits for the work of this thread any more."""
    gone = _gone.get()
    return gone is not None and gone()


def check_abandoned() -> None:
    """Raise CancelledError where the work of this thread is abandoned; in a job, the error that the
    job stops with."""
    if is_abandoned():
        cancellation.check()
        raise CancelledError("the client closed the connection before the answer was drawn")
