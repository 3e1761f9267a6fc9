"""The program in this process, and in one of its own."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from meshes import SmallMesh, deform
from rhytid.cli import main

# Begins a command that has its own mounts; empty where this system does not let us.
OWN_MOUNTS: tuple[str, ...] = ()
if sys.platform == "linux" and shutil.which("unshare"):
    _mapped = () if os.geteuid() == 0 else ("--map-root-user",)
    _command = ("unshare", "--mount", *_mapped)
    if subprocess.run([*_command, "true"], capture_output=True).returncode == 0:
        OWN_MOUNTS = _command


def write_animation(file: Path, mesh: SmallMesh, count: int) -> Path:
    """A .npz with a neutral mesh and `count` frames."""
    frames = np.stack([deform(mesh.positions, seed, 0.05) for seed in range(count)])
    np.savez(file, **mesh._asdict(), frames=frames)
    return file


def write_neutral(file: Path, mesh: SmallMesh) -> Path:
    """A .npz with a neutral mesh alone."""
    np.savez(file, **mesh._asdict())
    return file


def only_asset(store: Path) -> str:
    """The id of the one asset in a store."""
    [home] = (store / "assets").iterdir()
    return home.name


def usage_error(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """What `rhytid` says on stderr to arguments that it cannot understand."""
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    return capsys.readouterr().err


@contextmanager
def process(*arguments: str, folder: Path) -> Iterator[subprocess.Popen[str]]:
    """`rhytid` with these arguments in a folder; it is ended with the block."""
    command = [sys.executable, "-m", "rhytid", *arguments]
    pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, cwd=folder, text=True, **pipes) as running:
        try:
            yield running
        finally:
            running.kill()
