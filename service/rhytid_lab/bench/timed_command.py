"""A command of rhytid in a process of its own, and the time that it takes."""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Timed:
    """Seconds.

    wall: that passed.  processor: of the command and what it started.  others: that all else on
    this machine computed meanwhile.
    """

    wall: float
    processor: float
    others: float

    def text(self) -> str:
        """The same in words."""
        return f"{self.wall:.1f} s, processor {self.processor:.1f} s (others {self.others:.1f} s)"


def timed(command: Sequence[str]) -> Timed:
    """Run `rhytid` with these arguments. Raises CalledProcessError where it fails."""
    busy, used, start = machine_seconds(), _children(), time.monotonic()
    subprocess.run(
        [sys.executable, "-m", "rhytid", *command, "--quiet"],
        check=True,
        stdout=subprocess.DEVNULL,
    )
    wall, own = time.monotonic() - start, _children() - used
    return Timed(wall, own, max(machine_seconds() - busy - own, 0.0))


def timed_all(commands: Sequence[Sequence[str]]) -> tuple[Timed, list[str]]:
    """Run programs side by side; also what each printed. Raises CalledProcessError where one
    fails."""
    busy, used, start = machine_seconds(), _children(), time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        files = [Path(folder) / str(number) for number in range(len(commands))]
        running = []
        for command, file in zip(commands, files, strict=True):
            with file.open("w") as out:
                running.append(subprocess.Popen(command, stdout=out, stderr=subprocess.STDOUT))
        for one in running:
            one.wait()
        wall, own = time.monotonic() - start, _children() - used
        said = [file.read_text() for file in files]
    for one, text in zip(running, said, strict=True):
        if one.returncode:
            raise subprocess.CalledProcessError(one.returncode, one.args, text)
    return Timed(wall, own, max(machine_seconds() - busy - own, 0.0)), said


def machine_seconds() -> float:
    """Seconds that all processors have computed since the machine started."""
    fields = [int(field) for field in Path("/proc/stat").read_text().split("\n")[0].split()[1:]]
    return (sum(fields) - fields[3] - fields[4]) / 100.0


def _children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
