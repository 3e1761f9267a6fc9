"""What the session knows of objects and is not saved with the file."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import bpy


@dataclass
class Status:
    """What the panel shows of an object.

    of_mesh, of_frame: warnings.  digest: of what the present map was drawn from.  path,
    shine_path: that the images showed then.  silent_until: no live update before that time.
    """

    text: str = ""
    failed: bool = False
    of_mesh: tuple[str, ...] = ()
    of_frame: tuple[str, ...] = ()
    digest: str = ""
    path: str = ""
    shine_path: str = ""
    silent_until: float = 0.0


@dataclass
class Work:
    """The work that is being done, of which there is one at a time."""

    text: str = ""
    share: float = 0.0
    running: bool = False
    cancelled: bool = False


@dataclass
class _Session:
    statuses: dict[int, Status] = field(default_factory=dict)
    work: Work = field(default_factory=Work)
    quiet: int = 0


_session = _Session()


def status(obj: bpy.types.Object) -> Status:
    """That of an object, which keeps it when it is renamed."""
    return _session.statuses.setdefault(obj.session_uid, Status())


def moved(before: str, after: str) -> None:
    """The map that images showed by one path is shown by another."""
    for known in _session.statuses.values():
        if known.path == before:
            known.path = after
        if known.shine_path == before:
            known.shine_path = after


def work() -> Work:
    """The present work."""
    return _session.work


def forget() -> None:
    """Begin anew."""
    _session.statuses.clear()
    _session.work = Work()


@contextmanager
def quiet() -> Iterator[None]:
    """While frames are set for a purpose of ours, the handler of frame changes does nothing."""
    _session.quiet += 1
    try:
        yield
    finally:
        _session.quiet -= 1


def is_quiet() -> bool:
    """Whether frames are set for a purpose of ours."""
    return _session.quiet > 0
