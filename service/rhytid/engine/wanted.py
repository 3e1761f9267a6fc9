"""Whether somebody still waits for what a thread draws."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from rhytid.errors import CancelledError
from rhytid.support import cancellation

_gone: ContextVar[Callable[[], bool] | None] = ContextVar("gone", default=None)


@contextmanager
def unless(gone: Callable[[], bool]) -> Iterator[None]:
    """What is drawn on this thread in the block stops between two pieces where `gone`."""
    token = _gone.set(gone)
    try:
        yield
    finally:
        _gone.reset(token)


@contextmanager
def anyway() -> Iterator[None]:
    """What this thread asks for in the block is done to its end, whoever is gone."""
    with unless(lambda: False):
        yield


@contextmanager
def also(waits: Callable[[], bool]) -> Iterator[None]:
    """What is drawn on this thread in the block goes on as long as others wait for it, too."""
    own = _gone.get()
    with unless(lambda: own is not None and not waits() and own()):
        yield


def is_gone() -> bool:
    """Whether nobody waits for what this thread draws any more."""
    gone = _gone.get()
    return gone is not None and gone()


def check() -> None:
    """Raise CancelledError where nobody waits any more; in a job, what that stops with."""
    if is_gone():
        cancellation.check()
        raise CancelledError("the client closed the connection before the answer was drawn")
