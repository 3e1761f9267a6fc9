"""A bake by one process beside one by Dask: `python -m rhytid_lab.bench.farm_dask shot.npz`.

The skin is built once. Then one process and a cluster of two bake the same frames in turns, each
time into a new folder; every file of the one is compared with that of the other, byte by byte.
With `--kills N` workers of the cluster are killed while they bake, until there were so many.
Processor time is of all processes of a command: on a shared machine it says more than the time
that passed.

Linux alone: processes are found in /proc. POCL_MAX_PTHREAD_COUNT=1 gives each process one core.
"""

from __future__ import annotations

import argparse
import json
import random
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rhytid_lab.bench.killed_workers import killed_bake
from rhytid_lab.bench.timed_command import Timed, timed

KERNELS = ("stretch", "redraw", "binned", "convolved", "neutral")


@dataclass(frozen=True)
class Bake:
    """Bakes of one asset."""

    mesh: Path
    store: Path
    asset: str
    options: Sequence[str]

    def command(self, out: Path, *more: str) -> list[str]:
        """`rhytid bake` into a folder."""
        asset = ["--store", str(self.store), "--asset", self.asset]
        return ["bake", "--mesh", str(self.mesh), "--out", str(out), *asset, *self.options, *more]


def main() -> None:
    """Print a line for each bake."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("mesh", type=Path, help="a mesh file with frames")
    parser.add_argument("--resolution", type=int, default=2048)
    parser.add_argument("--method", default="redraw")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--kills", type=int, default=0)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="rhytid-bench-") as name:
        folder = Path(name)
        bake = _built(folder, arguments)
        dask = ("--dask", "local", "--dask-workers", str(arguments.workers))
        for turn in range(arguments.turns):
            for words, more in {"one process": (), f"{arguments.workers} workers": dask}.items():
                _report(words, bake, folder / f"{len(more)}-{turn}", folder / "first", more)
        _kill(bake, folder, dask, arguments.kills)


def _built(folder: Path, arguments: argparse.Namespace) -> Bake:
    """The asset, by a bake whose files all others are compared with."""
    store, first = folder / "store", folder / "first"
    options = ["--method", arguments.method]
    size = ["--resolution", str(arguments.resolution)]
    files = ["--mesh", str(arguments.mesh), "--store", str(store), "--out", str(first)]
    built = timed(["bake", *files, *options, *size])
    [home] = (store / "assets").iterdir()
    print(f"build and bake by one process: {built.text()}")  # noqa: T201
    return Bake(arguments.mesh, store, home.name, options)


def _report(name: str, bake: Bake, out: Path, first: Path, more: Sequence[str] = ()) -> None:
    figures = out.with_suffix(".json")
    took = timed(bake.command(out, *more, "--json", str(figures)))
    told = json.loads(figures.read_text())
    steps = {step: one["seconds"] for step, one in told["steps"].items()}
    kernels = sum(seconds for step, seconds in steps.items() if step in KERNELS)
    parts = ", ".join(f"{step} {seconds:.1f}" for step, seconds in steps.items())
    print(  # noqa: T201
        f"{name}: {took.text()}; kernels {kernels:.1f} s ({parts}); {_moved(took, out, told)}; "
        f"{equal_files(out, first)}"
    )


def _moved(took: Timed, out: Path, told: dict[str, dict[str, int]]) -> str:
    cluster = told.get("cluster", {})
    snapshots = cluster.get("workers", 0) * cluster.get("snapshot_bytes", 0)
    written = sum(file.stat().st_size for file in out.iterdir() if file.is_file())
    return f"{written / 1e6:.1f} MB of files, {snapshots / 1e6:.1f} MB of snapshots read"


def _kill(bake: Bake, folder: Path, dask: Sequence[str], kills: int) -> None:
    """Bake again and again while workers are killed."""
    chance, done = random.Random(1), 0
    while done < kills:
        out = folder / f"killed{done}"
        seconds = killed_bake(bake.command(out, *dask, "--verbose"), kills - done, chance)
        done += len(seconds)
        listed = ", ".join("-" if one is None else f"{one:.1f}" for one in seconds)
        recovered = f"seconds to the first frame of the next worker: {listed}"
        files = equal_files(out, folder / "first")
        print(f"{len(seconds)} kills, {recovered}; {files}")  # noqa: T201


def equal_files(out: Path, first: Path) -> str:
    """How many maps are there, and are the same."""
    wanted = sorted(first.glob("*.exr"))
    there = [file for file in wanted if (out / file.name).is_file()]
    same = [file for file in there if (out / file.name).read_bytes() == file.read_bytes()]
    return f"{len(wanted)} files: {len(wanted) - len(there)} missing, {len(same)} equal"


if __name__ == "__main__":
    main()
