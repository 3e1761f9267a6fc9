"""Whether the work of this thread is to stop: asked about every tenth of a second by what takes
long, wherever it runs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeVar

T = TypeVar("T")

_check: ContextVar[Callable[[], None] | None] = ContextVar("check", default=None)


@contextmanager
def where(check: Callable[[], None]) -> Iterator[None]:
    """Work on this thread in the block stops where `check` raises."""
    token = _check.set(check)
    try:
        yield
    finally:
        _check.reset(token)


def asked() -> Callable[[], None]:
    """What `check` calls on this thread, to be called on another."""
    return _check.get() or _nothing


def each(pieces: Iterable[T]) -> Iterator[T]:
    """The same pieces, unless the work is to stop."""
    for piece in pieces:
        check()
        yield piece


def check() -> None:
    """Raise what the work is to stop with, such as CancelledError; nothing where it may go on.

    For steps that make something: what gives back what was made does not ask.
    """
    asked()()


def _nothing() -> None:
    """Nobody stops it."""
