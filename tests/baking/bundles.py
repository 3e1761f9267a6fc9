"""Bundles of jobs, and how `openjd` runs them on this machine."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from meshes import SmallMesh, deform
from rhytid.cli import main

SMALL = ("--resolution", "256", "--wrinkles", "400")
FRAMES = 4


def write_shot(folder: Path, mesh: SmallMesh) -> tuple[Path, list[Path]]:
    """A neutral mesh, and files of one frame each in folders of their own."""
    neutral = folder / "face.npz"
    np.savez(neutral, **mesh._asdict())
    files = []
    for number in range(1, FRAMES + 1):
        file = folder / "frames" / f"take{number % 2}" / f"shot.{number:04d}.npy"
        file.parent.mkdir(parents=True, exist_ok=True)
        np.save(file, deform(mesh.positions, number, 0.05)[None])
        files.append(file)
    return neutral, files


def bake(neutral: Path, files: list[Path], out: Path, *more: str) -> int:
    """`rhytid bake` in this process; returns its status."""
    frames = [str(file) for file in files]
    given = ("--mesh", str(neutral), "--frames", *frames, "--out", str(out))
    return main(["bake", *given, *SMALL, *more])


def template(bundle: Path) -> dict[str, Any]:
    """The template of a bundle."""
    found: dict[str, Any] = json.loads((bundle / "template.json").read_bytes())
    return found


def values(bundle: Path) -> dict[str, str]:
    """The values of its parameters, by name."""
    found = json.loads((bundle / "parameter_values.json").read_bytes())["parameterValues"]
    return {value["name"]: value["value"] for value in found}


def program(folder: Path) -> Path:
    """`rhytid` as one file, as workers have it."""
    file = folder / "rhytid-here"
    file.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m rhytid "$@"\n')
    file.chmod(0o755)
    return file


def openjd(*arguments: object, timeout: float = 120) -> subprocess.CompletedProcess[str]:
    """The command line of Open Job Description; stderr is in stdout."""
    command = [sys.executable, "-m", "openjd", *map(str, arguments)]
    pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    return subprocess.run(command, text=True, timeout=timeout, env=os.environ, **pipes)


def run_job(bundle: Path, *more: str, **changed: object) -> subprocess.CompletedProcess[str]:
    """Run all tasks of a bundle, or those that `more` names, in one session."""
    given = {**values(bundle), "Rhytid": program(bundle), **changed}
    words = [word for name, value in given.items() for word in ("-p", f"{name}={value}")]
    return openjd("run", bundle / "template.json", *words, *more)


def maps(folder: Path) -> dict[str, bytes]:
    """The maps in a folder, by name."""
    return {file.name: file.read_bytes() for file in sorted(folder.glob("*.exr"))}
