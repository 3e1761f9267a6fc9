"""The scene with the maps on it, and what is made of its renders."""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import bpy
import numpy as np
import rendering
import sheets
import stage
from face import Face
from shots import CLOSE, FILM, Shot

BUILD = Path(__file__).resolve().parents[1] / "build.py"
ADDON = "bl_ext.user_default.rhytid"
FPS, FILM_QUALITY, STILL_QUALITY = 15, 72, 85


def opened(
    face: Face, moves: np.ndarray, maps: Path, out: Path, eyes: bool = True
) -> bpy.types.Object:
    """The animated face with the maps on it, by the extension's Open Baked Maps."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.extensions.package_install_files(
        filepath=package(out), repo="user_default", enable_on_install=True
    )
    if ADDON not in bpy.context.preferences.addons:
        raise SystemExit("the extension could not be installed")
    obj = stage.build(face, moves, eyes)
    obj.rhytid.unit = "cm"
    bpy.ops.rhytid.open(directory=str(maps))
    return obj


def package(out: Path) -> str:
    """The extension, built and validated as it is released."""
    command = [sys.executable, str(BUILD), "--out", str(out / "package")]
    output = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
    return output.splitlines()[-1]


def make_pictures(obj: bpy.types.Object, options: argparse.Namespace) -> None:
    """Render what is missing, then write pictures and film."""
    rendering.settle(options.percent)
    if options.only != "film":
        _close(obj, options.out)
    if options.only != "stills":
        _film(obj, options.out)


def _close(obj: bpy.types.Object, out: Path) -> None:
    for shot in CLOSE:
        paths = [path for (path,) in _both(obj, out, shot)]
        sheets.row(paths, list(rendering.SIDES)).save(
            out / f"{shot.name}.jpg", quality=STILL_QUALITY
        )


def _film(obj: bpy.types.Object, out: Path) -> None:
    """With displacement alone: a frame of one side takes half a minute of processor time."""
    paths = rendering.rendered(obj, out / "renders", FILM, "with")
    frames = [sheets.row([path], [""]) for path in paths]
    sheets.film(frames, out / "film.webp", FPS, FILM_QUALITY)
    sheets.contact(frames, 6, 0.3).save(out / "film_contact.png")


def _both(obj: bpy.types.Object, out: Path, shot: Shot) -> list[Sequence[Path]]:
    return [rendering.rendered(obj, out / "renders", shot, side) for side in rendering.SIDES]
