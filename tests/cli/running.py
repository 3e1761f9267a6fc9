"""The program in this process, and in one of its own."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from meshes import SmallMesh, deform


def write_animation(file: Path, mesh: SmallMesh, count: int) -> Path:
    """A .npz with a neutral mesh and `count` frames."""
    frames = np.stack([deform(mesh.positions, seed, 0.05) for seed in range(count)])
    np.savez(file, **mesh._asdict(), frames=frames)
    return file


def write_neutral(file: Path, mesh: SmallMesh) -> Path:
    """A .npz with a neutral mesh alone."""
    np.savez(file, **mesh._asdict())
    return file


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
