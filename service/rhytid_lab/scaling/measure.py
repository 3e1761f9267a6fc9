"""Runs of `rhytid bake` by one process and by several side by side, timed."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO, Any

from rhytid.errors import InputError, RhytidError
from rhytid.storage.store import AssetStore
from rhytid_lab.scaling.figures import Run

_TIMEOUT = 600.0


@dataclass(frozen=True)
class Shot:
    """Frames 1 to `frames` of a mesh file, and the built asset of a store that they belong to."""

    mesh: Path
    store: Path
    asset: str
    frames: int


def measure(shot: Shot, method: str, workers: int, scratch: Path) -> Run:
    """Bake the shot by so many processes, each with a copy of the store and an equal part of the
    frames, into a folder of `scratch` that is removed.

    Raises InputError where the frames cannot be shared out evenly, RhytidError where a process
    fails.
    """
    if workers < 1 or shot.frames % workers:
        raise InputError(f"{shot.frames} frames cannot be shared out to {workers} workers")
    with AssetStore(shot.store) as store:
        settings = store.overlay(shot.asset) or store.asset(shot.asset).settings
        wrinkles = store.asset(shot.asset).graph.without_copies().counts()[1]
    with TemporaryDirectory(dir=scratch) as folder:
        wall, processor = _timed(shot, method, workers, Path(folder))
        steps = _steps(sorted(Path(folder).glob("*.json")))
        nbytes = sum(file.stat().st_size for file in Path(folder, "maps").glob("*.exr"))
    frames = shot.frames
    return Run(
        settings.resolution, wrinkles, method, workers, frames, wall, processor, nbytes, steps
    )


def _timed(shot: Shot, method: str, workers: int, folder: Path) -> tuple[float, float]:
    """Seconds from the first start to the last end, and of the processors."""
    part = shot.frames // workers
    for worker in range(workers):
        shutil.copytree(shot.store, folder / f"store{worker}")
    commands = [
        [
            *(sys.executable, "-m", "rhytid", "bake", "--mesh", str(shot.mesh)),
            *("--asset", shot.asset, "--store", str(folder / f"store{worker}")),
            *("--method", method, "--frame-range", f"{worker * part + 1}-{(worker + 1) * part}"),
            *("--out", str(folder / "maps"), "--json", str(folder / f"{worker}.json")),
        ]
        for worker in range(workers)
    ]
    before, start = _children(), time.perf_counter()
    with Path(folder, "log").open("w+") as log:
        _wait([subprocess.Popen(command, stdout=log, stderr=log) for command in commands], log)
    return time.perf_counter() - start, _children() - before


def _wait(processes: list[subprocess.Popen[bytes]], log: IO[str]) -> None:
    try:
        failed = [process for process in processes if process.wait(_TIMEOUT)]
    finally:
        for process in processes:
            if process.poll() is None:
                process.kill()
                process.wait()
    if failed:
        log.seek(0)
        raise RhytidError(f"rhytid bake: {log.read().strip()[-500:]}")


def _children() -> float:
    """Processor time of the processes that ended, seconds."""
    import resource

    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _steps(reports: list[Path]) -> dict[str, float]:
    found: dict[str, float] = {}
    for file in reports:
        steps: dict[str, Any] = json.loads(file.read_bytes())["steps"]
        for name, step in steps.items():
            found[name] = found.get(name, 0.0) + step["seconds"]
    return found
