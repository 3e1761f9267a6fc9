"""`rhytid bake --dask`, on a cluster of two processes and without one."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import dask
import numpy as np
import pytest

from cli.running import only_asset, usage_error, write_animation
from meshes import bumpy_grid, deform
from rhytid.baking.farm import dask_cluster
from rhytid.baking.farm.dask_cluster import Cluster, local_cluster
from rhytid.cli import main
from rhytid.engine.messages import TilePlan
from rhytid.engine.tiles.service import TileService
from rhytid.support.build_identity import drawing_version
from storage.leftovers import left_by_a_killed_writer

SMALL = ("--resolution", "256", "--wrinkles", "400")
FRAMES = 6


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    with local_cluster([None, None], tmp_path_factory.mktemp("workers"), True) as own:
        yield own


@pytest.fixture(scope="module")
def shot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with an animation, a store with its asset, and what one bake writes."""
    folder = tmp_path_factory.mktemp("shot")
    mesh = write_animation(folder / "shot.npz", bumpy_grid(10, seed=1), FRAMES)
    given = ["--mesh", str(mesh), "--store", str(folder / "store"), "--out", str(folder / "one")]
    assert main(["bake", *given, *SMALL]) == 0
    return folder


@pytest.fixture
def mesh(tmp_path: Path) -> Path:
    """An animation."""
    return write_animation(tmp_path / "shot.npz", bumpy_grid(10, seed=1), 1)


def given(shot: Path, cluster: Cluster, out: Path) -> list[str]:
    """A bake of the asset on a cluster that runs."""
    built = ["--store", str(shot / "store"), "--asset", only_asset(shot / "store")]
    files = ["--mesh", str(shot / "shot.npz"), "--out", str(out)]
    return ["bake", *files, *built, "--dask", cluster.where]


def maps(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.glob("*.exr")}


def names(folder: Path) -> list[str]:
    return sorted(file.name for file in folder.iterdir())


def test_processes_are_not_profiled(cluster: Cluster) -> None:
    """In Python 3.11 that may hang one for good: gh-106883."""
    asked = cluster.client.run(lambda: dask.config.get("distributed.worker.profile.enabled"))
    assert [*asked.values()] == [False, False]


@pytest.mark.slow
def test_files_are_those_of_one_bake(
    shot: Path, cluster: Cluster, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, figures = tmp_path / "out", tmp_path / "figures.json"

    command = [*given(shot, cluster, out), "--chunk", "2", "--json", str(figures)]
    assert main(command) == 0

    records = [f"shot.bake.{part}.json" for part in ("1-2", "3-4", "5-6")]
    [device] = [name for name in names(out) if name.startswith("shot.device.")]
    assert names(out) == sorted([*maps(shot / "one"), *records, device]), "and nothing else"
    assert maps(out) == maps(shot / "one")
    told = json.loads(figures.read_text())
    assert (told["written"], told["skipped"]) == (FRAMES, 0)
    assert (told["cluster"]["tasks"], told["cluster"]["lost"]) == (3, 0)
    assert told["steps"]["redraw"]["calls"] == FRAMES

    (out / "shot.1001.0003.exr").unlink()
    assert main(command) == 0
    told = json.loads(figures.read_text())
    assert (told["written"], told["skipped"]) == (1, FRAMES - 1)
    assert maps(out) == maps(shot / "one")
    assert "warning" not in capsys.readouterr().err

    assert main([*given(shot, cluster, out), "--chunk", "3", "--method", "neutral"]) == 0
    assert "mixed" not in capsys.readouterr().err
    left = [name for name in names(out) if name.startswith("shot.bake.")]
    assert left == ["shot.bake.1-3.json", "shot.bake.4-6.json"], "all were baked anew"


@pytest.mark.slow
def test_a_strict_bake_that_would_replace_a_file_begins_no_chunk(
    shot: Path, cluster: Cluster, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    last = out / f"shot.1001.{FRAMES:04d}.exr"
    last.write_bytes(b"older")

    assert main([*given(shot, cluster, out), "--chunk", "1", "--strict"]) == 1

    told = capsys.readouterr().err
    assert f"warning: files-replaced: the bake: {last} is not what is asked for" in told
    assert "so nothing was done (--allow files-replaced" in told
    assert maps(out) == {last.name: b"older"}
    last.unlink()
    assert main([*given(shot, cluster, out), "--strict"]) == 0
    assert maps(out) == maps(shot / "one")


@pytest.mark.slow
def test_a_strict_bake_takes_up_what_workers_of_another_device_wrote(
    shot: Path, cluster: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    figures = tmp_path / "figures.json"
    command = [*given(shot, cluster, tmp_path / "out"), "--chunk", "3", "--json", str(figures)]
    assert main([*command, "--frame-range", "1-3"]) == 0

    here = property(lambda _: f"Other/1/Device/{drawing_version()}")
    monkeypatch.setattr(TileService, "drawn_by", here)
    plan = TileService.plan

    def planned(tiles: Any, *place: Any) -> TilePlan:
        made = plan(tiles, *place)
        key = tiles.key(*place, tiles.drawn_by)
        return replace(made, description=replace(made.description, key=key))

    monkeypatch.setattr(TileService, "plan", planned)
    assert main([*command, "--strict"]) == 0

    told = json.loads(figures.read_text())
    assert (told["written"], told["skipped"], told["warnings"]) == (3, 3, [])


@pytest.mark.slow
def test_methods_are_told_once_by_what_is_there_at_the_end(
    shot: Path, cluster: Cluster, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    command = [*given(shot, cluster, out), "--chunk", "1"]
    binned = [*command, "--method", "binned"]
    strict = ["--strict", "--allow", "files-replaced"]
    assert main(command) == 0
    capsys.readouterr()

    assert main([*binned, "--frame-range", "1-2", *strict]) == 1
    told = capsys.readouterr().err
    assert told.count("methods-mixed: ") == 1
    assert "maps would be by binned (frames 1-2) and redraw (frames 3-6), as" in told
    assert "1 warning, so nothing was done (--allow methods-mixed would" in told

    assert main([*binned, "--frame-range", "1-2"]) == 0
    told = capsys.readouterr().err
    assert told.count("methods-mixed: ") == 1
    assert "maps are by binned (frames 1-2) and redraw (frames 3-6), as" in told

    assert main([*binned, *strict]) == 0
    assert "methods-mixed" not in capsys.readouterr().err


@pytest.mark.slow
def test_methods_are_told_where_a_bake_fails(
    shot: Path, cluster: Cluster, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = [f"v {x} {y} {z}\n" for x, y, z in bumpy_grid(10, seed=1).positions]
    for number in range(1, 5):
        (tmp_path / f"f.{number:04d}.obj").write_text("".join(lines))
    frames = ["--frames", *map(str, sorted(tmp_path.glob("*.obj")))]
    command = [*given(shot, cluster, tmp_path / "out"), *frames, "--chunk", "4"]
    assert main(command) == 0
    (tmp_path / "f.0003.obj").write_text("".join(lines[:3]))
    capsys.readouterr()

    assert main([*command, "--method", "neutral"]) == 1

    told = capsys.readouterr().err
    assert "maps are by neutral (frames 1-2) and redraw (frames 3-4), as" in told
    assert "f.0003.obj" in told.splitlines()[-1]


@pytest.mark.slow
def test_a_worker_that_is_killed_loses_no_frame(cluster: Cluster, tmp_path: Path) -> None:
    mesh = write_animation(tmp_path / "long.npz", bumpy_grid(10, seed=1), 40)
    out, one = tmp_path / "out", tmp_path / "one"
    build = ["bake", "--mesh", str(mesh), *SMALL, "--store"]
    assert main([*build, str(tmp_path / "a"), "--out", str(one)]) == 0
    out.mkdir()
    half = left_by_a_killed_writer(out, "0" * 32, "long.1001.0009.exr")
    other = left_by_a_killed_writer(out, "1" * 32, "other.1001.0009.exr")
    killed: list[int] = []
    hidden: set[Path] = set()

    def kill() -> None:
        by = time.monotonic() + 60
        while time.monotonic() < by and not killed:
            time.sleep(0.001)
            hidden.update(out.glob(".unfinished-*"))
            if len(list(out.glob("*.exr"))) >= 5:
                pid: Any = cluster.own and next(iter(cluster.own.workers.values())).pid
                os.kill(pid, signal.SIGKILL)
                killed.append(pid)

    killer = threading.Thread(target=kill)
    killer.start()
    try:
        where = ["--out", str(out), "--dask", cluster.where, "--chunk", "10"]
        assert main([*build, str(tmp_path / "b"), *where]) == 0
    finally:
        killer.join()

    assert killed
    assert maps(out) == maps(one)
    assert len(maps(out)) == 40
    assert not half.exists()
    assert [*out.glob(".unfinished-*")] == [other], "what others may be writing stays"
    assert len(hidden) == 3, "the one of the bake, in which workers prepare their files"


ENDING = """
import os, sys
from pathlib import Path
from rhytid.baking.farm.dask_cluster import local_cluster
with local_cluster([None], Path(sys.argv[1]), quiet=True):
    os._exit(3)
"""


@pytest.mark.slow
def test_a_client_that_ends_at_once_says_nothing_of_semaphores(tmp_path: Path) -> None:
    command = [sys.executable, "-c", ENDING, str(tmp_path)]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert (ended.returncode, ended.stderr) == (3, "")


@pytest.mark.slow
def test_warnings_of_workers_are_told_as_those_of_one_bake(
    shot: Path, cluster: Cluster, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    positions = bumpy_grid(10, seed=1).positions
    frames = tmp_path / "frames.npy"
    np.save(frames, np.stack([deform(positions, seed, 0.05) * 2.54 for seed in range(FRAMES)]))
    told = []
    for number, more in enumerate(([], ["--dask", cluster.where, "--chunk", "2"])):
        figures = tmp_path / f"{number}.json"
        command = given(shot, cluster, tmp_path / f"{number}")[:-2]
        assert main([*command, "--frames", str(frames), *more, "--json", str(figures)]) == 0
        listed = [warning["where"] for warning in json.loads(figures.read_text())["warnings"]]
        lines = [line for line in capsys.readouterr().err.splitlines() if " warning: " in line]
        told.append((sorted(listed), len(lines)))

    assert told[0] == told[1]
    assert len(told[0][0]) == FRAMES
    assert told[0][1] == 3, "of many of a kind the first are printed"


@pytest.mark.slow
def test_a_bad_frame_ends_with_its_error(
    shot: Path, cluster: Cluster, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh = bumpy_grid(10, seed=1)
    for number in range(1, 5):
        lines = [f"v {x} {y} {z}\n" for x, y, z in deform(mesh.positions, number, 0.05)]
        lines = lines[:3] if number == 3 else lines
        (tmp_path / f"f.{number:04d}.obj").write_text("".join(lines))
    frames = ["--frames", *map(str, sorted(tmp_path.glob("*.obj")))]
    errors = []
    for more in ([], ["--chunk", "1"]):
        command = [*given(shot, cluster, tmp_path / "out"), *frames, *more]
        assert main(command if more else command[: command.index("--dask")] + frames) == 1
        errors.append(capsys.readouterr().err.splitlines()[-1])

    assert errors[0] == errors[1]
    assert "f.0003.obj" in errors[0]
    assert [file for file in (tmp_path / "out").iterdir() if file.is_dir()] == []


def test_dask_that_is_not_there_is_named(
    mesh: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    given = ["--mesh", str(mesh), "--out", str(tmp_path / "none")]

    assert main(["bake", *given, "--dask", "local"]) == 1
    assert (
        "--dask needs Dask; in a clone of rhytid: pip install '.[dask]'" in capsys.readouterr().err
    )
    assert not (tmp_path / "none").exists()


def test_a_scheduler_that_does_not_answer_is_told_before_anything_is_built(
    mesh: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(dask_cluster, "ANSWER", 0.2)
    given = ["--mesh", str(mesh), "--out", str(tmp_path / "none")]

    assert main(["bake", *given, "--dask", "tcp://127.0.0.1:9"]) == 1
    assert "no Dask scheduler answers at tcp://127.0.0.1:9" in capsys.readouterr().err
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--dask", "farm"], "--dask farm: local, or an address as tcp://HOST:8786"),
        (["--chunk", "3"], "--chunk says how many frames a task has: give --openjd or --dask"),
        (["--dask", "local", "--openjd", "job"], "--openjd and --dask are two ways"),
        (["--dask-workers", "3"], "--dask-workers says how many processes"),
        (["--dask", "tcp://farm:8786", "--dask-workers", "3"], "--dask-workers says how many"),
        (["--dask", "local", "--dask-workers", "0"], "'0': a whole number from 1"),
    ],
)
def test_options_that_do_not_fit_are_refused(
    more: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["bake", "--mesh", __file__, "--out", str(tmp_path)]
    assert message in usage_error(capsys, *given, *more)


def test_an_address_without_a_scheme_is_refused_in_one_line(
    mesh: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["bake", "--mesh", str(mesh), "--out", str(tmp_path), "--dask", "127.0.0.1"]
    reason = "--dask 127.0.0.1: local, or an address as tcp://HOST:8786"
    assert usage_error(capsys, *given) == f"rhytid bake: error: {reason}\n"
