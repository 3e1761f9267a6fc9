"""A bake on a local cluster whose workers are killed while they bake."""

from __future__ import annotations

import os
import random
import re
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

_FRAME = re.compile(r"frame \S+ is there, by (\S+)")
# Frames between the return of a worker and the next kill, at most.
_BETWEEN = 4


def killed_bake(command: Sequence[str], kills: int, chance: random.Random) -> list[float | None]:
    """Run `rhytid` with these arguments, which say `--dask local --verbose`, and send SIGKILL to a
    worker, each time the one before is replaced.

    kills: at most. Returns, for each, the seconds until the worker in its place had a frame; None
    where the bake was over before. Raises CalledProcessError where the bake fails.
    """
    pipes = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE}
    arguments = [sys.executable, "-m", "rhytid", *command]
    seconds: list[float | None] = []
    seen: set[str] = set()
    killed, wait = 0.0, _BETWEEN
    with subprocess.Popen(arguments, text=True, **pipes) as running:  # type: ignore[call-overload]
        for line in running.stderr:
            found = _FRAME.search(line)
            if found is None:
                continue
            if killed and found[1] not in seen:
                seconds[-1], killed = time.monotonic() - killed, 0.0
                wait = chance.randint(1, _BETWEEN)
            seen.add(found[1])
            wait -= 1
            if not killed and wait <= 0 and len(seconds) < kills:
                os.kill(chance.choice(workers(running.pid)), signal.SIGKILL)
                killed = time.monotonic()
                seconds.append(None)
    if running.returncode:
        raise subprocess.CalledProcessError(running.returncode, arguments)
    return seconds


def workers(parent: int) -> list[int]:
    """The processes that Dask's nannies in a process have started."""
    found = []
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            of = int(status.read_text().rpartition(")")[2].split()[1])
            words = (status.parent / "cmdline").read_text()
        except OSError:  # it has just ended
            continue
        if of == parent and "spawn_main" in words:
            found.append(int(status.parent.name))
    return sorted(found)
