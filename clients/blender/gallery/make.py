"""Makes the pictures and the film of docs/gallery.md, as a user of the extension would.

    python clients/blender/gallery/make.py FACE_FOLDER --out gallery --rhytid .venv/bin/rhytid

By a Python that has bpy, numpy and pillow. FACE_FOLDER has the ICT face as `face.npz`,
`performance.npz` and `composites.json`. Its frames go to `rhytid bake`; the folder of maps is then
opened by the extension, in a scene with the same animation as shape keys. Run again, it goes on
where it stopped; stderr has the progress. After a change of `stage.py` remove `renders` in the
folder of --out.
"""

from __future__ import annotations

import argparse
import os
import shlex
import subprocess
from pathlib import Path

import numpy as np
from face import Face
from shots import CAPTURED, EXPRESSIONS, weights


def main() -> None:
    """Bake, open, render, put together."""
    options = parsed()
    begin(options.out)
    face = Face.read(options.face)
    moves = weights(face)
    maps = bake(face, moves, options)
    import gallery  # it imports bpy

    obj = gallery.opened(face, moves, maps, options.out)
    gallery.make_pictures(obj, options)


def parsed() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("face", type=Path, help="folder of the ICT face")
    parser.add_argument("--out", type=Path, default=Path("gallery"), help="folder of all files")
    parser.add_argument("--rhytid", default="rhytid", help="the command rhytid")
    parser.add_argument("--resolution", type=int, default=4096, help="texels per side of a map")
    parser.add_argument("--percent", type=int, default=100, help="size of pictures, for a trial")
    parser.add_argument("--only", choices=("stills", "film"), help="leave the other out")
    return parser.parse_args()


def begin(out: Path) -> None:
    """Make the folder of all files, before Blender is imported."""
    out.mkdir(parents=True, exist_ok=True)
    # Blender reads it when it is imported: nothing of the user's is read or written.
    os.environ["BLENDER_USER_RESOURCES"] = str((out / "blender").resolve())


def run(rhytid: str, *arguments: object) -> None:
    """The command rhytid."""
    subprocess.run([*shlex.split(rhytid), *map(str, arguments)], check=True)


def bake(face: Face, moves: np.ndarray, options: argparse.Namespace) -> Path:
    """The folder of maps; `rhytid bake` skips those that are there."""
    mesh, maps = options.out / "face.npz", options.out / "maps"
    face.write(mesh, moves)
    given = ["bake", "--mesh", mesh, "--out", maps, "--store", options.out / "store", "--half"]
    given += ["--sampling", "smooth", "--resolution", options.resolution]
    if options.only == "stills":
        given += ["--frame-range", f"{CAPTURED + 1}-{CAPTURED + len(EXPRESSIONS)}"]
    run(options.rhytid, *given)
    return maps.resolve()


if __name__ == "__main__":
    main()
