"""A disk that fails at a chosen step: the harness of the crash tests."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

STEPS: tuple[tuple[Any, str], ...] = (
    (Path, "mkdir"),
    (Path, "open"),
    (Path, "replace"),
    (os, "fsync"),
    (os, "unlink"),
    (os, "rmdir"),
    (shutil, "rmtree"),
)


class PowerCutError(BaseException):
    """The process is gone: nothing after this reaches the disk."""


class Disk:
    """Counts the changes made to the disk and fails the one numbered `fatal`.

    After a power cut every later change fails too, so that cleaning up cannot help; a full disk
    fails that one step with ENOSPC and goes on.
    """

    def __init__(self, patch: pytest.MonkeyPatch, fatal: int, *, full: bool = False) -> None:
        self.steps = 0
        self.log: list[tuple[str, str]] = []
        self._fatal = fatal
        self._full = full
        for owner, name in STEPS:
            patch.setattr(owner, name, self._wrapped(name, getattr(owner, name)))

    def _wrapped(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def step(*args: Any, **kwargs: Any) -> Any:
            self.steps += 1
            self.log.append((name, str(args[-1])))
            if self._full and self.steps == self._fatal:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            if not self._full and self.steps >= self._fatal:
                raise PowerCutError
            return call(*args, **kwargs)

        return step
