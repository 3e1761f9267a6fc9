"""A task of `openjd run` that is killed while it bakes."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path

_FRAME = re.compile(r"openjd_status: baking: frame (\d+) of \d+")
# A frame that is there already is passed in far less.
_DRAWN = 0.05


class Task:
    """`openjd run` with one task."""

    def __init__(self, command: Sequence[str]) -> None:
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
        self._start = time.monotonic()
        self._running = subprocess.Popen(command, text=True, **pipes)  # type: ignore[call-overload]

    def killed_after(self, frames: int) -> float:
        """Send SIGKILL to the process that bakes, when it has drawn so many frames. Returns the
        seconds from the start to the first of them; raises RuntimeError where all are there."""
        drawn, first, before = 0, 0.0, time.monotonic()
        with self._running as running:
            for line in running.stdout:
                if not _FRAME.search(line) and "openjd_progress: 100" not in line:
                    continue
                now = time.monotonic()
                if now - before > _DRAWN and "frame 1 of" not in line:
                    drawn, first = drawn + 1, first or now - self._start
                before = now
                if drawn >= frames:
                    os.kill(_baking(running.pid), signal.SIGKILL)
                    drawn = -1_000_000  # once
        if running.returncode == 0:
            raise RuntimeError("the task ended before it was killed")
        return first

    def finished(self) -> None:
        """Wait for its end; raises RuntimeError with its output where it fails."""
        said, _ = self._running.communicate()
        if self._running.returncode:
            raise RuntimeError(said)


def _baking(ancestor: int) -> int:
    """The process `rhytid bake` below another."""
    parents = dict(filter(None, map(_parent, Path("/proc").glob("[0-9]*"))))
    for process in parents:
        above = process
        while above in parents and above != ancestor:
            above = parents[above]
        if above == ancestor:
            words = Path(f"/proc/{process}/cmdline").read_bytes().split(b"\0")
            if b"rhytid" in words and b"bake" in words:
                return process
    raise RuntimeError("no process of the task bakes")


def _parent(process: Path) -> tuple[int, int] | None:
    """The number of a process and of the one that started it; None where it has just ended."""
    try:
        status = (process / "stat").read_text()
    except OSError:
        return None
    return int(process.name), int(status.rpartition(")")[2].split()[1])
