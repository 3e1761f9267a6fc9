"""A job of `rhytid bake --openjd`, run by the reference implementation of Open Job Description."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from baking.bundles import bake, maps, openjd, program, run_job, values, write_shot
from cli.running import only_asset
from face_data import Face
from meshes import SmallMesh, bumpy_grid
from rhytid.cli import main

pytestmark = pytest.mark.slow
BINNED = ("--method", "binned")


class Shot:
    """A shot in a folder, its job, and the maps of one bake of all frames."""

    def __init__(self, folder: Path, mesh: SmallMesh) -> None:
        self.neutral, self.files = write_shot(folder, mesh)
        self.bundle, self.out = folder / "job", folder / "maps"
        store = ("--store", str(folder / "assets"))
        assert bake(self.neutral, self.files, folder / "whole", *store, *BINNED) == 0
        self.whole = maps(folder / "whole")
        more = ("--openjd", str(self.bundle), "--chunk", "2")
        assert bake(self.neutral, self.files, self.out, *store, *BINNED, *more) == 0


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("shot")
    Shot(folder, bumpy_grid(10, seed=1))
    return folder


@pytest.fixture
def shot(made: Path) -> Shot:
    """The one shot, without what a test before this one has drawn."""
    shot = Shot.__new__(Shot)
    shot.neutral = made / "face.npz"
    shot.files = sorted((made / "frames").rglob("*.npy"), key=lambda file: file.name)
    shot.bundle, shot.out, shot.whole = made / "job", made / "maps", maps(made / "whole")
    shutil.rmtree(shot.out, ignore_errors=True)
    return shot


def test_tasks_write_what_one_bake_writes(shot: Shot) -> None:
    done = run_job(shot.bundle)

    assert done.returncode == 0, done.stdout
    assert "Chunks run: 2" in done.stdout
    assert done.stdout.count("openjd_progress: 100.0") == 2
    assert "openjd_status: baking: frame 2 of 2" in done.stdout
    assert maps(shot.out) == shot.whole


def test_a_task_that_fails_says_why_and_is_run_again(shot: Shot) -> None:
    bad, good = shot.files[2], shot.files[2].read_bytes()
    np.save(bad, np.full((1, 3, 3), np.nan, np.float32))
    try:
        failed = run_job(shot.bundle)
    finally:
        bad.write_bytes(good)

    assert failed.returncode != 0
    assert f"openjd_fail: rhytid bake: {bad}: " in failed.stdout
    first = maps(shot.out)
    assert [*first] == [*shot.whole][:2]
    times = {name: (shot.out / name).stat().st_mtime_ns for name in first}
    again = run_job(shot.bundle)
    assert again.returncode == 0, again.stdout
    assert maps(shot.out) == shot.whole
    assert times == {name: (shot.out / name).stat().st_mtime_ns for name in first}


def test_paths_are_mapped(shot: Shot, tmp_path: Path) -> None:
    given = {name: f"/film/{Path(value).name}" for name, value in values(shot.bundle).items()}
    rule = {
        "source_path_format": "POSIX",
        "source_path": "/film",
        "destination_path": str(shot.neutral.parent),
    }
    rules = tmp_path / "rules.json"
    rules.write_text(json.dumps({"version": "pathmapping-1.0", "path_mapping_rules": [rule]}))

    mapped = f"file://{rules}"
    done = run_job(shot.bundle, "--maximum-tasks", "1", "--path-mapping-rules", mapped, **given)

    assert done.returncode == 0, done.stdout
    assert [*maps(shot.out)] == [*shot.whole][:2]


def test_method_and_resolution_are_parameters(shot: Shot, tmp_path: Path) -> None:
    done = run_job(shot.bundle, "--maximum-tasks", "1", Method="redraw", Resolution=512)

    assert done.returncode == 0, done.stdout
    store = shot.neutral.parent / "assets"
    asset = only_asset(store)
    given = ["--mesh", str(shot.neutral), "--store", str(store), "--asset", asset]
    given += ["--resolution", "512"]
    frames = ["--frames", *map(str, shot.files), "--frame-range", "1-2"]
    assert main(["bake", *given, *frames, "--out", str(tmp_path / "maps")]) == 0
    assert maps(shot.out) == maps(tmp_path / "maps")


def test_the_command_line_checks_and_sums_up(shot: Shot) -> None:
    assert openjd("check", shot.bundle / "template.json").returncode == 0
    given = [word for pair in values(shot.bundle).items() for word in ("-p", "=".join(pair))]
    told = openjd("summary", shot.bundle / "template.json", *given)
    assert told.returncode == 0, told.stdout
    assert "Total tasks: 4" in told.stdout


@pytest.mark.face
def test_a_job_of_the_real_face(tmp_path: Path, face: Face) -> None:
    np.savez(
        tmp_path / "shot.npz",
        positions=face.positions, faces=face.faces, uv=face.uv, face_uv=face.face_uv,
        frames=np.stack([face.captured(index) for index in (100, 900, 1700)]),
    )  # fmt: skip
    given = ["--mesh", str(tmp_path / "shot.npz"), "--resolution", "512", "--name", "face", *BINNED]
    given += ["--store", str(tmp_path / "assets")]
    assert main(["bake", *given, "--out", str(tmp_path / "whole")]) == 0
    more = ["--openjd", str(tmp_path / "job"), "--chunk", "2"]
    assert main(["bake", *given, "--out", str(tmp_path / "maps"), *more]) == 0

    done = run_job(tmp_path / "job")
    assert done.returncode == 0, done.stdout
    assert maps(tmp_path / "maps") == maps(tmp_path / "whole")
    assert len(maps(tmp_path / "maps")) == 3


def test_a_job_that_is_cancelled_ends_its_task(shot: Shot, tmp_path: Path) -> None:
    """ctrl-C ends `openjd run`, which cancels the action by the rule of the template."""
    given = {**values(shot.bundle), "Rhytid": str(program(tmp_path)), "FramesPerTask": "4"}
    words = [word for pair in given.items() for word in ("-p", "=".join(pair))]
    command = [sys.executable, "-m", "openjd", "run", str(shot.bundle / "template.json"), *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as running:
        wait_for(running, "openjd_status: baking: frame 2 of 4")
        os.kill(running.pid, signal.SIGINT)
        assert running.stdout is not None
        said = running.stdout.read()
    assert "openjd_fail" not in said
    found = maps(shot.out)
    assert found == {name: shot.whole[name] for name in found}
    assert not [file for file in shot.out.iterdir() if file.name.startswith(".unfinished")]


def task(shot: Shot, frames: str, store: Path) -> subprocess.Popen[str]:
    """The command of one task."""
    restore = ["restore", str(shot.bundle / "asset.rhytid.tar"), "--store", str(store)]
    assert main(restore) == 0
    asset = only_asset(store)
    given = ["--mesh", str(shot.neutral), "--out", str(shot.out), "--asset", asset]
    given += ["--store", str(store), "--frame-range", frames, "--progress", "openjd", *BINNED]
    command = [sys.executable, "-m", "rhytid", "bake", *given]
    listed = ["--frames", *map(str, shot.files)]
    # Little memory: a frame is drawn once the one before it is written.
    env = {**os.environ, "RHYTID_HOST_MEMORY_MB": "1"}
    return subprocess.Popen([*command, *listed], stdout=subprocess.PIPE, text=True, env=env)


def wait_for(running: subprocess.Popen[str], words: str) -> None:
    assert running.stdout is not None
    for line in running.stdout:
        if words in line:
            return
    pytest.fail(f"it ended before it said {words!r}")


@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGTERM])
def test_a_task_that_is_ended_is_run_again(end: signal.Signals, shot: Shot, tmp_path: Path) -> None:
    with task(shot, "1-4", tmp_path / "one") as running:
        wait_for(running, "baking: frame 3 of 4")
        start = time.monotonic()
        os.kill(running.pid, end)
        status = running.wait(30)

    assert status == (-end if end == signal.SIGKILL else 128 + end)
    assert time.monotonic() - start < 5
    found = maps(shot.out)
    assert len(found) < 4
    assert found == {name: shot.whole[name] for name in found}
    with task(shot, "1-4", tmp_path / "two") as running:
        assert running.stdout is not None
        said = running.stdout.read()
        assert running.wait(30) == 0
    assert f"{len(found)} already there" in said
    assert maps(shot.out) == shot.whole
