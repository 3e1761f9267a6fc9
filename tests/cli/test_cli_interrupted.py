"""Ctrl-C ends every command within a second, and leaves nothing half-written."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rhytid.baking.farm import openjd_bundle
from rhytid.cli.termination import AGAIN, GRACE, PATIENCE
from rhytid_lab.samples.face import procedural_face

# Words of `--verbose` at which a command is interrupted, while it works. Progress is printed a few
# times a second: any of several stages, for one alone may be over by then.
SYNTHESIZE = "synthesize face.npz --out out/g.safetensors --wrinkles 30000"
BAKE = "bake --mesh face.npz --out out --resolution 2048 --wrinkles 30000"
EXPORT = "export out --mesh face.npz --wrinkles 30000"
DEMO = "demo --mesh face.npz --out out --resolution 2048 --wrinkles 30000"
# Of these commands; an export that is not whole has no manifest.
FOLDERS = ("redraw", "binned", "textures", "shaders", "glsl-es-300", "glsl-410")
slow = pytest.mark.slow
release = [slow, pytest.mark.release]
RUNS = [
    pytest.param(SYNTHESIZE, "synthesis: ", marks=release),
    (BAKE, "building: "),
    pytest.param(DEMO, "build: ", marks=release),
    pytest.param(SYNTHESIZE, "synthesis: (?!pores)", marks=slow),
    pytest.param(f"{SYNTHESIZE} --preview out/g.png", "preview: UDIM", marks=release),
    pytest.param(BAKE, "wrote face.1001.0001.exr", marks=release),
    pytest.param(f"{BAKE} --method binned", "bins: ", marks=slow),
    pytest.param(f"{BAKE} --dask local", r"frame \d+ is there", marks=slow),
    pytest.param(EXPORT, "reading the asset", marks=release),
    # What it is about at the first look; warm kernels are done before the second.
    pytest.param(DEMO, "calibrate: (queued|starting|making)", marks=release),
    pytest.param("check face.npz --picture out/p.png", "drawing p.png", marks=release),
]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    face = procedural_face(64)
    frames = np.stack([face.pose({"smile": s}) for s in np.linspace(0.2, 1, 40)])
    arrays = {name: getattr(face.mesh, name) for name in ("positions", "faces", "uv", "face_uv")}
    np.savez(tmp_path / "face.npz", **arrays, frames=frames)
    (tmp_path / "tmp").mkdir()
    return tmp_path


def started(arguments: str, folder: Path) -> subprocess.Popen[str]:
    """`rhytid` in a process group of its own, as a terminal starts it."""
    return subprocess.Popen(
        [sys.executable, "-m", "rhytid", *arguments.split()],
        cwd=folder,
        env={**os.environ, "TMPDIR": str(folder / "tmp")},
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
    )


def interrupted(running: subprocess.Popen[str], ready: Callable[[str], bool]) -> tuple[float, str]:
    """Seconds from SIGINT to the group, as ctrl-C sends it, to the end, and what was said then."""
    stderr: Any = running.stderr
    ending = threading.Timer(120, running.kill)
    ending.start()
    with running:
        try:
            said = []
            for line in stderr:
                said.append(line)
                if ready(line):
                    break
            else:
                pytest.fail(f"it ended by itself: {said}")
            os.killpg(running.pid, signal.SIGINT)
            start = time.monotonic()
            rest = stderr.read()
            running.wait(30)
            return time.monotonic() - start, rest
        finally:
            ending.cancel()
            running.kill()


def soon(folder: Path) -> float:
    """Seconds within which a command must end: one on a quiet machine, on which `rhytid --version`
    takes a tenth of one; else ten times the median of three of these."""
    taken = []
    for _ in range(3):
        start = time.monotonic()
        started("--version", folder).communicate(timeout=60)
        taken.append(time.monotonic() - start)
    return max(1.0, 10 * sorted(taken)[1])


@pytest.mark.parametrize(("arguments", "words"), RUNS)
def test_an_interrupted_command_ends_soon_and_leaves_nothing(
    arguments: str, words: str, folder: Path
) -> None:
    running = started(f"{arguments} --verbose", folder)
    seconds, rest = interrupted(running, lambda line: bool(re.search(words, line)))

    assert running.returncode == 130, rest
    assert seconds < soon(folder)
    assert rest.splitlines()[-1] == f"rhytid {arguments.split()[0]}: interrupted"
    assert "Traceback" not in rest
    assert "Exception" not in rest
    kept = ("rhytid-cache-", "pyopencl-", "pocl")
    left = [f.name for f in (folder / "tmp").iterdir() if not f.name.startswith(kept)]
    assert left == []
    for file in (folder / "out").rglob("*"):
        assert file.is_dir() or whole(file), file
        assert file.name in FOLDERS or not file.is_dir(), file


def whole(file: Path) -> bool:
    """Whether a file that a command was allowed to write is as it should be."""
    if file.suffix == ".exr":
        from rhytid.formats.exr import read_exr

        return read_exr(file)[0].shape == (2048, 2048)
    if file.name == "skin.glb":
        return int.from_bytes(file.read_bytes()[8:12], "little") == file.stat().st_size
    if file.name == "triangles.bin":
        return file.stat().st_size % 64 == 0
    if file.suffix == ".safetensors":
        from rhytid.formats.graphs import read_graph

        return read_graph(file.read_bytes()).wrinkles > 0
    return file.suffix == ".json" and file.read_text().rstrip().endswith("}")


BLOCKED = """
import hashlib, sys
from pathlib import Path
from rhytid.cli.termination import interruptible
from rhytid.support.temporary_folders import temporary_folder
with interruptible() as interruption, temporary_folder("x", Path(sys.argv[1])) as folder:
    interruption.command = "bake"
    (folder / "part").touch()
    try:
        print("ready", file=sys.stderr, flush=True)
        hashlib.pbkdf2_hmac("sha256", b"", b"", 100_000_000)
    except KeyboardInterrupt:  # the signal came before the call
        hashlib.pbkdf2_hmac("sha256", b"", b"", 100_000_000)
"""


def test_a_call_that_does_not_return_is_ended_too(tmp_path: Path) -> None:
    """Python's own handlers run only after it: here after a minute."""
    command = [sys.executable, "-c", BLOCKED, str(tmp_path)]
    running = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)
    seconds, rest = interrupted(running, lambda line: line == "ready\n")

    # Where it ends by itself, after its call, it says more.
    assert (running.returncode, rest) == (130, "rhytid bake: interrupted\n")
    assert list(tmp_path.iterdir()) == []
    assert seconds < soon(tmp_path)


WRITING = """
import hashlib, signal, sys
from pathlib import Path
from rhytid.cli import termination
from rhytid.support.atomic_files import atomic_write
termination.PATIENCE = float(sys.argv[2])
with termination.interruptible() as interruption, atomic_write(Path(sys.argv[1])) as aside:
    interruption.command = "bake"
    aside.write_text("half of it")
    try:
        print("writing", file=sys.stderr, flush=True)
        signal.pause()
    finally:  # as a command that finishes what it writes, which takes a minute
        try:
            print("finishing", file=sys.stderr, flush=True)
            hashlib.pbkdf2_hmac("sha256", b"", b"", 100_000_000)
        except (KeyboardInterrupt, SystemExit):  # another signal came before the call
            hashlib.pbkdf2_hmac("sha256", b"", b"", 100_000_000)
"""


@pytest.mark.parametrize(("signals", "patience"), [(2, 600), (1, 0.1)])
def test_sigterm_again_or_after_its_time_ends_a_command_that_writes(
    tmp_path: Path, signals: int, patience: float
) -> None:
    (tmp_path / "older.exr").write_text("whole")
    for name in ("map.exr", "older.exr"):
        command = [sys.executable, "-c", WRITING, str(tmp_path / name), str(patience)]
        running = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        with running:
            assert running.stderr is not None
            assert running.stderr.readline() == "writing\n"
            running.send_signal(signal.SIGTERM)
            assert running.stderr.readline() == "finishing\n"
            if signals > 1:
                running.send_signal(signal.SIGTERM)  # soon after the first, as by GNU `timeout`
                with pytest.raises(subprocess.TimeoutExpired):
                    running.wait(AGAIN / 2)
            while signals > 1 and running.poll() is None:
                running.send_signal(signal.SIGTERM)
                time.sleep(AGAIN / 10)
            said = running.stderr.read()
        dropped = f"rhytid bake: dropped, not finished: {name}\n"
        assert (running.returncode, said) == (143, f"{dropped}rhytid bake: cancelled by SIGTERM\n")
    assert [one.name for one in tmp_path.iterdir()] == ["older.exr"]
    assert (tmp_path / "older.exr").read_text() == "whole"


@pytest.mark.parametrize(
    ("signals", "status", "told"),
    [
        ((signal.SIGTERM, signal.SIGINT), 143, "cancelled by SIGTERM"),
        ((signal.SIGINT, signal.SIGTERM), 130, "interrupted"),
    ],
)
def test_the_first_signal_is_told_and_is_the_status(
    tmp_path: Path, signals: tuple[int, ...], status: int, told: str
) -> None:
    command = [sys.executable, "-c", WRITING, str(tmp_path / "map.exr"), "600"]
    running = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    with running:
        assert running.stderr is not None
        for line, number in zip(("writing\n", "finishing\n"), signals, strict=True):
            assert running.stderr.readline() == line
            running.send_signal(number)
        said = running.stderr.read()
    assert said == f"rhytid bake: dropped, not finished: map.exr\nrhytid bake: {told}\n"
    assert running.returncode == status


def test_farms_wait_longer_for_a_task_than_it_takes() -> None:
    assert openjd_bundle.NOTICE > PATIENCE + GRACE


THREADS = """
from pathlib import Path
import signal
from rhytid.device.select import candidates
def masks():
    tasks = Path("/proc/self/task").glob("*/status")
    return [int(t.read_text().partition("SigBlk:")[2].split()[0], 16) for t in tasks]
assert candidates()
print([mask >> signal.SIGINT - 1 & 1 for mask in masks()])
"""


def test_what_the_driver_starts_gets_no_sigint() -> None:
    """Else its linker ends where a command is interrupted, and PoCL aborts the process."""
    command = [sys.executable, "-c", THREADS]
    blocked = json.loads(subprocess.run(command, capture_output=True, check=True).stdout)
    assert blocked[0] == 0
    assert any(blocked), "those of PoCL; libraries of numpy have threads, too"
