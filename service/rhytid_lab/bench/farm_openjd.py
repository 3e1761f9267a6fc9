"""One process beside two tasks of a job: `python -m rhytid_lab.bench.farm_openjd shot.npz`.

The job is written once, with its skin. Then one process bakes all frames, and two sessions of
`openjd run` bake half of them each, side by side, each time into a new folder; every file of the
one is compared with that of the other, byte by byte. With `--kills N` the process of a task is
killed while it bakes, and the task is run again, until there were so many.

Linux alone: processes are found in /proc. Needs `pip install openjd-cli`.
"""

from __future__ import annotations

import argparse
import json
import random
import re
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from rhytid_lab.bench.farm_dask import KERNELS, equal_files
from rhytid_lab.bench.killed_tasks import Task
from rhytid_lab.bench.timed_command import timed, timed_all

_STEP = re.compile(rf"\s({'|'.join(KERNELS)})\s+\d+\s+([0-9.]+)\s")


@dataclass(frozen=True)
class Job:
    """A bundle, and what its tasks are run with.  program: `rhytid` as one file."""

    bundle: Path
    mesh: Path
    program: Path

    def command(self, out: Path, frames: str) -> list[str]:
        """One task in a session of its own."""
        values = {"Mesh": self.mesh.resolve(), "Out": out, "Rhytid": self.program}
        given = [word for name, value in values.items() for word in ("-p", f"{name}={value}")]
        tasks = json.dumps([{"Frames": frames}])
        template = str(self.bundle / "template.json")
        return [sys.executable, "-m", "openjd", "run", template, *given, "--tasks", tasks]


def main() -> None:
    """Print a line for each bake."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("mesh", type=Path, help="a mesh file with frames, counted from 1")
    parser.add_argument("--frames", type=int, default=60, help="how many there are")
    parser.add_argument("--resolution", type=int, default=2048)
    parser.add_argument("--method", default="redraw")
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--kills", type=int, default=0)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="rhytid-bench-") as name:
        folder = Path(name)
        job, first = _written(folder, arguments)
        half = arguments.frames // 2
        for turn in range(arguments.turns):
            _one(arguments, folder, first if turn == 0 else folder / f"one{turn}", first)
            _two(job, folder / f"two{turn}", [f"1-{half}", f"{half + 1}-{arguments.frames}"], first)
        _kill(job, folder / "killed", f"1-{arguments.frames}", first, arguments.kills)


def _written(folder: Path, arguments: argparse.Namespace) -> tuple[Job, Path]:
    program = folder / "rhytid"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m rhytid "$@"\n')
    program.chmod(0o755)
    files = ["--mesh", str(arguments.mesh), "--out", str(folder), "--store", str(folder / "store")]
    how = ["--method", arguments.method, "--resolution", str(arguments.resolution)]
    took = timed(["bake", *files, *how, "--openjd", str(folder / "job")])
    size = (folder / "job" / "asset.rhytid.tar").stat().st_size
    print(f"build and bundle: {took.text()}; {size / 1e6:.1f} MB of snapshot")  # noqa: T201
    return Job(folder / "job", arguments.mesh, program), folder / "first"


def _one(arguments: argparse.Namespace, folder: Path, out: Path, first: Path) -> None:
    [home] = (folder / "store" / "assets").iterdir()
    asset = ["--store", str(folder / "store"), "--asset", home.name, "--method", arguments.method]
    figures = out.with_suffix(".json")
    given = ["--mesh", str(arguments.mesh), "--out", str(out), "--json", str(figures)]
    took = timed(["bake", *given, *asset])
    steps = json.loads(figures.read_text())["steps"]
    kernels = sum(one["seconds"] for step, one in steps.items() if step in KERNELS)
    same = equal_files(out, first)
    print(f"one process: {took.text()}; kernels {kernels:.1f} s; {same}")  # noqa: T201


def _two(job: Job, out: Path, frames: list[str], first: Path) -> None:
    took, said = timed_all([job.command(out, one) for one in frames])
    kernels = sum(float(match[2]) for text in said for match in _STEP.finditer(text))
    print(  # noqa: T201
        f"{len(frames)} tasks side by side: {took.text()}; kernels {kernels:.1f} s; "
        f"{equal_files(out, first)}"
    )


def _kill(job: Job, out: Path, frames: str, first: Path, kills: int) -> None:
    """Run a task again and again that is killed each time but the last."""
    chance = random.Random(1)
    # Each task adds a frame or two before it is killed.
    waits = [chance.randint(1, 2) for _ in range(kills)]
    seconds = [Task(job.command(out, frames)).killed_after(drawn) for drawn in waits]
    if kills:
        Task(job.command(out, frames)).finished()
        listed = ", ".join(f"{one:.1f}" for one in seconds)
        print(  # noqa: T201
            f"{kills} kills, seconds from the start of a task to its first new frame: {listed}; "
            f"{equal_files(out, first)}"
        )


if __name__ == "__main__":
    main()
