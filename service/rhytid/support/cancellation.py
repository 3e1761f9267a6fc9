"""Cancellation of the work of a thread: long loops call `check` about every tenth of a second.

The check is a context variable, so it holds on the thread, or in the task, that set it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeVar

T = TypeVar("T")

_check: ContextVar[Callable[[], None] | None] = ContextVar("check", default=None)


@contextmanager
def scope(check: Callable[[], None]) -> Iterator[None]:
    """In the block, `cancellation.check()` on this thread calls `check`, which raises an error
    where the work is to stop."""
    token = _check.set(check)
    try:
        yield
    finally:
        _check.reset(token)


def current_check() -> Callable[[], None]:
    """The function that `check` calls on this thread, for work that goes on in another."""
    return _check.get() or _nothing


def check_each(pieces: Iterable[T]) -> Iterator[T]:
    """The same pieces, with a `check` before each."""
    for piece in pieces:
        check()
        yield piece


def check() -> None:
    """Raise an error such as CancelledError where the work is to stop.

    Steps that make something call it; steps that give back what was made do not.
    """
    current_check()()


def _nothing() -> None:
    """The check of work that nobody cancels."""
