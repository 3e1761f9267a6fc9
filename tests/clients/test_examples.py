"""The scripts of `examples`, each in a process of its own, against a live service."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import OpenEXR
import pytest

from api.live import serving
from cli.running import write_animation
from engine.engines import running
from house.syntax import ROOT
from meshes import bumpy_grid
from rhytid.formats.png import read_grey_png

pytestmark = pytest.mark.slow
EXAMPLES = ROOT / "examples"
SETTINGS = '{"resolution": 512, "graph": {"wrinkles": 200}}'
TINY = ["--resolution", "512", "--wrinkles", "200"]


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with running(tmp_path_factory.mktemp("store")) as engine, serving(engine) as http:
        yield str(http.base_url)


@pytest.fixture
def face(tmp_path: Path) -> str:
    return str(write_animation(tmp_path / "face.npz", bumpy_grid(10, seed=1), 2))


def run(name: str, *arguments: str, folder: Path, **environment: str) -> str:
    """What an example prints."""
    command = [sys.executable, "-W", "ignore::UserWarning", str(EXAMPLES / name), *arguments]
    ended = subprocess.run(
        command, cwd=folder, text=True, capture_output=True, env={**os.environ, **environment}
    )
    assert ended.returncode == 0, ended.stderr
    return ended.stdout


def test_every_example_is_run_here() -> None:
    here = Path(__file__).read_text(encoding="utf-8")
    assert [f.name for f in EXAMPLES.glob("*.py") if f'run("{f.name}"' not in here] == []


def test_a_face_becomes_maps(tmp_path: Path, url: str, face: str) -> None:
    told = run("face_to_maps.py", face, "--url", url, "--out", "maps", *TINY, folder=tmp_path)
    files = [f"maps/face.1001.{frame}.exr" for frame in ("0001", "0002")]
    assert told.split() == files
    for file in files:
        with OpenEXR.File(str(tmp_path / file)) as image:
            (channel,) = image.channels().values()
            assert channel.pixels.shape == (512, 512)
            assert channel.pixels.min() < 0


def test_a_live_loop_plays_frames(tmp_path: Path, url: str, face: str) -> None:
    told = run("live_loop.py", face, "--url", url, "--frames", "3", *TINY, folder=tmp_path)
    lines = told.splitlines()
    assert [line.split(":")[0] for line in lines] == ["frame 0", "frame 1", "frame 2"]
    deepest = [float(line.split()[-1]) for line in lines]
    assert deepest[0] == deepest[2] < 0
    assert deepest[1] != deepest[0]


def test_the_cells_of_the_notebook_run(tmp_path: Path, url: str, face: str) -> None:
    given = {"RHYTID_URL": url, "RHYTID_MESH": face, "RHYTID_SETTINGS": SETTINGS}
    told = run("notebook.py", folder=tmp_path, **given)
    # The frame that is shown is one that moves.
    strong, _, change = told.partition(": from ")
    assert float(change.split()[0]) < 0
    assert f"notebook.1001.{strong}.npy" in told
    for frame in ("neutral", strong):
        codes = read_grey_png((tmp_path / f"notebook.1001.{frame}.png").read_bytes(), frame)
        assert codes.shape == (512, 512)
