"""Runs of `rhytid bake` are timed, and what they write is counted."""

from __future__ import annotations

from pathlib import Path

import pytest

from cli.running import only_asset, write_animation
from meshes import SmallMesh
from rhytid.cli import main
from rhytid.errors import InputError, RhytidError
from rhytid_lab.scaling.measure import Shot, measure


@pytest.mark.slow
def test_two_processes_write_what_one_does(tmp_path: Path, small_mesh: SmallMesh) -> None:
    mesh, store = write_animation(tmp_path / "shot.npz", small_mesh, 2), tmp_path / "store"
    given = ["--mesh", str(mesh), "--out", str(tmp_path / "maps"), "--store", str(store)]
    assert main(["bake", *given, "--resolution", "256", "--wrinkles", "400"]) == 0
    asset = only_asset(store)
    shot = Shot(mesh, store, asset, 2)
    both = measure(shot, "redraw", 2, tmp_path)

    written = sum(file.stat().st_size for file in (tmp_path / "maps").glob("*.exr"))
    assert (both.size, both.frames, both.workers) == (256, 2, 2)
    assert both.nbytes == written
    assert set(both.steps) == {"stretch", "redraw", "write"}
    assert 0.0 < sum(both.steps.values()) < 2 * both.wall
    assert both.processor > 0.0
    assert not [path for path in tmp_path.iterdir() if path.name.startswith("tmp")]

    missing = Shot(tmp_path / "nowhere.npz", store, asset, 2)
    with pytest.raises(RhytidError, match=r"rhytid bake.*nowhere\.npz"):
        measure(missing, "redraw", 1, tmp_path)


def test_frames_are_shared_out_evenly(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="3 frames cannot be shared out to 2 workers"):
        measure(Shot(tmp_path, tmp_path, "a", 3), "redraw", 2, tmp_path)
